"""Windows of a piece: what each reads, where it ends, and how both depend on what it begins with.

Axes: k = sample, i = reading, e = number of a move of the state, j = unknown of the search vector, w = window.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.cost import Misfit, Piece, on_circle
from stoop.identify.filter_error.points import move_steps, moves_of
from stoop.kernels import filtering
from stoop.simulate.delays import late_inputs

FloatArray = NDArray[np.float64]
STEP: Final = 1e-7  #: of the search vector
FINER: Final = 1e-2  #: of the steps of a linearization


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
    """

    problem: Misfit
    index: int
    edges: tuple[int, ...]

    @property
    def piece(self) -> Piece:
        """The piece."""
        return self.problem.pieces[self.index]

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.edges) - 1

    def flown(self, z: FloatArray, nodes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return readings (n, n_y), gaps (w - 1, e), and ends (n_x, w - 1), for states (n_x, w) of the beginnings.

        The first of the states is that of the search vector.
        """
        rows, start = self.problem.candidates(z[None, :], self.index)
        inputs = self._inputs(rows)
        readings, gaps, ends = [], [], []
        for w in range(self.count):
            begin = start if w == 0 else nodes[:, w : w + 1]
            out, last = self._window(rows, begin, inputs, w)
            readings.append(out[0])
            if w + 1 < self.count:
                gaps.append(self._gap(nodes, w, last)[:, 0])
                ends.append(last[:, 0])
        many = len(self.problem.layout.vehicle.moves)
        last_states = np.array(ends).reshape(-1, len(nodes)).T
        return np.concatenate(readings), np.array(gaps).reshape(-1, many), last_states

    def differentiated(self, z: FloatArray, nodes: FloatArray) -> list[Window]:
        """Return every window with its derivatives, by differences."""
        entries = [j for j, _ in self.problem.own[self.index]]
        starts = [j for j, n in self.problem.own[self.index] if not n.is_bias]
        first = np.array([*range(self.problem.dimension), *entries], dtype=np.int64)
        later = np.array([j for j in first if j not in starts], dtype=np.int64)
        return [self._differentiated(z, nodes, w, first if w == 0 else later) for w in range(self.count)]

    def _differentiated(self, z: FloatArray, nodes: FloatArray, w: int, entries: NDArray[np.int64]) -> Window:
        vehicle, d = self.problem.layout.vehicle, self.problem.dimension
        steps = np.where((entries < d) & (z[entries] + STEP > 1.0), -STEP, STEP)
        Z = np.repeat(z[None, :], 1 + len(entries), axis=0)
        Z[1 + np.arange(len(entries)), entries] += steps
        rows, begin = self.problem.candidates(Z, self.index)
        if w > 0:
            begin = np.repeat(nodes[:, w : w + 1], len(Z), axis=1)
        moves = FINER * np.diag(move_steps(vehicle))
        moved = filtering.move(vehicle.kernel(), np.repeat(begin[:, :1], len(moves), axis=1), moves)
        all_rows = np.concatenate([rows, np.repeat(rows[:, :1], len(moves), axis=1)], axis=1)
        out, last = self._window(
            all_rows, np.concatenate([begin, moved], axis=1), self._inputs(rows[:, :1]), w
        )
        slopes = np.moveaxis((out[1:] - out[:1]), 0, 2) / np.concatenate([steps, np.diag(moves)])
        wide = np.zeros((*out[0].shape, len(z)))
        wide[:, :, entries] = slopes[:, :, : len(entries)]
        gap, by_z, by_state = self._gap_slopes(nodes, w, last, entries, steps, np.diag(moves), len(z))
        return Window(self._residual(out[0], w), wide, slopes[:, :, len(entries) :], gap, by_z, by_state)

    def _gap_slopes(
        self,
        nodes: FloatArray,
        w: int,
        last: FloatArray,
        entries: NDArray[np.int64],
        steps: FloatArray,
        moves: FloatArray,
        size: int,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        many = len(moves)
        if w + 1 == self.count:
            return np.empty(0), np.empty((0, size)), np.empty((0, many))
        gaps = self._gap(nodes, w, last)
        slopes = (gaps[:, 1:] - gaps[:, :1]) / np.concatenate([steps, moves])
        wide = np.zeros((many, size))
        wide[:, entries] = slopes[:, : len(entries)]
        return gaps[:, 0], wide, slopes[:, len(entries) :]

    def _gap(self, nodes: FloatArray, w: int, last: FloatArray) -> FloatArray:
        """Return the moves (e, B) from the next window's state to where this one ends (n_x, B)."""
        back = moves_of(self.problem.layout.vehicle, nodes[:, w + 1 : w + 2])[:, :, 0]
        gap: FloatArray = back @ (last - nodes[:, w + 1 : w + 2])
        return gap

    def _window(
        self, rows: FloatArray, begin: FloatArray, inputs: FloatArray, w: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return readings (B, n, n_y) of a window, and the states (n_x, B) at the first sample of the next."""
        vehicle = self.problem.layout.vehicle
        first, end = self.edges[w], self.edges[w + 1]
        samples = slice(first, min(end + 1, len(self.piece.time)))
        own = inputs[samples]
        still = np.zeros((1, len(vehicle.moves) * len(vehicle.outputs), rows.shape[1]))
        nothing = np.zeros((len(own), len(vehicle.outputs)))
        out, states = filtering.innovations(
            vehicle.kernel(), rows, begin, still, np.zeros(len(own), dtype=np.int64), own, nothing,
            self.piece.dt, states=True,
        )  # fmt: skip
        return -out[:, : end - first], np.ascontiguousarray(states[:, -1].T)

    def _inputs(self, rows: FloatArray) -> FloatArray:
        return late_inputs(self.problem.layout.vehicle, self.piece.inputs, rows, self.piece.dt)

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
