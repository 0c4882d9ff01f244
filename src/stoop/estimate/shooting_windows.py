"""Windows of a piece: readings and end states of each, and their derivatives by initial states and search vector.

Axes: k = sample, i = reading, e = number of a perturbation of the state, j = unknown of the search vector, w = window.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.base.rotations import normalized
from stoop.base.variables import EULER
from stoop.estimate.linearization import interpolated, perturbation_steps, perturbations_of, unwrapped
from stoop.estimate.regression.rotors import lagged_command
from stoop.estimate.response import ExtendedModel, Trajectory, fly
from stoop.kernels import filtering
from stoop.kernels.windows import windows
from stoop.optimize.normal_equations import project, square
from stoop.problem import Misfit, Piece, observation, on_circle
from stoop.vehicle import Vehicle
from stoop.vehicle.delays import distinct_inputs, output_delays
from stoop.vehicle.schema import WIND

WINDOW_LENGTH: Final = 1.0  #: s: no vehicle leaves its record far in that
STEP: Final = 1e-7  #: of the search vector
STATE_STEP: Final = 1e-2  #: of the steps of a linearization
SMOOTHING_TIME: Final = 0.1  #: s on either side of a window's start over which readings are smoothed
QUATERNION: Final = ("e0", "e1", "e2", "e3")  #: states
MAX_LANES: Final = 4096  #: simulated side by side; more would only take memory


@dataclass(frozen=True, eq=False)
class WindowModel:
    """Initial states and continuity of the windows of a kind of vehicle."""

    winds: tuple[str, ...]  #: readings to which each window adds a wind of its own
    #: a gap counts so many times its scale, one after the other; one entry where windows need not meet
    strictness: tuple[float, ...]
    gap_scales: Mapping[str, float]  #: of a gap, m/s, rad/s; `angle_scale`, rad, for what is not named
    angle_scale: float
    notice: str  #: code of the notice that explains the method
    global_start: bool  #: whether an optimizer searches where no start is near enough
    #: gives a complete column (n,) at a sample, smoothed over so many samples on either side
    smoothed: Callable[[FloatArray, int, int], float]
    #: gives the states (w,) that smoothed readings (w,) of a vehicle and piece tell
    states: Callable[[Vehicle, Piece, Mapping[str, FloatArray]], dict[str, FloatArray]]


def _mean(column: FloatArray, at: int, width: int) -> float:
    first, stop = max(0, at - width), min(len(column), at + width + 1)
    before, behind = first - (at - width), at + width + 1 - stop
    return float(np.pad(column[first:stop], (before, behind), mode="edge").mean())


def _parabola(column: FloatArray, at: int, width: int) -> float:
    """Return a parabola at a sample: rates of a multirotor turn within a tenth of a second."""
    first = max(0, at - width)
    near = column[first : at + width + 1]
    if len(near) < 6:  # twice the coefficients
        return float(near.mean())
    powers = np.vander(np.arange(len(near)) - float(at - first), 3)
    return float(np.linalg.lstsq(powers, near, rcond=None)[0][-1])


def _through_air(vehicle: Vehicle, piece: Piece, readings: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the motion through the air, body axes: bias and scale of the piece undone, the wind taken off."""
    rows = vehicle.parameter_rows(piece.changes)[:, 0]
    true = observation.true_values(vehicle, readings, rows)
    if not set(WIND) & set(true):
        return true
    zero = np.zeros(len(next(iter(true.values()))))
    attitude = {n: zero + piece.start.get(n, 0.0) for n in EULER}
    return observation.through_air({**dict.fromkeys(WIND, zero), **attitude, **true})


#: windows that meet: the end is that of output error
AIRCRAFT: Final = WindowModel(
    winds=(),
    strictness=(1.0, 10.0, 100.0, 1e3, 1e4),
    gap_scales={"u": 1.0, "v": 1.0, "w": 1.0, "p": 0.1, "q": 0.1, "r": 0.1},
    angle_scale=0.05,
    notice="multiple-shooting",
    global_start=False,
    smoothed=_mean,
    states=lambda vehicle, piece, readings: dict(readings),
)
#: windows in winds of their own: the effect of a gust within a window is not carried into the next
ROTORCRAFT: Final = WindowModel(
    winds=WIND,
    strictness=(1.0,),
    gap_scales={"u": 2.0, "v": 2.0, "w": 2.0, "p": 0.5, "q": 0.5, "r": 0.5},
    angle_scale=0.2,
    notice="multiple-shooting-rotors",
    global_start=True,
    smoothed=_parabola,
    states=_through_air,
)
_MODELS: Final = {observation.AIR_FRAME: AIRCRAFT, observation.GROUND_FRAME: ROTORCRAFT}


def window_model(vehicle: Vehicle) -> WindowModel:
    """Return initial states and continuity of the windows of a vehicle; without winds in the still air of a room."""
    model = _MODELS[observation.observation_model(vehicle)]
    return replace(model, winds=()) if vehicle.positions else model


@dataclass(frozen=True, eq=False)
class Products:
    """Products of the readings of a window in the normal equations, independent of the weight of its gap."""

    by_unknown: FloatArray  #: (j, j), of the derivatives by the search vector with themselves
    by_state: FloatArray  #: (e, e), of those by the state that the window begins with
    across: FloatArray  #: (e, j), of the latter with the former
    unknown_slope: FloatArray  #: (j,), of the derivatives with the residual
    state_slope: FloatArray  #: (e,)


@dataclass(frozen=True, eq=False)
class Shot:
    """One window, simulated and linearized."""

    residual: FloatArray  #: (n, n_y), simulated less measured, zero where nothing was measured
    #: (n, n_y, j), its derivative by the entries of the search vector that act on the piece
    by_unknown: FloatArray
    by_state: FloatArray  #: (n, n_y, e), by a perturbation of the state that the window begins with
    gap: FloatArray  #: (e,), end of this window less start of the next; empty for the last
    gap_by_unknown: FloatArray  #: (e, j)
    gap_by_state: FloatArray  #: (e, e)

    @cached_property
    def products(self) -> Products:
        """Products of residual and derivatives, once they are whitened."""
        j, left = self.by_unknown.shape[2], self.residual.ravel()
        rows = np.concatenate([lanes_first(slopes) for slopes in (self.by_unknown, self.by_state)])
        rows = rows.reshape(len(rows), -1)
        inner, slope = square(rows), project(rows, left)
        return Products(inner[:j, :j], inner[j:, j:], inner[j:, :j], slope[:j], slope[j:])


def lanes_first(slopes: FloatArray) -> FloatArray:
    """Return derivatives (n, n_y, m) as (m, n, n_y), as the kernel gives them: no copy of these."""
    return np.moveaxis(slopes, 2, 0)


@dataclass(frozen=True, eq=False)
class Shots:
    """The windows of one piece.

    Nodes are the initial states (n_x, w) of the windows and, for windows with winds, the differences of the wind of each below
    them, m/s north, east, down; winds are perturbed like states.
    """

    problem: Misfit
    index: int  #: of the piece
    edges: tuple[int, ...]  #: first sample of each window, then the number of samples

    @classmethod
    def of(cls, problem: Misfit, index: int, length: float = WINDOW_LENGTH) -> Shots:
        """Return the windows, about so many seconds long, of one piece."""
        piece = problem.pieces[index]
        return cls(problem, index, edges(len(piece.time), max(2, round(length / piece.dt))))

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle."""
        return self.problem.layout.vehicle

    @property
    def piece(self) -> Piece:
        """The piece."""
        return self.problem.pieces[self.index]

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.edges) - 1

    @cached_property
    def entries(self) -> IntArray:
        """Entries (j,) of the search vector that act on the piece: parameters, biases, then initial states."""
        own = sorted(self.problem.own[self.index], key=lambda pair: not pair[1].is_bias)
        return np.array([*range(self.problem.dimension), *(j for j, _ in own)], dtype=np.int64)

    @property
    def wind_columns(self) -> tuple[int, ...]:
        """Readings to which the wind of a window adds, by column."""
        return tuple(self.vehicle.outputs.index(c) for c in window_model(self.vehicle).winds)

    def measured_nodes(self, z: FloatArray | None = None) -> FloatArray:
        """Return the nodes as they were measured, without winds, for a search vector (D + E,) or the values of the file."""
        at, rows = np.array(self.edges[:-1]), self._kernel_parameters(z)
        inputs = np.ascontiguousarray(self.piece.inputs[at].T)
        every = np.repeat(rows, len(at), axis=1)
        states = self.vehicle.initial_states(self.measured_starts(z), every, inputs)
        return np.pad(states, [(0, len(self.wind_columns)), (0, 0)])

    def _kernel_parameters(self, z: FloatArray | None) -> FloatArray:
        """Return the kernel parameters (n_p, 1) of a search vector, or of the file."""
        if z is None:
            return self.vehicle.parameter_rows(self.piece.changes)
        return self.problem.candidates(z[None, :], self.index)[0]

    def measured_starts(self, z: FloatArray | None = None) -> dict[str, FloatArray]:
        """Return what :meth:`Vehicle.initial_states` takes of every window, (w,) each, for a search vector.

        The initial state of a rotor or surface with a lag follows from its earlier commands and the lag.
        """
        piece, vehicle, model = self.piece, self.vehicle, window_model(self.vehicle)
        at, width = list(self.edges[:-1]), max(1, round(SMOOTHING_TIME / piece.dt))
        recorded = dict(zip(vehicle.outputs, piece.whole.T, strict=True))
        whole = observation.integrated_attitude(vehicle, piece.start, recorded, piece.dt)
        readings = {c: y[at] for c, y in whole.items()}
        for i, channel in enumerate(vehicle.outputs):
            column = piece.whole[:, i]
            if channel in observation.state_channels(vehicle) and np.isfinite(column).any():
                complete = interpolated(unwrapped(column))
                readings[channel] = np.array([model.smoothed(complete, a, width) for a in at])
        default = {n: np.full(len(at), piece.start.get(n, 0.0)) for n in vehicle.start_names}
        starts = default | model.states(vehicle, piece, readings)
        starts |= observation.recorded_motion(vehicle, piece.inputs[at].T, starts)
        rows = self._kernel_parameters(z)
        for state in (s for s in vehicle.states if s.endswith(".lag")):
            name = state.removesuffix(".lag")  # by how much it is off its command
            command = vehicle.commanded(name, np.repeat(rows, len(at), axis=1), piece.inputs[at].T)
            starts[state] = lagged_command(vehicle, piece, name, rows)[at] - command
        return starts

    def perturbed(self, nodes: FloatArray, steps: FloatArray) -> FloatArray:
        """Return nodes after perturbations (e, w)."""
        kernel, nx = self.vehicle.kernel(), len(self.vehicle.states)
        states, own = np.ascontiguousarray(nodes[:nx]), np.ascontiguousarray(steps[: kernel.moves])
        moved = filtering.move(kernel, states, own)  # to unit length to first order: a step may turn far
        attitude = [i for i, name in enumerate(self.vehicle.states) if name in QUATERNION]
        with np.errstate(over="ignore", invalid="ignore"):  # a step that diverges is a value
            moved[attitude] = normalized(moved[attitude].T).T
        return np.concatenate([moved, nodes[nx:] + steps[kernel.moves :]])

    def simulate(self, z: FloatArray, nodes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return readings (n, n_y), gaps (w - 1, e), and ends (n_x, w - 1), for nodes.

        The first node is the search vector's.
        """
        rows, start = self.problem.candidates(z[None, :], self.index)
        nodes = nodes.copy()
        nodes[: len(start), :1] = start
        return self._simulate(rows, nodes)

    def _simulate(self, rows: FloatArray, nodes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        nx = len(self.vehicle.states)
        begins, winds = np.ascontiguousarray(nodes[:nx]), nodes[nx:]
        out, last = self.integrate(np.repeat(rows, self.count, axis=1), begins, np.arange(self.count))
        ends, after = np.ascontiguousarray(last[:, :-1]), np.ascontiguousarray(begins[:, 1:])
        gaps = np.einsum("exw,xw->we", perturbations_of(self.vehicle, after), ends - after)
        out[:, :, self.wind_columns] += winds.T[:, None, :]
        readings = np.concatenate([own[:n] for own, n in zip(out, np.diff(self.edges), strict=True)])
        return readings, np.concatenate([gaps, -np.diff(winds, axis=1).T], axis=1), ends

    def linearize(self, z: FloatArray, nodes: FloatArray) -> list[Shot]:
        """Return every window with its derivatives, by differences."""
        own, nx = self.problem.own[self.index], len(self.vehicle.states)
        later = self.entries[: len(self.entries) - sum(not n.is_bias for _, n in own)]
        states, winds = np.ascontiguousarray(nodes[:nx]), nodes[nx:]
        inverse = perturbations_of(self.vehicle, np.ascontiguousarray(states[:, 1:]))
        out = self.linearize_some(z, states, inverse, range(1), self.entries)
        together = max(1, MAX_LANES // (1 + len(later) + len(self.vehicle.moves)))
        for w in range(1, self.count, together):
            out += self.linearize_some(z, states, inverse, range(w, min(w + together, self.count)), later)
        return [self._with_wind(shot, winds, w) for w, shot in enumerate(out)] if self.wind_columns else out

    def linearize_some(
        self, z: FloatArray, nodes: FloatArray, inverse: FloatArray, which: range, entries: IntArray
    ) -> list[Shot]:
        """Return some windows, simulated side by side; `inverse` as :func:`perturbations_of` of later nodes gives it."""
        d = self.problem.dimension
        steps = np.where((entries < d) & (z[entries] + STEP > 1.0), -STEP, STEP)
        Z = np.repeat(z[None, :], 1 + len(entries), axis=0)
        Z[1 + np.arange(len(entries)), entries] += steps
        rows, begin = self.problem.candidates(Z, self.index)
        sizes = STATE_STEP * perturbation_steps(self.vehicle)
        rows = np.concatenate([rows, np.repeat(rows[:, :1], len(sizes), axis=1)], axis=1)
        lanes = rows.shape[1]
        own = begin if which[0] == 0 else nodes[:, which]
        perturbed = filtering.move(
            self.vehicle.kernel(),
            np.repeat(own[:, : len(which)], len(sizes), axis=1),
            np.tile(np.diag(sizes), len(which)),
        ).reshape(len(nodes), len(which), -1)
        fixed = begin[:, None] if which[0] == 0 else np.repeat(own[:, :, None], 1 + len(entries), axis=2)
        begins = np.concatenate([fixed, perturbed], axis=2).reshape(len(nodes), -1)
        out, last = self.integrate(np.tile(rows, len(which)), begins, np.repeat(which, lanes))
        out, last = out.reshape(len(which), lanes, *out.shape[1:]), last.reshape(len(nodes), -1, lanes)
        changes, shots = np.concatenate([steps, sizes]), []
        m, j = len(entries), len(self.entries)
        for i, w in enumerate(which):
            readings = out[i][:, : self.edges[w + 1] - self.edges[w]]
            measured = self.piece.measured[self.edges[w] : self.edges[w + 1]]
            slopes = np.zeros((j + len(sizes), *readings.shape[1:]))
            np.subtract(readings[1 : 1 + m], readings[:1], out=slopes[:m])
            np.subtract(readings[1 + m :], readings[:1], out=slopes[j:])
            slopes[:m] /= steps[:, None, None]
            slopes[j:] /= sizes[:, None, None]
            gaps = np.empty((0, lanes))
            if w + 1 < self.count:
                gaps = inverse[:, :, w] @ (last[:, i] - nodes[:, w + 1 : w + 2])
            gap_slopes = (gaps[:, 1:] - gaps[:, :1]) / changes
            left = residual(self.problem, readings[0], measured)
            by_unknown, by_state = np.split(slopes, [j])
            by_unknown, by_state = np.moveaxis(by_unknown, 0, 2), np.moveaxis(by_state, 0, 2)
            gap_by_unknown = np.pad(gap_slopes[:, :m], [(0, 0), (0, j - m)])
            shots.append(Shot(left, by_unknown, by_state, gaps[:, 0], gap_by_unknown, gap_slopes[:, m:]))
        return shots

    def _with_wind(self, shot: Shot, winds: FloatArray, w: int) -> Shot:
        """Return a window in its own wind, whose components count as further perturbations of its state."""
        m, columns, e = len(self.wind_columns), self.wind_columns, shot.by_state.shape[2]
        present = np.isfinite(self.piece.measured[self.edges[w] : self.edges[w + 1]])
        by_state = np.pad(shot.by_state, [(0, 0), (0, 0), (0, m)])
        by_state[:, columns, e + np.arange(m)] = 1.0
        left = shot.residual.copy()
        left[:, columns] += winds[:, w] * present[:, columns]
        gap, by_unknown, gap_by_state = shot.gap, shot.gap_by_unknown, np.empty((0, e + m))
        if w + 1 < self.count:
            gap = np.concatenate([gap, winds[:, w] - winds[:, w + 1]])
            by_unknown = np.pad(by_unknown, [(0, m), (0, 0)])
            gap_by_state = np.pad(shot.gap_by_state, [(0, m), (0, m)])
            gap_by_state[e:, e:] = np.eye(m)
        return Shot(left, shot.by_unknown, by_state, gap, by_unknown, gap_by_state)

    def responses(
        self, model: ExtendedModel, z: FloatArray, nodes: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return how readings (n, n_y, m) and gaps (w - 1, e, m) respond to extensions, each window from its beginning."""
        rows, start = self.problem.candidates(z[None, :], self.index)
        begins, edges, n = nodes[: len(start)].copy(), np.array(self.edges), len(self.piece.time)
        begins[:, :1] = start
        lasts = np.minimum(edges[1:], n - 1)
        whole = edges[:-1] + np.arange(np.max(lasts - edges[:-1]) + 1)[:, None]
        inside, record = whole <= lasts, model.received(self.piece, rows)
        known, dt = model.rows(rows[:, 0]), self.piece.dt
        every = np.repeat(rows, begins.shape[1], axis=1)
        states = fly(self.vehicle, every, begins, record[:, np.minimum(whole, n - 1)], dt)
        states = np.ascontiguousarray(np.swapaxes(states, 1, 2)[:, inside.T])
        at = Trajectory(model.equations, known, states, record, whole.T[inside.T], dt)
        ((dx, dy),) = model.responses([at], [self.piece])
        ends = [own.stop - 1 for own in at.stretches[:-1]]
        inverse = perturbations_of(self.vehicle, np.ascontiguousarray(begins[:, 1:]))
        gaps = np.einsum("exw,wxm->wem", inverse, dx[ends])
        readings = np.delete(model.late(at, dy, rows, self.piece.moved), ends, axis=0)
        return readings, np.pad(gaps, [(0, 0), (0, len(self.wind_columns)), (0, 0)])

    def integrate(
        self, rows: FloatArray, begin: FloatArray, which: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Simulate windows `which` (B,) side by side, from states (n_x, B) with kernel parameters (n_p, B).

        Inputs of different actuators stand in records one below the other. Return readings (B, n, n_y), those of a short window
        going on into the next, and states (n_x, B) at the first sample of the next window (of the last one, at its last).
        """
        vehicle, piece, dt = self.vehicle, self.piece, self.piece.dt
        lanes, copy = distinct_inputs(vehicle, piece.inputs, rows, dt, piece.before)
        record = lanes.reshape(-1, lanes.shape[2])
        n, edges = len(piece.time), np.array(self.edges)
        steps = np.minimum(edges[which + 1], n - 1) - edges[which]
        first, behind = copy * n + edges[which], (copy + 1) * n
        out, last = windows(vehicle.kernel(), rows, begin, record, first, behind, steps, dt)
        for length in np.unique(steps) if output_delays(vehicle) else ():
            lanes = steps == length  # each in its own length, whatever stands beside it
            part = np.ascontiguousarray(out[lanes, : length + 1])
            out[lanes, : length + 1] = vehicle.late_outputs(part, rows[:, lanes], dt, piece.moved)
        return out, last


def residual(problem: Misfit, readings: FloatArray, measured: FloatArray) -> FloatArray:
    """Return simulated less measured (n, n_y), zero where nothing was measured."""
    present = np.isfinite(measured)
    with np.errstate(invalid="ignore"):
        difference = (readings - np.where(present, measured, 0.0)) * present
    return on_circle(difference, problem.layout.vehicle.outputs)


def edges(samples: int, length: int) -> tuple[int, ...]:
    """Return the first samples of windows of about `length` samples, and the number of samples."""
    count = max(1, round(samples / length))
    return tuple(int(e) for e in np.linspace(0, samples, count + 1).round())


def outputs_by_window(problem: Misfit, index: int) -> FloatArray:
    """Return simulated readings (n, n_y) of a piece without unknowns, in windows that each begin as measured."""
    shots = Shots.of(problem, index)
    rows, _ = problem.candidates(np.empty((1, 0)), index)
    return shots._simulate(rows, shots.measured_nodes())[0]
