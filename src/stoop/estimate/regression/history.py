"""Histories of the nondimensional coefficients, from measured accelerations and rates.

The equations are the vehicle's own, compiled: specific force and angular acceleration are linear in the
coefficients, so what a coefficient of one adds to them, and what is there without any, is found by evaluating
them. Solving them sample by sample gives the coefficients that were flown (Klein and Morelli, section 5.1;
there the equations are written out and solved by hand).

Rates are differentiated by a cubic spline through every sample, which smooths nothing: in place of a filter
that would delay or flatten one side of the equation, whatever linear operation follows - a window, a Fourier
transform - is applied to the coefficients and to the terms alike. The derivative is exact to
(omega dt)^4 / 180.

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., Sunflyte, 2016.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from stoop.base.arrays import FloatArray, run_slices
from stoop.estimate.regression.measured import FORCES, RATES, Measured, complete, measured, states
from stoop.flight.segmentation import MIN_SEGMENT
from stoop.problem import Piece
from stoop.vehicle import Vehicle, terms
from stoop.vehicle.schema import Term

ESTIMATED: Final = {
    "full": ("CL", "CD", "CQ", "Cl", "Cm", "Cn"), "longitudinal": ("CL", "CD", "Cm"), "lateral": ("CQ", "Cl", "Cn"),
}  #: by what the file reduces to; as many as there are accelerations  # fmt: skip
FEWEST: Final = 8  #: samples of a stretch


@dataclass(frozen=True, eq=False)
class History:
    """One stretch of a maneuver without a hole, n samples.

    Attributes
    ----------
    maneuver : int
    time : (n,), s
        The log's own clock.
    dt : float, s
    coefficients : mapping
        ``CL`` ... -> (n,)
    variables : mapping
        What terms are made of (:data:`stoop.vehicle.terms.STATE_VARIABLES`, controls) -> (n,).
    """

    maneuver: int
    time: FloatArray
    dt: float
    coefficients: Mapping[str, FloatArray]
    variables: Mapping[str, FloatArray]

    def regressor(self, text: str) -> FloatArray:
        """Return a term (n,) of these names."""
        return term_values(text, self.variables, len(self.time))


def term_values(text: str, made_of: Mapping[str, FloatArray], count: int) -> FloatArray:
    """Return a term (n,) of variables (n,) each."""
    return np.full(count, terms.convert(_tree(text, frozenset(made_of)), made_of), dtype=float)


@lru_cache(maxsize=1000)
def _tree(text: str, names: frozenset[str]) -> ast.expr:
    return terms.parse(text, names, "term")


def histories(vehicle: Vehicle, piece: Piece) -> tuple[History, ...]:
    """Return the coefficients of every stretch of a piece that has no hole and is long enough."""
    if not complete(vehicle, piece).any():
        return ()
    found = measured(vehicle, piece)
    base, gains = balance(vehicle, found)
    made_of = variables(vehicle, found)
    present = np.zeros(len(piece.time), dtype=np.bool_)
    present[found.kept] = True
    least = max(FEWEST, round(0.5 * MIN_SEGMENT / piece.dt))
    position = np.cumsum(present) - 1
    stretches = [slice(position[r.start], position[r.stop - 1] + 1) for r in run_slices(present)]
    return tuple(
        _history(vehicle, piece, found, base, gains, made_of, s)
        for s in stretches
        if s.stop - s.start >= least
    )


def _history(
    vehicle: Vehicle, piece: Piece, found: Measured, base: FloatArray, gains: FloatArray,
    variables: Mapping[str, FloatArray], s: slice,
) -> History:  # fmt: skip
    time = piece.time[found.kept[s]]
    turning = np.array(
        [CubicSpline(time, found.motion[c][s])(time, 1) for c in RATES if c in vehicle.outputs]
    )
    felt = {c: v[s] for c, v in found.readings.items()}
    return History(
        piece.maneuver,
        time,
        piece.dt,
        coefficients(vehicle, base[:, s], gains[:, :, s], turning, felt),
        {name: values[s] for name, values in variables.items()},
    )


def coefficients(
    vehicle: Vehicle, base: FloatArray, gains: FloatArray, turning: FloatArray, felt: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return the coefficients that explain measured accelerations.

    Parameters
    ----------
    base, gains : (a, n), (a, c, n)
        See :func:`balance`.
    turning : (r, n), rad/s2
        Angular accelerations about the axes that the vehicle observes.
    felt : mapping
        ``ax``, ``ay``, ``az`` -> (n,), m/s2, as read.
    """
    wanted = np.concatenate([turning, [felt[c] for c in FORCES if c in vehicle.outputs]]) - base
    solved = np.linalg.solve(gains.transpose(2, 0, 1), wanted.T[:, :, None])[:, :, 0]
    return dict(zip(ESTIMATED[vehicle.reduce], solved.T, strict=True))


def variables(vehicle: Vehicle, found: Measured) -> dict[str, FloatArray]:
    """Return what terms are made of -> (n,)."""

    def number(name: str) -> FloatArray:
        return np.asarray(found.rows[vehicle.rows[name]])

    m, actual = found.motion, vehicle.actual_rates
    return {**terms.values(number, actual, m["V"], m["alpha"], m["beta"], found.omega), **found.deflections}


def balance(vehicle: Vehicle, found: Measured) -> tuple[FloatArray, FloatArray]:
    """Return the accelerations (a, n) without aerodynamics, and what each coefficient adds to them (a, c, n)."""
    probed = _probed(vehicle)
    constants = _constants(probed)
    count, lanes = len(found.kept), 1 + len(constants)
    own = [n for c in ESTIMATED[vehicle.reduce] for n in getattr(probed.file.aerodynamics, c)]
    rows = np.repeat(probed.values[:, None], count, axis=1)
    for p in probed.parameters:
        if p.name in vehicle.rows:
            rows[probed.rows[p.name]] = found.rows[vehicle.rows[p.name]]
    rows[[probed.rows[n] for n in own]] = 0.0
    inputs = np.zeros((1, count))
    if probed.inputs != ("none",):
        inputs = np.ascontiguousarray(found.inputs[[vehicle.inputs.index(c) for c in probed.inputs]])
    x = states(probed, replace(found, rows=rows, inputs=inputs))
    rows = np.tile(rows, lanes)  # the first n lanes without aerodynamics, then n with each coefficient at one
    for i, name in enumerate(constants.values(), 1):
        rows[probed.rows[name], i * count : (i + 1) * count] = 1.0
    felt = _accelerations(probed, rows, np.tile(x, lanes), np.tile(inputs, lanes))
    cases = felt.reshape(len(felt), lanes, count)
    return cases[:, 0], cases[:, 1:] - cases[:, :1]


def _accelerations(vehicle: Vehicle, rows: FloatArray, x: FloatArray, inputs: FloatArray) -> FloatArray:
    d, y = vehicle.kernel().evaluate(rows, x, inputs)
    turning = [vehicle.states.index(c) for c in RATES if c in vehicle.outputs]
    felt = [vehicle.outputs.index(c) for c in FORCES if c in vehicle.outputs]
    return np.concatenate([d[turning], y[felt]])


def _constants(vehicle: Vehicle) -> dict[str, str]:
    """Return the name of a term that is constant, and tied to nothing, of each coefficient that has one."""
    targets = [q.tie for c in ESTIMATED["full"] for q in getattr(vehicle.file.aerodynamics, c).values()]
    out: dict[str, str] = {}
    for c in ESTIMATED[vehicle.reduce]:
        group: Mapping[str, Term] = getattr(vehicle.file.aerodynamics, c)
        alone = [n for n, t in group.items() if t.term.strip() == "1" and t.tie is None and n not in targets]
        out |= {c: alone[0]} if alone else {}
    return out


def _probed(vehicle: Vehicle) -> Vehicle:
    """Return a vehicle whose coefficients each have a constant term: itself, or one with nothing but constants."""
    estimated = ESTIMATED[vehicle.reduce]
    if len(_constants(vehicle)) == len(estimated):
        return vehicle
    constants = {c: {f"{c}0": Term(term="1")} for c in estimated}
    aerodynamics = vehicle.file.aerodynamics.model_copy(update=constants)
    return replace(vehicle, file=vehicle.file.model_copy(update={"aerodynamics": aerodynamics}))
