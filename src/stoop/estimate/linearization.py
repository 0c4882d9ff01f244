"""Linear models of one sample at points of a flight, by central differences of the vehicle's own equations.

A piece is linearized at what was measured, or at the states that a filter found.

Axes: b = candidate, r = point, e = number of a perturbation (:attr:`stoop.kernels.SymbolicModel.moves`), i = reading.
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
from stoop.problem.observation import recorded_motion
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import noise_input
from stoop.vehicle.delays import delayed, output_delays

GUARD: Final = 3  #: samples; further from an end its interpolation is as good as the noise


@dataclass(frozen=True, eq=False)
class LinearModels:
    """How a small perturbation propagates over one sample."""

    transition: FloatArray  #: (B, r, n_e, n_e)
    readings: FloatArray  #: (B, r, n_y, n_e), by a perturbation that has not propagated
    drive: FloatArray  #: (B, r, n_e, n_w), perturbation by one unit of noise, held over the sample


@dataclass(frozen=True, eq=False)
class Points:
    """Points of linearization of a piece: states (n_x, r) and inputs (n_u, r)."""

    states: FloatArray
    inputs: FloatArray


def linearized(
    vehicle: Vehicle, rows: FloatArray, states: FloatArray, inputs: FloatArray, dt: float
) -> LinearModels:
    """Return the linear models of every candidate at every point.

    Kernel parameters `rows` are (n_p, B), states (n_x, r, B), inputs (n_u, r); `dt` is in s.
    """
    kernel, steps = vehicle.kernel(), perturbation_steps(vehicle)
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
    # a candidate that diverges is a value
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        after, readings = kernel.step(p, filtering.move(kernel, x, d), u, u, dt)
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
    """Return the size (n_e,) of the differences: 0.01 m/s, 1e-4 rad or rad/s."""
    speeds = [name in ("u", "v", "w") or name.startswith("gust.") for name in vehicle.moves]
    return np.where(speeds, 1e-2, 1e-4)


def perturbation_columns(vehicle: Vehicle, states: FloatArray) -> FloatArray:
    """Return the derivatives (n_e, n_x, ...) of states (n_x, ...) by single perturbations."""
    steps, (nx, *shape) = perturbation_steps(vehicle), states.shape
    flat, changes = states.reshape(nx, 1, -1), np.concatenate([np.diag(steps), -np.diag(steps)], axis=1)
    many = len(steps), changes.shape[1], flat.shape[2]
    moved = filtering.move(
        vehicle.kernel(),
        np.broadcast_to(flat, (nx, *many[1:])).reshape(nx, -1),
        np.broadcast_to(changes[:, :, None], many).reshape(len(steps), -1),
    ).reshape(nx, 2, *many[::2])
    out = np.swapaxes((moved[:, 0] - moved[:, 1]) / (2.0 * steps[:, None]), 0, 1)
    return out.reshape(len(steps), nx, *shape)


def perturbations_of(vehicle: Vehicle, states: FloatArray) -> FloatArray:
    """Return what makes perturbations (n_e, n_x, ...) of small differences of states (n_x, ...).

    The columns by which single perturbations change a state are orthogonal.
    """
    columns = perturbation_columns(vehicle, states)
    return np.asarray(columns / np.sum(columns**2, axis=1, keepdims=True))


def aligned(problem: Misfit, z: FloatArray) -> Misfit:
    """Move the readings of late sensors ahead by whole samples, to when they were true with the search vector z (D + E,).

    What is left of a delay, within a sample, is for the model: interpolated readings would have noise that is not white.
    Readings that some delay within the bounds moves out of the record are left out, so that the same ones count with all.

    Raises
    ------
    IdentificationError
        The bounds of a delay leave less than half of the pieces together.
    """
    vehicle, pieces, left = problem.layout.vehicle, [], dict[str, int]()
    bounds = {p.name: (p.lower, p.upper) for p in problem.layout.parameters}
    for i, piece in enumerate(problem.pieces):
        measured, whole, (n, ny) = piece.measured.copy(), piece.whole.copy(), piece.measured.shape
        moved, rows = [*(piece.moved or [0] * ny)], problem.candidates(z[None, :], i)[0][:, 0] / piece.dt
        for column, row in output_delays(vehicle):
            name, late = vehicle.parameters[row].name, float(rows[row])
            if not piece.moved:
                ends = (late, late) if name not in bounds else np.divide(bounds[name], piece.dt)
                first, behind = max(0, round(ends[1])), n + min(0, round(ends[0]))
                left[name] = left.get(name, 0) + 2 * max(behind - first, 0) - n
                for own in (measured, whole):
                    own[:first, column] = own[behind:, column] = np.nan
            if not piece.moved or abs(late - moved[column]) > 1.0:
                for own in (measured, whole):
                    own[:, column] = np.roll(own[:, column], moved[column] - round(late))
                moved[column] = round(late)
        slow = None if piece.interpolated is None else whole
        pieces.append(replace(piece, measured=measured, interpolated=slow, moved=tuple(moved)))
    for name in (name for name, samples in left.items() if samples < -1):
        raise IdentificationError(
            f"{vehicle.where}: {name}: its bounds leave less than half of the maneuvers; narrow them"
        )
    return replace(problem, pieces=tuple(pieces))


def as_recorded(piece: Piece, readings: FloatArray) -> FloatArray:
    """Return simulated readings (n, n_y) of a piece as late as they were recorded."""
    late = zip(readings.T, piece.moved, strict=True)
    return np.column_stack([delayed(column, samples) for column, samples in late])


def undelayed(problem: Misfit) -> Misfit:
    """Shift the readings of late sensors to when they were true: a filter corrects the state of its own time.

    By Fourier series, which leaves white noise as white and as large as it is, as no other interpolation does. Left out is
    what is moved to within `GUARD` samples of a gap or of an end of the record.

    Raises
    ------
    IdentificationError
        The delay of a sensor is free.
    """
    vehicle, pieces = problem.layout.vehicle, []
    late = [(column, vehicle.parameters[row].name, row) for column, row in output_delays(vehicle)]
    free = {p.name for p in problem.layout.parameters}
    for name in (name for _, name, _ in late if name in free):
        raise IdentificationError(
            f"{vehicle.where}: {name}: a filter needs a delay that is known; use --fix {name}, or estimate it with "
            "--method output-error or multiple-shooting"
        )
    for piece in problem.pieces:
        measured, rows = piece.measured.copy(), vehicle.parameter_rows(piece.changes)
        for column, _, row in late:
            values, samples = piece.whole[:, column], float(rows[row, 0]) / piece.dt
            if np.isfinite(values).any() and samples != 0.0:
                whole = interpolated(unwrapped(values) if vehicle.outputs[column] in WRAPPED else values)
                at = np.arange(len(values)) + round(samples)
                near = at[:, None] + np.arange(-GUARD, GUARD + 1)
                inside = (near >= 0) & (near < len(values))
                clear = (inside & np.isfinite(values[np.clip(near, 0, len(values) - 1)])).all(axis=1)
                clear &= np.isfinite(piece.measured[np.clip(at, 0, len(values) - 1), column])
                measured[:, column] = np.where(clear, advanced(whole, samples), np.nan)
        pieces.append(replace(piece, measured=measured))
    return replace(problem, pieces=tuple(pieces))


def advanced(column: FloatArray, samples: float) -> FloatArray:
    """Return a signal (n,) as it is so many samples later, by the Fourier series of it and its reflections."""
    n = len(column)
    whole = np.pad(column, n - 1, mode="reflect", reflect_type="odd")
    line = np.linspace(whole[0], whole[-1], len(whole))
    turn = np.exp(2j * np.pi * np.fft.rfftfreq(len(whole)) * samples)
    out = np.fft.irfft(np.fft.rfft(whole - line) * turn, len(whole)) + line + samples * (line[1] - line[0])
    return np.asarray(out[n - 1 : 2 * n - 1])


def unwrapped(column: FloatArray) -> FloatArray:
    """Return an angle (n,) without jumps; NaN where it was not measured."""
    out, present = column.copy(), np.isfinite(column)
    out[present] = np.unwrap(column[present])
    return out


def interpolated(values: FloatArray) -> FloatArray:
    """Return values (n,) with straight lines where nothing was measured."""
    present = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), present, values[present])


def measured_points(vehicle: Vehicle, piece: Piece, points: IntArray) -> Points:
    """Return mean measured states around each point, where `points` (n,) is that of each sample; else the start."""
    start = {name: np.full(len(points), value) for name, value in piece.start.items()}
    for i, channel in enumerate(vehicle.outputs):
        if channel in start and np.isfinite(piece.whole[:, i]).any():
            start[channel] = interpolated(unwrapped(piece.whole[:, i]))

    start |= recorded_motion(vehicle, piece.inputs.T, start)

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(points, values) / np.bincount(points)

    rows = vehicle.parameter_rows(piece.changes)
    means = {name: mean(values) for name, values in start.items()}
    inputs = np.array([mean(column) for column in piece.inputs.T])
    starts = [{n: m[r] for n, m in means.items()} for r in range(inputs.shape[1])]
    states = [vehicle.initial_states(one, rows, inputs[:, r]) for r, one in enumerate(starts)]
    return Points(np.concatenate(states, axis=1), inputs)


def averaged(vehicle: Vehicle, states: FloatArray, points: IntArray) -> FloatArray:
    """Return the mean states (n_x, r, B) around each point of states (B, n, n_x).

    Quaternions on the way do not average to an attitude, but where down is does; the heading does not matter to a
    linear model in body axes.
    """
    first = np.flatnonzero(np.diff(points, prepend=-1))
    counts = np.diff(np.append(first, len(points)))[:, None]
    at = {name: i for i, name in enumerate(vehicle.states)}
    with np.errstate(over="ignore", invalid="ignore"):  # a candidate that diverges is a value
        zero = np.zeros(states.shape[:2])
        e0, e1, e2, e3 = (states[:, :, at[n]] if n in at else zero for n in ("e0", "e1", "e2", "e3"))
        downs = [2 * (e1 * e3 - e0 * e2), 2 * (e2 * e3 + e0 * e1), e0**2 - e1**2 - e2**2 + e3**2]
        sums = (np.add.reduceat(columns, first, axis=1) for columns in (states, np.stack(downs, axis=2)))
        out, (x, y, z) = (np.moveaxis(total / counts, 2, 0) for total in sums)
        phi, theta = np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))
        level = quaternions_of(np.stack([phi, theta, np.zeros_like(phi)], axis=-1))
        for i in (i for i in range(4) if f"e{i}" in at):
            out[at[f"e{i}"]] = level[..., i]
        return np.ascontiguousarray(np.swapaxes(out, 1, 2))
