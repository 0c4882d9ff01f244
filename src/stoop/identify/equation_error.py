"""Equation error: aerodynamic terms by linear regression of measured accelerations on measured states.

Biased by noise in the regressors, but it needs no start and no integration: a good first scout.
Klein and Morelli, Aircraft System Identification, 2nd ed., chapter 5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stoop.cost import Layout, Piece
from stoop.flight.segments import runs
from stoop.flight.smoothing import smooth_derivative
from stoop.simulate import initial_states, parameter_rows
from stoop.vehicle import Vehicle

FloatArray = NDArray[np.float64]
_RATES = ("p", "q", "r")
_FORCES = ("ax", "ay", "az")


def equation_error(layout: Layout, pieces: tuple[Piece, ...]) -> FloatArray | None:
    """Return free parameters (D,) in the unit box, or None where states were not all measured.

    The equations are the vehicle's own: accelerations are linear in the aerodynamic terms, so their
    derivatives by finite steps of one are exact. Numbers that are no aerodynamic terms stay as in the file.
    """
    from scipy.optimize import lsq_linear

    vehicle = layout.vehicle
    linear = [i for i, p in enumerate(layout.parameters) if "." not in p.name]
    if not linear or not all(_measured(vehicle, p) for p in pieces):
        return None
    blocks = [_regression(layout, piece, linear) for piece in pieces]
    A, b = np.concatenate([m for m, _ in blocks]), np.concatenate([y for _, y in blocks])
    size = np.linalg.norm(A, axis=0)
    linear, A, size = (
        [i for i, s in zip(linear, size, strict=True) if s > 0.0],
        A[:, size > 0.0],
        size[size > 0.0],
    )
    lower = np.array([layout.parameters[i].lower for i in linear])
    upper = np.array([layout.parameters[i].upper for i in linear])
    found = lsq_linear(A / size, b, bounds=(lower * size, upper * size)).x / size
    values = np.array([p.value for p in layout.parameters])
    values[linear] = found
    return layout.unit(values) if np.isfinite(values).all() else None


def _measured(vehicle: Vehicle, piece: Piece) -> bool:
    return bool(_complete(vehicle, piece).mean() > 0.9)


def _complete(vehicle: Vehicle, piece: Piece) -> NDArray[np.bool_]:
    """Return the samples (n,) at which all that the equations need was measured."""
    needed = [i for i, c in enumerate(vehicle.outputs) if c != "psi"]
    return np.asarray(np.isfinite(piece.measured[:, needed]).all(axis=1))


def _turning(rate: FloatArray, kept: NDArray[np.bool_], dt: float) -> FloatArray:
    """Differentiate a rate over each stretch without a hole; return the kept samples."""
    out = np.zeros_like(rate)
    for run in runs(kept):
        out[run] = smooth_derivative(rate[run], dt) if run.stop - run.start > 2 else 0.0
    return out[kept]


def _equations(vehicle: Vehicle) -> tuple[list[int], list[int], list[int]]:
    """Return rows of the state derivatives and of the readings that are regressed, and channels of the rates."""
    rates = [c for c in _RATES if c in vehicle.outputs]
    forces = [vehicle.outputs.index(c) for c in _FORCES if c in vehicle.outputs]
    return [vehicle.states.index(c) for c in rates], forces, [vehicle.outputs.index(c) for c in rates]


def _regression(layout: Layout, piece: Piece, linear: list[int]) -> tuple[FloatArray, FloatArray]:
    """Return the regressors (m, k) and the measured side (m,), each equation scaled by its spread."""
    vehicle = layout.vehicle
    kept = _complete(vehicle, piece)
    z, u = piece.measured[kept], piece.inputs[kept].T
    states, forces, rates = _equations(vehicle)
    start = {c: np.nan_to_num(z[:, i]) for i, c in enumerate(vehicle.outputs) if c not in _FORCES}
    held = {c: np.full(len(z), piece.start[c]) for c in ("V", "alpha", "theta", "h")}
    start = {**held, **start}

    def accelerations(changes: dict[str, float]) -> FloatArray:
        rows = parameter_rows(vehicle, {**piece.changes, **changes}, len(z))
        x = initial_states(vehicle, start, rows, u)
        d, y = vehicle.kernel().evaluate(rows, x, np.ascontiguousarray(u))
        return np.concatenate([d[states], y[forces]])

    names = [layout.parameters[i].name for i in linear]
    zero = accelerations(dict.fromkeys(names, 0.0))
    columns = [accelerations({**dict.fromkeys(names, 0.0), n: 1.0}) - zero for n in names]
    turning = [_turning(piece.measured[:, i], kept, piece.dt) for i in rates]
    wanted = np.concatenate([np.array(turning).reshape(len(rates), -1), z[:, forces].T]) - zero
    spread = np.maximum(np.std(wanted, axis=1, keepdims=True), 1e-9)
    return np.stack([(c / spread).ravel() for c in columns], axis=1), (wanted / spread).ravel()
