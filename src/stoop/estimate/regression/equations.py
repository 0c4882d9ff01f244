"""Equation error: parameters by least squares on measured accelerations, without a start and without integration.

A kind of vehicle chooses its equations; estimates, color correction, domain and model structure are the same for all.
Noise in the regressors biases the estimates.

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., Sunflyte, 2016, chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Protocol, Self

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.aircraft import AircraftEquations, complete
from stoop.estimate.regression.domain import Domain, TimeDomain
from stoop.estimate.regression.least_squares import Bounds, Estimates, Priors, Rows, solve
from stoop.estimate.regression.rotors import RotorEquations
from stoop.problem import Layout, Piece
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import AIR_FRAME, GROUND_FRAME

MAX_ITERATIONS: Final = 8  #: of Gauss-Newton
STEP_TOLERANCE: Final = 1e-3  #: in `Equations.scales`
MIN_COMPLETE: Final = 0.9  #: share of the samples of a piece that a start value needs


class Equations(Protocol):
    """The equations of a kind of vehicle at measured motion, as regression rows for k unknowns."""

    @property
    def layout(self) -> Layout:
        """Free parameters and nuisances."""

    @property
    def linear(self) -> bool:
        """Whether the rows do not depend on where they are linearized."""

    @property
    def places(self) -> tuple[int, ...]:
        """Where the unknowns stand among free parameters, then nuisances."""

    @property
    def priors(self) -> Priors:
        """Prior means and standard deviations (k,), SI; the iteration starts from the means."""

    @property
    def bounds(self) -> Bounds:
        """Lower and upper bounds of the vehicle file (k,), SI."""

    @property
    def scales(self) -> FloatArray:
        """Typical sizes of the unknowns (k,), SI."""

    @property
    def constants(self) -> dict[str, int]:
        """Equation -> its constant term, as a place among the unknowns."""

    def rows(self, values: FloatArray) -> list[Rows]:
        """Return the rows of all samples, linearized about values (k,)."""

    def r2(self, estimates: Estimates, domain: Domain) -> dict[str, float]:
        """Return the coefficient of determination of each equation."""

    def reduced(self, estimates: Estimates) -> Self:
        """Return the equations that determine the estimates, without those that the data do not explain."""


def kind_of(vehicle: Vehicle) -> type[AircraftEquations] | type[RotorEquations]:
    """Return the equations of a vehicle's frame."""
    return {AIR_FRAME: AircraftEquations, GROUND_FRAME: RotorEquations}[vehicle.frame]


def unbounded(equations: Equations) -> Bounds:
    """Return no bounds."""
    wide = np.full(len(equations.places), np.inf)
    return -wide, wide


def estimate(equations: Equations, domain: Domain, bounds: Bounds) -> Estimates | None:
    """Estimate the unknowns; None where the motion was nowhere measured completely.

    Parameters
    ----------
    equations : Equations
    domain : Domain
        A constant that it does not keep is found afterwards, from the means.
    bounds : lower, upper (k,)
    """
    found = _gauss_newton(equations, domain, bounds)
    if found is None:
        return None
    kept = equations.reduced(found)
    return found if kept is equations else _gauss_newton(kept, domain, bounds) or found


def _gauss_newton(equations: Equations, domain: Domain, bounds: Bounds) -> Estimates | None:
    values = equations.priors.mean
    for _ in range(MAX_ITERATIONS):
        samples = equations.rows(values)
        rows = [t for r in samples if (t := r.transformed(domain)).y.size]
        if not rows:
            return None
        found = solve(rows, bounds, equations.priors, domain)
        before, values = values, found.values
        if not np.isfinite(values).all():
            return None
        if equations.linear or np.max(np.abs(values - before) / equations.scales) < STEP_TOLERANCE:
            break
    found = replace(found, r2=equations.r2(found, domain))
    return found if domain.keeps_constants else _with_constants(found, samples, equations.constants, bounds)


def _with_constants(
    found: Estimates, samples: Sequence[Rows], constants: dict[str, int], bounds: Bounds
) -> Estimates:
    """Find constants from the means that the other terms leave; their errors follow from those of the others."""
    values, covariance = found.values.copy(), np.nan_to_num(found.covariance)
    unknown = np.isnan(np.diag(found.covariance))
    unknown[list(constants.values())] = False
    lost = unknown.copy()
    for equation, place in constants.items():
        own = [r for r in samples if r.equation == equation]
        y, X = np.concatenate([r.y for r in own]), np.concatenate([r.X for r in own])
        X[:, place] = 0.0
        values[place] = np.clip(np.mean(y - X @ values), bounds[0][place], bounds[1][place])
        # noise of the mean itself is white noise's: the slow part of it is in the residual of the band
        mean, noise = X.mean(axis=0), float(np.var(y - X @ values) / len(y))
        cross = -(covariance @ mean)
        covariance[place, :], covariance[:, place] = cross, cross
        covariance[place, place] = mean @ covariance @ mean + noise
        lost[place] = bool(np.any(mean[unknown] != 0.0))  # a term constant off zero is one with the constant
    covariance[lost, :] = covariance[:, lost] = np.nan
    return replace(found, values=values, covariance=covariance)


def start_value(layout: Layout, pieces: Sequence[Piece]) -> FloatArray | None:
    """Return free parameters (D,) in the unit box for the start of a search; None where states were not measured.

    Free numbers that the equations do not have stay as in the file.
    """
    equations = kind_of(layout.vehicle).of(layout, pieces)
    if equations.linear and not all(complete(layout.vehicle, p).mean() > MIN_COMPLETE for p in pieces):
        return None
    found = estimate(equations, TimeDomain(), equations.bounds)
    if found is None:
        return None
    values = np.array([p.value for p in layout.parameters])
    free = [(i, v) for i, v in zip(equations.places, found.values, strict=True) if i < layout.dimension]
    for i, value in free:
        values[i] = value
    return layout.unit(values) if np.isfinite(values).all() else None
