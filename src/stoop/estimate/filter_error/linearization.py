"""Linear models of one sample at points of a flight, by central differences of the vehicle's own equations.

A piece is linearized at what was measured, or at the states that a filter found.

Axes: b = candidate, r = point, k = sample, e = number of a perturbation (:attr:`stoop.kernels.SymbolicModel.moves`),
i = reading.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.base.rotations import quaternions_of
from stoop.base.variables import WRAPPED
from stoop.errors import IdentificationError
from stoop.kernels import filtering
from stoop.problem import Misfit, Piece
from stoop.simulation import initial_states, parameter_rows
from stoop.simulation.delays import delayed, output_delays
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import noise_input

STEP: Final = 1e-4  #: rad, rad/s
SPEED_STEP: Final = 1e-2  #: m/s


@dataclass(frozen=True, eq=False)
class LinearModels:
    """How a small perturbation propagates over one sample.

    Attributes
    ----------
    transition : (B, r, n_e, n_e)
    readings : (B, r, n_y, n_e)
        Effect of a perturbation on the readings, before it has propagated.
    drive : (B, r, n_e, n_w)
        The perturbation by one unit of noise, held over the sample.
    """

    transition: FloatArray
    readings: FloatArray
    drive: FloatArray

    def of(self, models: IntArray) -> LinearModels:
        """Return the linear models of candidates that share them."""
        return LinearModels(self.transition[models], self.readings[models], self.drive[models])


@dataclass(frozen=True, eq=False)
class Points:
    """Points of linearization of a piece: states (n_x, r) and inputs (n_u, r)."""

    states: FloatArray
    inputs: FloatArray


def linearized(
    vehicle: Vehicle, rows: FloatArray, states: FloatArray, inputs: FloatArray, dt: float
) -> LinearModels:
    """Return the linear models of every candidate at every point.

    Parameters
    ----------
    rows : (n_p, B)
        Kernel parameters.
    states : (n_x, r, B)
    inputs : (n_u, r)
    dt : float, s
    """
    kernel = vehicle.kernel()
    steps = perturbation_steps(vehicle)
    noise = [vehicle.inputs.index(noise_input(a)) for a in vehicle.gusts]
    nx, r, count = states.shape
    ne, nw = len(steps), len(noise)
    changes = np.concatenate([np.zeros((ne, 1)), np.diag(steps), -np.diag(steps), np.zeros((ne, nw))], axis=1)
    many = changes.shape[1]
    shape = (many, r, count)
    x = np.broadcast_to(states[:, None], (nx, *shape)).reshape(nx, -1)
    d = np.broadcast_to(changes[:, :, None, None], (ne, *shape)).reshape(ne, -1)
    u = np.repeat(np.broadcast_to(inputs[:, None, :, None], (len(inputs), many, r, 1)), count, axis=3)
    u[noise, np.arange(1 + 2 * ne, many)] = 1.0
    u = u.reshape(len(inputs), -1)
    p = np.broadcast_to(rows[:, None, None, :], (len(rows), *shape)).reshape(len(rows), -1)
    after, readings = filtering.step(kernel, p, filtering.move(kernel, x, d), u, u, dt)
    after, readings = after.reshape(nx, *shape), readings.reshape(-1, *shape)
    inverse = perturbations_of(vehicle, after[:, 0])
    up, down = (slice(None), slice(1, 1 + ne)), (slice(None), slice(1 + ne, 1 + 2 * ne))
    state_slopes = (after[up] - after[down]) / (2.0 * steps[:, None, None])
    reading_slopes = (readings[up] - readings[down]) / (2.0 * steps[:, None, None])
    driven = after[:, 1 + 2 * ne :] - after[:, :1]
    return LinearModels(
        np.einsum("exrb,xfrb->bref", inverse, state_slopes),
        np.ascontiguousarray(np.transpose(reading_slopes, (3, 2, 0, 1))),
        np.einsum("exrb,xwrb->brew", inverse, driven),
    )


def perturbation_steps(vehicle: Vehicle) -> FloatArray:
    """Return the size (n_e,) of the differences."""
    speeds = [name in ("u", "v", "w") or name.startswith("gust.") for name in vehicle.moves]
    return np.where(speeds, SPEED_STEP, STEP)


def perturbations_of(vehicle: Vehicle, states: FloatArray) -> FloatArray:
    """Return what makes perturbations (n_e, n_x, ...) of small differences of states (n_x, ...).

    The columns by which single perturbations change a state are orthogonal.
    """
    kernel, steps, (nx, *shape) = vehicle.kernel(), perturbation_steps(vehicle), states.shape
    flat = states.reshape(nx, -1)
    out = np.empty((len(steps), *flat.shape))
    for e, step in enumerate(steps):
        change = np.zeros((len(steps), flat.shape[1]))
        change[e] = step
        column = (filtering.move(kernel, flat, change) - filtering.move(kernel, flat, -change)) / (2.0 * step)
        out[e] = column / np.sum(column**2, axis=0)
    return out.reshape(len(steps), nx, *shape)


def refuse_free_delays(problem: Misfit) -> None:
    """Refuse a free delay of a sensor: readings are shifted by it before the fit.

    Raises
    ------
    IdentificationError
        With the option to write.
    """
    vehicle = problem.layout.vehicle
    late = {vehicle.parameters[row].name for _, row in output_delays(vehicle)}
    for p in problem.layout.parameters:
        if p.name in late:
            raise IdentificationError(
                f"{vehicle.where}: {p.name}: this method shifts readings by a delay that is known; use --fix {p.name}"
            )


def undelayed(problem: Misfit, piece: Piece) -> Piece:
    """Shift readings of late sensors to when they were true: a filter corrects the state of its own time."""
    vehicle, measured = problem.layout.vehicle, piece.measured.copy()
    rows = parameter_rows(vehicle, piece.changes)
    for channel, row in output_delays(vehicle):
        column = measured[:, channel]
        if np.isfinite(column).any() and rows[row, 0] != 0.0:
            whole = unwrapped(column) if vehicle.outputs[channel] in WRAPPED else column
            measured[:, channel] = delayed(whole, -float(rows[row, 0]) / piece.dt)
    return replace(piece, measured=measured)


def unwrapped(column: FloatArray) -> FloatArray:
    """Return an angle (n,) without jumps; NaN where it was not measured."""
    out, present = column.copy(), np.isfinite(column)
    out[present] = np.unwrap(column[present])
    return out


def interpolated(values: FloatArray) -> FloatArray:
    """Return values (n,) with straight lines where nothing was measured."""
    present = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), present, values[present])


def measured_points(problem: Misfit, piece: Piece, points: IntArray) -> Points:
    """Return mean measured states around each point, where `points` (n,) is that of each sample; else the start."""
    vehicle = problem.layout.vehicle
    start = {name: np.full(len(points), value) for name, value in piece.start.items()}
    for i, channel in enumerate(vehicle.outputs):
        if channel in start and np.isfinite(piece.measured[:, i]).any():
            start[channel] = interpolated(unwrapped(piece.measured[:, i]))

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(points, values) / np.bincount(points)

    rows = parameter_rows(vehicle, piece.changes)
    means = {name: mean(values) for name, values in start.items()}
    inputs = np.array([mean(column) for column in piece.inputs.T])
    states = [
        initial_states(vehicle, {n: m[r] for n, m in means.items()}, rows, inputs[:, r])
        for r in range(inputs.shape[1])
    ]
    return Points(np.concatenate(states, axis=1), inputs)


def averaged(vehicle: Vehicle, states: FloatArray, points: IntArray) -> FloatArray:
    """Return the mean states (n_x, r, B) around each point of states (B, n, n_x).

    Quaternions on the way do not average to an attitude, but where down is does; the heading does not matter to a
    linear model in body axes.
    """
    first = np.flatnonzero(np.diff(points, prepend=-1))
    counts = np.diff(np.append(first, len(points)))[:, None]

    def mean(columns: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(columns, first, axis=1) / counts)

    with np.errstate(over="ignore", invalid="ignore"):  # a candidate that diverges is a value
        out = np.moveaxis(mean(states), 2, 0)
        zero = np.zeros(states.shape[:2])
        at = {name: i for i, name in enumerate(vehicle.states)}
        e0, e1, e2, e3 = (states[:, :, at[n]] if n in at else zero for n in ("e0", "e1", "e2", "e3"))
        downs = [2 * (e1 * e3 - e0 * e2), 2 * (e2 * e3 + e0 * e1), e0**2 - e1**2 - e2**2 + e3**2]
        down = mean(np.stack(downs, axis=2))
        phi = np.arctan2(down[:, :, 1], down[:, :, 2])
        theta = np.arctan2(-down[:, :, 0], np.hypot(down[:, :, 1], down[:, :, 2]))
        level = quaternions_of(np.stack([phi, theta, np.zeros_like(phi)], axis=-1))
        for i in range(4):
            if f"e{i}" in at:
                out[at[f"e{i}"]] = level[..., i]
        return np.ascontiguousarray(np.swapaxes(out, 1, 2))
