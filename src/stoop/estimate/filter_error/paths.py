"""Where a piece is linearized: at what was measured, or at the states that a filter found.

Axes: k = sample, r = point, b = candidate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of
from stoop.base.variables import WRAPPED
from stoop.problem import Misfit, Piece
from stoop.simulate import initial_states, parameter_rows
from stoop.simulate.delays import delayed, output_delays
from stoop.vehicle import Vehicle

IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Path:
    """Points of linearization of a piece: states (n_x, r) and inputs (n_u, r)."""

    states: FloatArray
    inputs: FloatArray


def undelayed(problem: Misfit, piece: Piece) -> Piece:
    """Move readings of late sensors to when they were true: a filter corrects the state of its own time."""
    vehicle, measured = problem.layout.vehicle, piece.measured.copy()
    rows = parameter_rows(vehicle, piece.changes)
    for channel, row in output_delays(vehicle):
        column = measured[:, channel]
        seen = np.isfinite(column)
        if seen.any() and rows[row, 0] != 0.0:
            turned = unwrapped(column) if vehicle.outputs[channel] in WRAPPED else column
            measured[:, channel] = delayed(turned, -float(rows[row, 0]) / piece.dt)
    return replace(piece, measured=measured)


def unwrapped(column: FloatArray) -> FloatArray:
    """Return an angle (n,) without jumps; NaN where it was not measured."""
    out, seen = column.copy(), np.isfinite(column)
    out[seen] = np.unwrap(column[seen])
    return out


def measured_path(problem: Misfit, piece: Piece, points: IntArray) -> Path:
    """Return mean measured states around each point; where nothing was measured, the start."""
    vehicle = problem.layout.vehicle
    start = {name: np.full(len(points), value) for name, value in piece.start.items()}
    for i, channel in enumerate(vehicle.outputs):
        if channel in start and np.isfinite(piece.measured[:, i]).any():
            start[channel] = filled(unwrapped(piece.measured[:, i]))
    rows = parameter_rows(vehicle, piece.changes)
    mean = {name: _mean(points, values) for name, values in start.items()}
    inputs = np.array([_mean(points, column) for column in piece.inputs.T])
    states = [
        initial_states(vehicle, {n: m[r] for n, m in mean.items()}, rows, inputs[:, r])
        for r in range(inputs.shape[1])
    ]
    return Path(np.concatenate(states, axis=1), inputs)


def filled(values: FloatArray) -> FloatArray:
    """Return values (n,) with straight lines where nothing was measured."""
    seen = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), seen, values[seen])


def _mean(points: IntArray, values: FloatArray) -> FloatArray:
    """Return the mean of values (n,) of the samples that belong to each point."""
    return np.bincount(points, values) / np.bincount(points)


def averaged(vehicle: Vehicle, states: FloatArray, points: IntArray) -> FloatArray:
    """Return the mean states (n_x, r, B) around each point of states (B, n, n_x).

    Quaternions on the way do not average to an attitude, but where down is does; the heading does not matter to a
    linear model in body axes.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a candidate that diverges is a value
        return _averaged(vehicle, states, points)


def _averaged(vehicle: Vehicle, states: FloatArray, points: IntArray) -> FloatArray:
    first = np.flatnonzero(np.diff(points, prepend=-1))
    counts = np.diff(np.append(first, len(points)))[:, None]

    def mean(columns: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(columns, first, axis=1) / counts)

    out = np.moveaxis(mean(states), 2, 0)
    zero = np.zeros(states.shape[:2])
    at = {name: i for i, name in enumerate(vehicle.states)}
    e0, e1, e2, e3 = (states[:, :, at[n]] if n in at else zero for n in ("e0", "e1", "e2", "e3"))
    downs = np.stack(
        [2 * (e1 * e3 - e0 * e2), 2 * (e2 * e3 + e0 * e1), e0**2 - e1**2 - e2**2 + e3**2], axis=2
    )
    down = mean(downs)
    phi = np.arctan2(down[:, :, 1], down[:, :, 2])
    theta = np.arctan2(-down[:, :, 0], np.hypot(down[:, :, 1], down[:, :, 2]))
    level = quaternions_of(np.stack([phi, theta, np.zeros_like(phi)], axis=-1))
    for i in range(4):
        if f"e{i}" in at:
            out[at[f"e{i}"]] = level[..., i]
    return np.ascontiguousarray(np.swapaxes(out, 1, 2))
