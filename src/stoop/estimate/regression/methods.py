"""Regression as a method of its own: estimates and error bars without a simulation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.estimate.fit import Fit, Options, estimation_problem
from stoop.estimate.regressed import regressed_fit
from stoop.estimate.regression.domain import Band, Domain, Time
from stoop.estimate.regression.estimate import Regressed, regressed
from stoop.estimate.regression.rotor_method import of_rotors
from stoop.flight import Flight
from stoop.problem import Layout
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

HOW: Final = (
    "The coefficients were measured sample by sample from accelerations and rates, and the terms fitted to them by "
    "least squares {where}. Noise of the angles and rates in the terms draws estimates towards zero, and the "
    "error bars do not know of it; output error does not have this bias."
)
EXPLAINED: Final = "Share of each coefficient's motion that its terms explain: {shares}."
LITTLE: Final = "{coefficient}: its terms explain {share:.0%} of its motion; its estimates are doubtful"
FAIR: Final = 0.5  #: of the motion explained


def equation_error(
    vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window], options: Options, *_: Any
) -> Fit:
    """Fit the free terms to smoothed samples; a method of `stoop.estimate.methods`."""
    if vehicle.hovers:
        return of_rotors(*estimation_problem(vehicle, flights, windows, options), options.method)
    return _fitted(vehicle, flights, windows, options, Time(), "on smoothed samples")


def frequency_domain(
    vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window], options: Options, *_: Any
) -> Fit:
    """Fit the free terms to Fourier coefficients of a band; a method of `stoop.estimate.methods`."""
    if vehicle.hovers:
        raise IdentificationError(
            f"{vehicle.where}: frequency-domain regression is for aircraft; use --method equation-error or multiple-shooting"
        )
    band = Band()
    where = f"on Fourier coefficients from {band.low:g} to {band.high:g} Hz, where residuals count as white"
    return _fitted(vehicle, flights, windows, options, band, where)


def _fitted(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    options: Options,
    domain: Domain,
    where: str,
) -> Fit:
    others = _other_numbers(vehicle)
    problem, prepared = estimation_problem(vehicle.with_numbers(others), flights, windows, options)
    found = regressed(problem.layout, problem.pieces, domain)
    if found is None:
        raise IdentificationError(
            f"{vehicle.where}: no regression is possible: a term must be free, and airspeed, flow angles, rates, attitude and "
            "accelerations measured together for some seconds; use --method output-error"
        )
    layout, solved = problem.layout, found.solved
    values = {layout.parameters[i].name: float(v) for i, v in zip(found.places, solved.values, strict=True)}
    warnings = (*_untouched(others), *_poorly_explained(found))
    white = _covariance(layout, found, solved.white) if domain.sees_color else None
    texts = (HOW.format(where=where), EXPLAINED.format(shares=_shares(found)))
    notices = (
        *(notice("untyped-fit-note", text=text) for text in texts),
        *(notice("untyped-warning", text=text) for text in warnings),
    )
    return regressed_fit(
        problem, prepared, values, _covariance(layout, found, solved.covariance), options.method, notices,
        white,
    )  # fmt: skip


def _covariance(layout: Layout, found: Regressed, solved: FloatArray) -> FloatArray:
    """Return the covariance of all free parameters; zero rows for what was not estimated.

    What no row tells has infinite variance.
    """
    own = solved.copy()
    untold = np.flatnonzero(np.isnan(np.diag(own)))
    own[untold, untold] = np.inf
    out = np.zeros((layout.dimension, layout.dimension))
    out[np.ix_(found.places, found.places)] = own
    return out


def _other_numbers(vehicle: Vehicle) -> dict[str, dict[str, Any]]:
    """Return what holds the free numbers that are neither terms nor biases: a regression says nothing of them."""
    free = [p.name for p in vehicle.parameters if p.free and "." in p.name]
    return {name: {"free": False} for name in free if not name.endswith(".bias")}


def _untouched(others: Iterable[str]) -> Iterator[str]:
    names = ", ".join(others)
    if names:
        yield f"{names}: no aerodynamic terms, so held at the file's values"


def _poorly_explained(found: Regressed) -> Iterator[str]:
    for coefficient, share in found.solved.r2.items():
        if share < FAIR:
            yield LITTLE.format(coefficient=coefficient, share=max(share, 0.0))


def _shares(found: Regressed) -> str:
    return ", ".join(f"{c} {100.0 * share:.1f} %" for c, share in found.solved.r2.items())
