"""The free aerodynamic terms of a vehicle by regression, in whichever domain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.domain import Domain
from stoop.estimate.regression.history import ESTIMATED, History, histories, term_values
from stoop.estimate.regression.least_squares import Block, Priors, Solved, solve
from stoop.problem import Layout, Piece
from stoop.vehicle import Parameter

Bounds = tuple[FloatArray, FloatArray]
GONE: Final = 1e-9  #: of a column is rounding: the domain took the rest away


@dataclass(frozen=True, eq=False)
class Regressed:
    """Estimates of the terms of a vehicle.

    Attributes
    ----------
    places : tuple of int
        Where the k parameters stand in the layout.
    solved : Solved
    histories : tuple of History
    """

    places: tuple[int, ...]
    solved: Solved
    histories: tuple[History, ...]


def boxed(parameters: Sequence[Parameter]) -> Bounds:
    """Return the bounds of the file."""
    return np.array([p.lower for p in parameters]), np.array([p.upper for p in parameters])


def unbounded(parameters: Sequence[Parameter]) -> Bounds:
    """Return no bounds."""
    return np.full(len(parameters), -np.inf), np.full(len(parameters), np.inf)


def regressed(
    layout: Layout,
    pieces: Sequence[Piece],
    domain: Domain,
    within: Callable[[Sequence[Parameter]], Bounds] = unbounded,
) -> Regressed | None:
    """Estimate the free aerodynamic terms; None where no term is free or the motion was not measured.

    Numbers that are no terms stay as the file has them. A constant that the domain does not see is found
    afterwards, from the means.
    """
    if not layout_places(layout):
        return None
    return from_histories(layout, [h for p in pieces for h in histories(layout.vehicle, p)], domain, within)


def from_histories(
    layout: Layout,
    found: Sequence[History],
    domain: Domain,
    within: Callable[[Sequence[Parameter]], Bounds] = unbounded,
) -> Regressed | None:
    """Do the same where the coefficients are already known; the equations of the vehicle are not needed."""
    places = layout_places(layout)
    blocks = [b for h in found for b in _blocks(layout, places, h)]
    parameters = [layout.parameters[i] for i in places]
    bounds = within(parameters)
    priors = priors_of(parameters)
    turned = [t for b in blocks if (t := _turned(b, domain)).y.size]
    if not turned:
        return None
    solved = solve(turned, bounds, priors, domain)
    if not domain.holds_constants:
        solved = _with_constants(solved, blocks, constants(layout, places), bounds)
    return Regressed(places, solved, tuple(found))


def layout_places(layout: Layout) -> tuple[int, ...]:
    """Return where the aerodynamic terms stand among the free parameters."""
    return tuple(i for i, p in enumerate(layout.parameters) if "." not in p.name)


def priors_of(parameters: Sequence[Parameter]) -> Priors:
    """Return what the file believes of them."""
    value = np.array([p.value for p in parameters])
    return Priors(value, np.array([np.inf if p.prior is None else p.prior for p in parameters]))


def _turned(block: Block, domain: Domain) -> Block:
    both = domain.rows(np.column_stack([block.y, block.X]), block.dt)
    X = both[:, 1:]
    X[:, np.linalg.norm(X, axis=0) <= GONE * np.linalg.norm(block.X, axis=0)] = 0.0
    return Block(block.coefficient, both[:, 0], X, block.dt)


def _blocks(layout: Layout, places: Sequence[int], history: History) -> list[Block]:
    """Return the samples of each coefficient, less what terms that are not free contribute."""
    both = contributions(layout, places, history.coefficients, history.variables)
    names = ESTIMATED[layout.vehicle.reduce]
    return [Block(c, y, X, history.dt) for c, (y, X) in zip(names, both, strict=True)]


def contributions(
    layout: Layout,
    places: Sequence[int],
    coefficients: Mapping[str, FloatArray],
    variables: Mapping[str, FloatArray],
) -> list[tuple[FloatArray, FloatArray]]:
    """Return for each coefficient what the free terms must explain (n,), and what each contributes (n, k)."""
    vehicle = layout.vehicle
    column = {vehicle.rows[layout.parameters[i].name]: k for k, i in enumerate(places)}
    out = []
    for coefficient in ESTIMATED[vehicle.reduce]:
        y = coefficients[coefficient].copy()
        X = np.zeros((len(y), len(places)))
        for name, text in vehicle.terms[coefficient].items():
            row, values = vehicle.rows[name], term_values(text, variables, len(y))
            if row in column:
                X[:, column[row]] += values
            else:
                y -= vehicle.values[row] * values
        out.append((y, X))
    return out


def constants(layout: Layout, places: Sequence[int]) -> dict[str, int]:
    """Return which parameter is the constant of which coefficient."""
    names = {layout.parameters[i].name: k for k, i in enumerate(places)}
    return {
        c: names[n]
        for c, group in layout.vehicle.terms.items()
        for n, text in group.items()
        if n in names and text.strip() == "1"
    }


def _with_constants(
    solved: Solved, blocks: Sequence[Block], constants: dict[str, int], bounds: Bounds
) -> Solved:
    """Find constants from what the other terms leave of the means; their errors come from those of the others."""
    values, covariance = solved.values.copy(), np.nan_to_num(solved.covariance)
    untold = np.isnan(np.diag(solved.covariance))
    untold[list(constants.values())] = False
    lost = untold.copy()
    for coefficient, place in constants.items():
        own = [b for b in blocks if b.coefficient == coefficient]
        y, X = np.concatenate([b.y for b in own]), np.concatenate([b.X for b in own])
        X[:, place] = 0.0
        values[place] = np.clip(np.mean(y - X @ values), bounds[0][place], bounds[1][place])
        # noise of the mean itself is white noise's: the slow part of it is in the residual of the band
        mean, noise = X.mean(axis=0), float(np.var(y - X @ values) / len(y))
        along = -(covariance @ mean)
        covariance[place, :], covariance[:, place] = along, along
        covariance[place, place] = mean @ covariance @ mean + noise
        lost[place] = bool(np.any(mean[untold] != 0.0))  # what stood still off zero is one with the constant
    covariance[lost, :] = covariance[:, lost] = np.nan
    return Solved(values, covariance, solved.white, solved.sigma, solved.r2)
