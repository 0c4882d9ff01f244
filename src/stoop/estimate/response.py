"""First-order response of readings to small changes of the equations, along an estimate.

With the state derivative f and the readings h of an extended vehicle, a change of f by df(t) and of h by dh(t) changes the
readings by dy = C dx + dh, where dx follows from dx' = A dx + df, dx(0) = 0, with A and C the Jacobians of f and h along
the trajectory. One evaluation of the equations over all samples gives df and dh of a change, whatever it is.

A filter corrects the state after each sample, dx+ = dx - E K dy with its gain K and the derivative E of the state by a
move of the error state: dy is then what the innovations lose. Windows begin anew, each with dx = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.base.variables import WRAPPED
from stoop.problem import Misfit, Piece, Weights
from stoop.vehicle import Vehicle
from stoop.vehicle.arrays import Equations, Evaluation
from stoop.vehicle.channels import slope_input
from stoop.vehicle.delays import delayed, first_order_lag, late, output_delays
from stoop.vehicle.extensions import Extension, extended

PLAYED: Final = ("rate_limit", "dead_zone")  #: what acts on the recorded channels, not in the equations
STEP: Final = 1e-6  #: of a state's size, for the Jacobians


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A piece of a flight as the estimate flies it, n samples; where they do not follow one another it begins anew."""

    equations: Equations
    rows: FloatArray  #: (n_p,), parameters of the equations
    states: FloatArray  #: (n_x, n)
    record: FloatArray  #: (n_u, n_r), inputs of the whole piece as they arrive
    samples: IntArray  #: (n,), of the record
    dt: float  #: s
    #: (n, n_x, n_y), of the state by an excess of the readings, of a filter
    correction: FloatArray | None = None

    @cached_property
    def inputs(self) -> FloatArray:
        """Inputs (n_u, n)."""
        return self.record[:, self.samples]

    @cached_property
    def stretches(self) -> tuple[slice, ...]:
        """Samples that follow one another."""
        starts = np.flatnonzero(np.diff(self.samples) != 1) + 1
        return tuple(map(slice, [0, *starts.tolist()], [*starts.tolist(), len(self.samples)]))

    def responses(self, forcing: FloatArray, direct: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return dx (n, n_x, m) and dy (n, n_y, m) of m changes: df (n, n_x, m) and dh (n, n_y, m)."""
        A, C = self._jacobians()
        turned, transition = 0.5 * (A[:-1] + A[1:]) * self.dt, np.eye(A.shape[1])
        for order in (4, 3, 2, 1):  # as the steps of the kernel
            transition = np.eye(A.shape[1]) + turned @ transition / order
        pushed = 0.5 * self.dt * (transition @ forcing[:-1] + forcing[1:])
        if self.correction is not None:
            corrected = transition @ self.correction[:-1]
            pushed -= corrected @ direct[:-1]
            transition = transition - corrected @ C[:-1]
        dx = np.zeros_like(forcing)
        for stretch in self.stretches:
            for k in range(stretch.start, stretch.stop - 1):
                np.matmul(transition[k], dx[k], out=dx[k + 1])
                dx[k + 1] += pushed[k]
        return dx, np.asarray(C @ dx + direct)

    def _jacobians(self) -> tuple[FloatArray, FloatArray]:
        """Return A (n, n_x, n_x) and C (n, n_y, n_x)."""
        A, C = [], []
        for i, x in enumerate(self.states):
            step = STEP * max(1.0, float(np.max(np.abs(x))))
            ends = []
            for sign in (1.0, -1.0):
                states = self.states.copy()
                states[i] += sign * step
                ends.append(self.equations(self.rows, states, self.inputs))
            A.append((ends[0][0] - ends[1][0]) / (2.0 * step))
            C.append((ends[0][1] - ends[1][1]) / (2.0 * step))
        return np.stack(A).transpose(2, 1, 0).copy(), np.stack(C).transpose(2, 1, 0).copy()


def fly(vehicle: Vehicle, rows: FloatArray, start: FloatArray, inputs: FloatArray, dt: float) -> FloatArray:
    """Return the states (n_x, n, B) from starts (n_x, B) by Runge and Kutta's method, as the kernel takes its steps.

    Parameters are (n_p, B). Inputs (n_u, n, B) as they arrive are linear between samples; slopes keep their value until the
    next one.
    """
    evaluate = vehicle.kernel().evaluate
    begin = np.ascontiguousarray(np.moveaxis(inputs, 1, 0))
    middle, end = 0.5 * (begin[:-1] + begin[1:]), begin[1:].copy()
    for i in (vehicle.inputs.index(slope_input(c)) for c in vehicle.sloped):
        middle[:, i] = end[:, i] = begin[:-1, i]
    out = np.empty((len(begin), *start.shape))
    out[0] = x = start
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(len(middle)):
            a = evaluate(rows, x, begin[k])[0]
            b = evaluate(rows, x + 0.5 * dt * a, middle[k])[0]
            c = evaluate(rows, x + 0.5 * dt * b, middle[k])[0]
            d = evaluate(rows, x + dt * c, end[k])[0]
            out[k + 1] = x = x + dt / 6.0 * (a + 2.0 * (b + c) + d)
    return np.moveaxis(out, 0, 1)


@dataclass(frozen=True, eq=False)
class Responses:
    """Whitened responses of each piece to m extensions, per SI unit."""

    extensions: tuple[Extension, ...] = ()
    pieces: tuple[FloatArray, ...] = ()  #: (n, n_y, m), of the readings
    #: (w - 1, e, m), of the gaps between windows; empty where there are none
    gaps: tuple[FloatArray, ...] = ()


@dataclass(frozen=True, eq=False)
class ExtendedModel:
    """A vehicle, and its equations with every extension at its null value."""

    base: Vehicle
    vehicle: Vehicle
    extensions: tuple[Extension, ...]
    equations: Equations

    @classmethod
    def of(cls, base: Vehicle) -> ExtendedModel:
        """Return the model of a vehicle."""
        vehicle, catalogue = extended(base)
        return cls(base, vehicle, catalogue, vehicle.array_equations())

    def rows(self, known: FloatArray) -> FloatArray:
        """Return the parameters of the extended vehicle for those (n_p,) of the vehicle."""
        rows = self.vehicle.values.copy()
        for name, row in self.base.rows.items():
            rows[self.vehicle.rows[name]] = known[row]
        return rows

    def received(self, piece: Piece, known: FloatArray) -> FloatArray:
        """Return the inputs (n_u, n) of a piece as they arrive with parameters (n_p, 1)."""
        return piece.received(self.base, known).T.astype(float)

    def responses(
        self, trajectories: Sequence[Trajectory], pieces: Sequence[Piece]
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Return dx (n, n_x, m) and dy (n, n_y, m) of all extensions, per SI unit, of every piece."""
        ends = np.cumsum([len(at.samples) for at in trajectories]).tolist()
        parts = [slice(a, b) for a, b in zip([0, *ends], ends, strict=False)]
        inputs = np.hstack([at.inputs for at in trajectories])
        rows = _joined([at.rows for at in trajectories], parts)
        base = Evaluation(self.equations, rows, np.hstack([at.states for at in trajectories]), inputs)
        m, n_x = len(self.extensions), len(self.base.states)
        changes = np.zeros((ends[-1], n_x + len(self.base.outputs), m))
        for j, one in enumerate(self.extensions):
            steps = [self._step(one, *both) for both in zip(trajectories, pieces, strict=True)]
            moved = [own for _, own in steps if own is not None]
            rows = _joined([rows for rows, _ in steps], parts)
            for i, change in base.changes(rows, np.hstack(moved) if moved else inputs):
                changes[:, i, j] = change
            for i in (self.vehicle.outputs.index(c) for c in one.readings):
                for at, own in zip(trajectories, parts, strict=True):
                    changes[own, n_x + i, j] += self._lateness(one, at, i, base.reading(i)[own])
        sizes = np.array([one.step for one in self.extensions])
        both = zip(trajectories, parts, strict=True)
        found = [at.responses(changes[own, :n_x], changes[own, n_x:]) for at, own in both]
        return [(dx / sizes, dy / sizes) for dx, dy in found]

    def late(self, at: Trajectory, dy: FloatArray, known: FloatArray, moved: tuple[int, ...]) -> FloatArray:
        """Return responses (n, n_y, m) as late as the instruments deliver them; in place."""
        rows = np.repeat(known, dy.shape[2], axis=1)
        for own in at.stretches if output_delays(self.base) else ():
            part = np.ascontiguousarray(dy[own].transpose(2, 0, 1))
            dy[own] = self.base.late_outputs(part, rows, at.dt, moved).transpose(1, 2, 0)
        return dy

    def _step(self, one: Extension, at: Trajectory, piece: Piece) -> tuple[FloatArray, FloatArray | None]:
        """Return parameters (n_p,) and inputs (n_u, n) with a step of an extension; None for inputs that stay."""
        rows, vehicle = at.rows.copy(), self.vehicle
        for name in one.numbers:
            rows[vehicle.rows[name]] += one.value(one.step) - one.null
        if one.kind in PLAYED:
            return rows, piece.received(vehicle, rows[:, None]).T[:, at.samples]
        if not one.inputs:
            return rows, None
        inputs = at.inputs.copy()
        for name in (name for c in one.inputs for name in (c, slope_input(c)) if name in vehicle.inputs):
            column = vehicle.inputs.index(name)
            signal = at.record[column]
            slow = one.kind == "lag"
            after = first_order_lag(signal, one.step, at.dt) if slow else delayed(signal, one.step / at.dt)
            inputs[column] = after[at.samples]
        return rows, inputs

    def _lateness(self, one: Extension, at: Trajectory, column: int, reading: FloatArray) -> FloatArray:
        """Return by how much a reading (n,) changes that an extension delivers late."""
        out = np.empty_like(reading)
        for own in at.stretches:
            whole = np.unwrap(reading[own]) if self.vehicle.outputs[column] in WRAPPED else reading[own]
            out[own] = late(whole, one.step / at.dt) - whole
        return out


def _joined(rows: Sequence[FloatArray], parts: Sequence[slice]) -> list[Any]:
    """Return the parameters (n_p,) of several pieces in one: numbers, and (n,) where the pieces differ."""
    values, counts = np.stack(rows), [own.stop - own.start for own in parts]
    out: list[Any] = values[0].tolist()
    for i in np.flatnonzero((values != values[0]).any(axis=0)).tolist():
        out[i] = np.repeat(values[:, i], counts)
    return out


def simulation_responses(problem: Misfit, z: FloatArray) -> Responses:
    """Return how the simulation at a search vector (D + E,) responds to every extension of its vehicle."""
    model, out = ExtendedModel.of(problem.layout.vehicle), []
    known, starts = zip(*(problem.candidates(z[None, :], i) for i in range(len(problem.pieces))), strict=True)
    records = [model.received(*both) for both in zip(problem.pieces, known, strict=True)]
    longest = max(record.shape[1] for record in records)
    padded = [np.pad(x, [(0, 0), (0, longest - x.shape[1])], mode="edge") for x in records]
    dt = problem.pieces[0].dt
    together = fly(model.base, np.hstack(known), np.hstack(starts), np.stack(padded, axis=-1), dt)
    flown = [together[:, : record.shape[1], i].copy() for i, record in enumerate(records)]
    trajectories = []
    for piece, own, states, record in zip(problem.pieces, known, flown, records, strict=True):
        rows, samples = model.rows(own[:, 0]), np.arange(len(piece.time))
        trajectories.append(Trajectory(model.equations, rows, states, record, samples, piece.dt))
    found = model.responses(trajectories, problem.pieces)
    each = zip(trajectories, problem.pieces, problem.piece_weights, known, found, strict=True)
    for at, piece, weights, own, (_, dy) in each:
        dy = model.late(at, dy, own, piece.moved)
        out.append(whitened(weights, dy, np.isfinite(piece.measured)))
    return Responses(model.extensions, tuple(out))


def whitened(weights: Weights, dy: FloatArray, present: BoolArray) -> FloatArray:
    """Return whitened responses (n, n_y, m), zero where nothing was measured."""
    white = weights.whiten(np.moveaxis(dy, 2, 0) * present, present)
    return np.ascontiguousarray(np.moveaxis(white, 0, 2))
