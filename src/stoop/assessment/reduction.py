"""What a reduced model neglects: how far the states that it holds moved in the record, and which parameters that biases.

A longitudinal or lateral model holds the other plane's motion at its start. The equations of the whole vehicle are evaluated
along the record twice: with the held states as recorded, and as the reduced model holds them. The difference d of the rates of
the outputs that the model keeps (and of the specific forces) is what the reduced equations lack. Projected on their
sensitivities to the parameters, it predicts by how much each estimate is off,

    delta = (sum J' J)^-1 sum J' d,

the bias of least squares by omitted variables (Klein and Morelli, *Aircraft System Identification*, 2nd ed., 2016, section
5.1.4). Each equation counts by the size of what moves in it. States that were not recorded stay held. The prediction is linear
and at the estimates: of a bias of a fifth it tells about half.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.numbers import factor_and_unit
from stoop.base.variables import SPECIFIC_FORCE, VARIABLES
from stoop.estimate.fit import Fit
from stoop.flight import Flight
from stoop.problem import Piece, on_circle
from stoop.problem.observation import along_body
from stoop.simulation import START_NAMES, initial_states, parameter_rows
from stoop.simulation.initial import rigid_states
from stoop.vehicle import Vehicle

TIME_STEP: Final = 1e-5  #: s, of the derivative of an output along the motion
SHARE: Final = 1e-4  #: of a parameter's size, of a difference
MIN_SINGULAR: Final = (
    1e-3  #: of the largest, of scaled sensitivities: what the data do not tell has no bias to predict
)
MIN_BIAS: Final = (
    2.0  #: standard errors of a predicted bias that is told: noise of the held states reaches one
)


@dataclass(frozen=True, eq=False)
class NeglectedMotion:
    """Largest departure of each recorded state from what the model holds, SI, and the bias of each parameter, SI."""

    departures: Mapping[str, float]
    biases: Mapping[str, float]


def reduction_notices(fit: Fit, flights: Mapping[str, Flight], bars: ErrorBars) -> list[Notice]:
    """Return what a reduced model neglects where that biases a parameter by more than two standard errors."""
    vehicle = fit.problem.layout.vehicle
    if vehicle.reduce == "full":
        return []
    found = neglected_motion(fit, flights)
    errors = dict(zip(fit.estimates, bars.std.tolist(), strict=False))
    ratios = {n: b / errors[n] for n, b in found.biases.items() if errors[n] > 0.0}
    large = sorted((n for n, r in ratios.items() if abs(r) > MIN_BIAS), key=lambda n: -abs(ratios[n]))
    if not large:
        return []
    moved = []
    for name, size in found.departures.items():
        factor, unit = factor_and_unit(VARIABLES[name].unit)
        moved.append(f"{name} by {factor * size:.2g} {unit}")
    changes = tuple(found.biases[n] / abs(fit.estimates[n]) for n in large)
    sigmas = tuple(ratios[n] for n in large)
    values = {"parameters": tuple(large), "changes": changes, "sigmas": sigmas}
    return [notice("reduced-model-biased", vehicle.reduce, moved=tuple(moved), **values)]


def neglected_motion(fit: Fit, flights: Mapping[str, Flight]) -> NeglectedMotion:
    """Return what the held states did in the record of a fit, and the bias that it predicts."""
    reduced = fit.problem.layout.vehicle
    whole = reduced.reduced("full").with_numbers({n: {"value": v} for n, v in fit.estimates.items()})
    names, departures, lack, slopes = list(fit.estimates), dict[str, float](), [], []
    for piece in fit.problem.pieces:
        flight = flights[fit.prepared.windows[piece.maneuver].flight]
        recorded, held, inputs = _motions(reduced, whole, piece, flight)
        for name in (n for n in recorded if n not in reduced.outputs and n in flight.data):
            size = float(np.max(np.abs(recorded[name] - held[name]), initial=0.0))
            departures[name] = max(departures.get(name, 0.0), size)
        if not inputs.shape[1] or not departures:
            continue
        rows = parameter_rows(whole, piece.changes, inputs.shape[1])
        base = _rates(reduced, whole, rows, held, inputs)
        scale = np.std(base, axis=1, keepdims=True)
        weight = np.where(scale > 0.0, 1.0 / np.where(scale > 0.0, scale, 1.0), 0.0)
        lack.append((weight * (_rates(reduced, whole, rows, recorded, inputs) - base)).ravel())
        columns = []
        for name in names:
            changed, row = rows.copy(), whole.rows[name]
            step = SHARE * max(abs(float(rows[row, 0])), 1e-3)
            changed[row] += step
            columns.append((weight * (_rates(reduced, whole, changed, held, inputs) - base)).ravel() / step)
        slopes.append(np.column_stack(columns))
    if not lack:
        return NeglectedMotion(departures, {})
    J = np.concatenate(slopes)
    size = np.linalg.norm(J, axis=0)
    size[size == 0.0] = 1.0
    solution = np.linalg.lstsq(J / size, np.concatenate(lack), rcond=MIN_SINGULAR)[0] / size
    return NeglectedMotion(departures, dict(zip(names, solution.tolist(), strict=True)))


def _motions(
    reduced: Vehicle, whole: Vehicle, piece: Piece, flight: Flight
) -> tuple[dict[str, FloatArray], dict[str, FloatArray], FloatArray]:
    """Return the motion (n,) as recorded, with the held states held, and the inputs (n_u, n), at the complete samples."""
    at = np.clip(np.searchsorted(flight.time, piece.time - 0.5 * piece.dt), 0, len(flight.time) - 1)
    held = {n: np.full(len(at), float(piece.start.get(n, 0.0))) for n in whole.start_names}
    known = [n for n in START_NAMES if n in flight.data and np.isfinite(flight.column(n)[at]).any()]
    recorded = held | along_body(whole, {n: flight.column(n)[at] for n in known})
    held |= {n: recorded[n] for n in known if n in reduced.outputs}
    inputs = np.zeros((len(whole.inputs), len(at)))
    for i, name in enumerate(whole.recorded):
        inputs[i] = (
            flight.column(name)[at] if name in flight.data else 0.0
        )  # it cancels but for its cross terms
    there = np.isfinite([*recorded.values(), *held.values(), *inputs]).all(axis=0)
    parts = ({n: v[there] for n, v in motion.items()} for motion in (recorded, held))
    first, second = parts
    return first, second, np.ascontiguousarray(inputs[:, there])


def _rates(
    reduced: Vehicle, whole: Vehicle, rows: FloatArray, motion: Mapping[str, FloatArray], inputs: FloatArray
) -> FloatArray:
    """Return the rates (m, n) of the outputs that the reduced model keeps, and its specific forces."""
    kernel = whole.kernel()
    states = initial_states(whole, {}, rows, inputs, rigid_states(motion))
    change, now = kernel.evaluate(rows, states, inputs)
    _, later = kernel.evaluate(rows, states + TIME_STEP * change, inputs)
    difference = on_circle((later - now).T.copy(), whole.outputs).T / TIME_STEP
    place = {name: i for i, name in enumerate(whole.outputs)}
    return np.array([(now if n in SPECIFIC_FORCE else difference)[place[n]] for n in reduced.outputs])
