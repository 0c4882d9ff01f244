"""Windows of a piece: what each reads, where it ends, and how both depend on what it begins with.

Axes: k = sample, i = reading, e = number of a move of the state, j = unknown of the search vector, w = window.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.estimate.filter_error.paths import filled, unwrapped
from stoop.estimate.filter_error.points import move_steps, moves_of
from stoop.kernels import filtering
from stoop.kernels.windows import windows
from stoop.problem import Misfit, Piece, on_circle
from stoop.problem.observation import state_channels, through_air, true_value
from stoop.simulate import initial_states, parameter_rows
from stoop.simulate.delays import input_delays, lagged, late_inputs
from stoop.simulate.initial import commanded
from stoop.vehicle import Vehicle
from stoop.vehicle.schema import WIND

WINDOW_LENGTH: Final = 1.0  #: s: no vehicle leaves its record far in that
STEP: Final = 1e-7  #: of the search vector
FINER: Final = 1e-2  #: of the steps of a linearization
SMOOTH: Final = 0.1  #: s over which readings are averaged where a window begins
BENT: Final = 3  #: numbers of a parabola
LANES: Final = 4096  #: that fly side by side; more would only take memory


@dataclass(frozen=True, eq=False)
class Window:
    """One window, flown.

    Attributes
    ----------
    residual : (n, n_y)
        Simulated less measured, zero where nothing was measured.
    by_unknown : (n, n_y, j)
        Its derivative by the search vector.
    by_state : (n, n_y, e)
        By a move of the state that the window begins with.
    gap : (e,)
        From the state with which the next window begins to the one where this ends; empty for the last.
    gap_by_unknown, gap_by_state : (e, j), (e, e)
    """

    residual: FloatArray
    by_unknown: FloatArray
    by_state: FloatArray
    gap: FloatArray
    gap_by_unknown: FloatArray
    gap_by_state: FloatArray


@dataclass(frozen=True, eq=False)
class Shots:
    """The windows of one piece.

    Attributes
    ----------
    problem : Misfit
    index : int
        Of the piece.
    edges : tuple of int
        First sample of each window, then the number of samples.

    Of a vehicle that hovers the wind differs from window to window: rows below the states say by how much, m/s north,
    east, down, and they are moved like states.
    """

    problem: Misfit
    index: int
    edges: tuple[int, ...]

    @classmethod
    def of(cls, problem: Misfit, index: int, length: float = WINDOW_LENGTH) -> Shots:
        """Return the windows, about so many seconds long, of one piece."""
        piece = problem.pieces[index]
        return cls(problem, index, edges(len(piece.time), max(2, round(length / piece.dt))))

    @property
    def piece(self) -> Piece:
        """The piece."""
        return self.problem.pieces[self.index]

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.edges) - 1

    @property
    def blown(self) -> tuple[int, ...]:
        """Readings that the wind of a window adds to, by column; none of a vehicle that does not hover."""
        vehicle = self.problem.layout.vehicle
        return tuple(vehicle.outputs.index(c) for c in WIND) if vehicle.hovers else ()

    def apart(self, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return states (n_x, w) and winds (m, w) of nodes."""
        many = len(self.problem.layout.vehicle.states)
        return np.ascontiguousarray(nodes[:many]), nodes[many:]

    def moved(self, nodes: FloatArray, moves: FloatArray) -> FloatArray:
        """Return nodes after moves (e, w)."""
        states, winds = self.apart(nodes)
        kernel = self.problem.layout.vehicle.kernel()
        own, blown = moves[: kernel.moves], moves[kernel.moves :]
        return np.concatenate([filtering.move(kernel, states, np.ascontiguousarray(own)), winds + blown])

    def flown(self, z: FloatArray, nodes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return readings (n, n_y), gaps (w - 1, e), and ends (n_x, w - 1), for nodes: what windows begin with.

        The first of them is the search vector's.
        """
        rows, start = self.problem.candidates(z[None, :], self.index)
        nodes = nodes.copy()
        nodes[: len(start), :1] = start
        return self._flown(rows, nodes)

    def flown_from(self, nodes: FloatArray) -> FloatArray:
        """Return readings (n, n_y) for nodes, the first among them, of a problem that estimates nothing."""
        rows, _ = self.problem.candidates(np.empty((1, 0)), self.index)
        return self._flown(rows, nodes)[0]

    def _flown(self, rows: FloatArray, nodes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        begins, winds = self.apart(nodes)
        out, last = self.fly(np.repeat(rows, self.count, axis=1), begins, np.arange(self.count))
        ends = np.ascontiguousarray(last[:, :-1])
        gaps = np.einsum("exw,xw->we", self.back(begins), ends - begins[:, 1:])
        out[:, :, self.blown] += winds.T[:, None, :]
        readings = np.concatenate([own[:n] for own, n in zip(out, np.diff(self.edges), strict=True)])
        return readings, np.concatenate([gaps, -np.diff(winds, axis=1).T], axis=1), ends

    def differentiated(self, z: FloatArray, nodes: FloatArray) -> list[Window]:
        """Return every window with its derivatives, by differences."""
        entries = [j for j, _ in self.problem.own[self.index]]
        starts = [j for j, n in self.problem.own[self.index] if not n.is_bias]
        first = np.array([*range(self.problem.dimension), *entries], dtype=np.int64)
        later = np.array([j for j in first if j not in starts], dtype=np.int64)
        nodes, winds = self.apart(nodes)
        back = self.back(nodes)
        out = self.some(z, nodes, back, range(1), first)
        together = max(1, LANES // (1 + len(later) + len(self.problem.layout.vehicle.moves)))
        for w in range(1, self.count, together):
            out += self.some(z, nodes, back, range(w, min(w + together, self.count)), later)
        return [self._in_wind(window, winds, w) for w, window in enumerate(out)] if self.blown else out

    def _in_wind(self, window: Window, winds: FloatArray, w: int) -> Window:
        """Return a window in its own wind, which counts as more moves of its state."""
        n, ny, e = window.by_state.shape
        m = len(self.blown)
        seen = np.isfinite(self.piece.measured[self.edges[w] : self.edges[w + 1]])
        by_state = np.zeros((n, ny, e + m))
        by_state[:, :, :e] = window.by_state
        by_state[:, self.blown, e + np.arange(m)] = 1.0
        residual = window.residual.copy()
        residual[:, self.blown] += winds[:, w] * seen[:, self.blown]
        gap, by_unknown, gap_by_state = window.gap, window.gap_by_unknown, np.empty((0, e + m))
        if w + 1 < self.count:
            gap = np.concatenate([gap, winds[:, w] - winds[:, w + 1]])
            by_unknown = np.concatenate([by_unknown, np.zeros((m, by_unknown.shape[1]))])
            gap_by_state = np.block([[window.gap_by_state, np.zeros((e, m))], [np.zeros((m, e)), np.eye(m)]])
        return Window(residual, window.by_unknown, by_state, gap, by_unknown, gap_by_state)

    def some(
        self, z: FloatArray, nodes: FloatArray, back: FloatArray, which: range, entries: NDArray[np.int64]
    ) -> list[Window]:
        """Return some windows, flown side by side; `back` as :meth:`back` gives it."""
        vehicle, d = self.problem.layout.vehicle, self.problem.dimension
        steps = np.where((entries < d) & (z[entries] + STEP > 1.0), -STEP, STEP)
        Z = np.repeat(z[None, :], 1 + len(entries), axis=0)
        Z[1 + np.arange(len(entries)), entries] += steps
        rows, begin = self.problem.candidates(Z, self.index)
        sizes = FINER * move_steps(vehicle)
        rows = np.concatenate([rows, np.repeat(rows[:, :1], len(sizes), axis=1)], axis=1)
        lanes = rows.shape[1]
        own = begin if which[0] == 0 else nodes[:, which]
        moved = filtering.move(
            vehicle.kernel(),
            np.repeat(own[:, : len(which)], len(sizes), axis=1),
            np.tile(np.diag(sizes), len(which)),
        ).reshape(len(nodes), len(which), -1)
        fixed = begin[:, None] if which[0] == 0 else np.repeat(own[:, :, None], 1 + len(entries), axis=2)
        begins = np.concatenate([fixed, moved], axis=2).reshape(len(nodes), -1)
        out, last = self.fly(np.tile(rows, len(which)), begins, np.repeat(which, lanes))
        out, last = out.reshape(len(which), lanes, *out.shape[1:]), last.reshape(len(nodes), -1, lanes)
        changes = np.concatenate([steps, sizes])
        return [
            self._window(w, out[i], last[:, i], nodes, back, entries, changes, len(z))
            for i, w in enumerate(which)
        ]

    def _window(
        self,
        w: int,
        out: FloatArray,
        last: FloatArray,
        nodes: FloatArray,
        back: FloatArray,
        entries: NDArray[np.int64],
        changes: FloatArray,
        size: int,
    ) -> Window:
        """Return a window from readings (B, n, n_y) and last states (n_x, B): as it is, then after each change."""
        out = out[:, : self.edges[w + 1] - self.edges[w]]
        slopes = np.moveaxis(out[1:] - out[:1], 0, 2) / changes
        wide = np.zeros((*out[0].shape, size))
        wide[:, :, entries] = slopes[:, :, : len(entries)]
        own = self._residual(out[0], w), wide, np.ascontiguousarray(slopes[:, :, len(entries) :])
        many = len(back)
        if w + 1 == self.count:
            return Window(*own, np.empty(0), np.empty((0, size)), np.empty((0, many)))
        gaps = back[:, :, w] @ (last - nodes[:, w + 1 : w + 2])
        turned = (gaps[:, 1:] - gaps[:, :1]) / changes
        by_unknown = np.zeros((many, size))
        by_unknown[:, entries] = turned[:, : len(entries)]
        return Window(*own, gaps[:, 0], by_unknown, turned[:, len(entries) :])

    def back(self, nodes: FloatArray) -> FloatArray:
        """Return what makes moves (e, n_x, w - 1) of differences from the states that windows begin with."""
        return moves_of(self.problem.layout.vehicle, np.ascontiguousarray(nodes[:, 1:]))

    def fly(
        self, rows: FloatArray, begin: FloatArray, which: NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray]:
        """Fly windows side by side.

        Parameters
        ----------
        rows, begin : (n_p, B), (n_x, B)
        which : (B,) of int
            Window of each lane.

        Returns
        -------
        readings : (B, n, n_y)
            Those of a short window go on into the next.
        last : (n_x, B)
            States at the first sample of the next window; of the last window, at its last sample.
        """
        n, edges = len(self.piece.time), np.array(self.edges)
        record, copy = self._record(rows)
        steps = np.minimum(edges[which + 1], n - 1) - edges[which]
        vehicle = self.problem.layout.vehicle
        return windows(
            vehicle.kernel(),
            rows,
            begin,
            record,
            copy * n + edges[which],
            (copy + 1) * n,
            steps,
            self.piece.dt,
        )

    def _record(self, rows: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return inputs as they arrive, those of different delays one below the other, and which one each lane reads."""
        vehicle, inputs, dt = self.problem.layout.vehicle, self.piece.inputs, self.piece.dt
        late = rows[[row for _, row in input_delays(vehicle)]]
        if not len(late) or not np.ptp(late, axis=1).any():
            return late_inputs(vehicle, inputs, rows[:, :1], dt), np.zeros(rows.shape[1], dtype=np.int64)
        _, at, copy = np.unique(late, axis=1, return_index=True, return_inverse=True)
        lanes = late_inputs(vehicle, inputs, np.ascontiguousarray(rows[:, at]), dt)
        return np.concatenate(list(np.moveaxis(lanes, 2, 0))), copy.ravel()

    def _residual(self, readings: FloatArray, w: int) -> FloatArray:
        measured = self.piece.measured[self.edges[w] : self.edges[w + 1]]
        return residual(self.problem, readings, measured)


def residual(problem: Misfit, readings: FloatArray, measured: FloatArray) -> FloatArray:
    """Return simulated less measured (n, n_y), zero where nothing was measured."""
    seen = np.isfinite(measured)
    with np.errstate(invalid="ignore"):
        difference = (readings - np.where(seen, measured, 0.0)) * seen
    return on_circle(difference, problem.layout.vehicle.outputs)


def edges(samples: int, length: int) -> tuple[int, ...]:
    """Return where windows of about so many samples begin, and the number of samples."""
    count = max(1, round(samples / length))
    return tuple(int(e) for e in np.linspace(0, samples, count + 1).round())


def outputs_by_window(problem: Misfit, index: int) -> FloatArray:
    """Return simulated readings (n, n_y) of a piece in short windows, each begun from its measured state."""
    shots = Shots.of(problem, index)
    nodes = measured_states(shots)
    return shots.flown_from(np.concatenate([nodes, np.zeros((len(shots.blown), shots.count))]))


def measured_states(shots: Shots) -> FloatArray:
    """Return the states (n_x, w) that were measured where the windows begin."""
    piece, vehicle = shots.piece, shots.problem.layout.vehicle
    starts, at = measured_starts(shots), np.array(shots.edges[:-1])
    rows = np.repeat(parameter_rows(vehicle, piece.changes), len(at), axis=1)
    return initial_states(vehicle, starts, rows, np.ascontiguousarray(piece.inputs[at].T))


def measured_starts(shots: Shots) -> dict[str, FloatArray]:
    """Return what :func:`~stoop.simulate.initial_states` takes of every window, (w,) each."""
    piece, vehicle = shots.piece, shots.problem.layout.vehicle
    at = np.array(shots.edges[:-1])
    readings = _smoothed(piece, vehicle, at)
    still = {n: np.full(len(at), piece.start.get(n, 0.0)) for n in vehicle.start_names}
    seen = _over_ground(vehicle, piece, readings) if vehicle.hovers else readings
    return still | seen | _lags(vehicle, piece, at)


def _smoothed(piece: Piece, vehicle: Vehicle, at: NDArray[np.int64]) -> dict[str, FloatArray]:
    """Return the mean reading (w,) about each beginning, of channels that were measured at all."""
    width = max(1, round(SMOOTH / piece.dt))
    out = {}
    for i, channel in enumerate(vehicle.outputs):
        column = piece.measured[:, i]
        if channel in state_channels(vehicle) and np.isfinite(column).any():
            whole = filled(unwrapped(column))
            if vehicle.hovers:
                out[channel] = np.array([_parabola(whole, a, width) for a in at])
                continue
            smooth = np.pad(whole, width, mode="edge")
            out[channel] = np.array([smooth[a : a + 2 * width + 1].mean() for a in at])
    return out


def _parabola(column: FloatArray, at: int, width: int) -> float:
    """Return a parabola through the readings about a sample, there: rates of a multirotor turn within a tenth of a second."""
    first = max(0, at - width)
    near = column[first : at + width + 1]
    if len(near) < 2 * BENT:
        return float(near.mean())
    powers = np.vander(np.arange(len(near)) - float(at - first), BENT)
    return float(np.linalg.lstsq(powers, near, rcond=None)[0][-1])


def _over_ground(vehicle: Vehicle, piece: Piece, readings: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the motion through the air, body axes: bias and scale of the piece undone, the wind taken off."""
    rows = parameter_rows(vehicle, piece.changes)[:, 0]
    true = {c: true_value(vehicle, c, y, rows) for c, y in readings.items()}
    if not {"vn", "ve", "vd"} & set(true):
        return true
    zero = np.zeros(len(next(iter(true.values()))))
    at_start = {n: zero + piece.start.get(n, 0.0) for n in ("phi", "theta", "psi")}
    return through_air({**dict.fromkeys(("vn", "ve", "vd"), zero), **at_start, **true})


def _lags(vehicle: Vehicle, piece: Piece, at: NDArray[np.int64]) -> dict[str, FloatArray]:
    """Return by how much lagged surfaces and rotors are off their commands, (w,) each, with the file's lags."""
    names = [s.removesuffix(".lag") for s in vehicle.states if s.endswith(".lag")]
    if not names:
        return {}
    rows = parameter_rows(vehicle, piece.changes)
    inputs = late_inputs(vehicle, piece.inputs, rows, piece.dt)
    whole, early = np.repeat(rows, len(inputs), axis=1), np.repeat(rows, len(at), axis=1)
    out = {}
    for name in names:
        prefix = "rotors" if name in vehicle.rotors else f"controls.{name}"
        behind = lagged(
            commanded(vehicle, name, whole, inputs.T), float(rows[vehicle.rows[f"{prefix}.lag"], 0]), piece.dt
        )
        out[f"{name}.lag"] = behind[at] - commanded(vehicle, name, early, piece.inputs[at].T)
    return out
