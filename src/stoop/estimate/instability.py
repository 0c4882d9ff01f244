"""How fast errors of the state grow in an open-loop simulation, and with it whether a window can be simulated at all.

An error of the initial state or of the equations grows as exp(s t), with s the largest real part of the eigenvalues of the model
linearized along what was measured. Where it grows by a hundred over a window, an error of the size of the sensors' noise
becomes as large as the motion: the simulation leaves the record whatever is estimated, and the cost has ravines and local
minima. Windows must then be short (multiple shooting), or measurements must correct the states (stabilized output error).

References
----------
R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., AIAA, 2015, chapter 9 (unstable aircraft).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.fit import DEFAULTS, estimation_problem, starts
from stoop.estimate.linearization import linearized, measured_points
from stoop.flight import Flight
from stoop.problem import Misfit, Piece
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

#: growth of an error from which a window cannot be simulated open loop. Of simulated aircraft with Cmalpha of 0.5, 0.75 and
#: 1.0 (growth 400, 1e4 and 5e5 over 15 s) output error confirmed no optimum; below 100 it did
MAX_GROWTH: Final = 100.0
#: growth over a prediction: its initial state, from a second of record, is about ten times as accurate as a reading
PREDICTED_GROWTH: Final = 10.0


@dataclass(frozen=True)
class Growth:
    """Growth of errors of the state over the window where it is largest."""

    rate: float  #: 1/s
    seconds: float  #: of the window

    @property
    def factor(self) -> float:
        """By how much an error grows; infinite where that is no number."""
        return float(np.exp(min(self.rate * self.seconds, 700.0)))

    @property
    def excessive(self) -> bool:
        """Whether the window cannot be simulated open loop."""
        return self.factor > MAX_GROWTH

    @property
    def horizon(self) -> float:
        """Time over which a prediction is worth a comparison, s; infinite where errors do not grow."""
        return float(np.log(PREDICTED_GROWTH)) / self.rate if self.rate > 0.0 else np.inf


def growth(vehicle: Vehicle, piece: Piece, rows: FloatArray) -> Growth:
    """Return the growth of errors over a piece with the kernel's parameters (n_p, 1)."""
    at = measured_points(vehicle, piece, np.zeros(len(piece.time), dtype=np.int64))
    transition = linearized(vehicle, rows, at.states[:, :, None], at.inputs, piece.dt).transition[0, 0]
    finite = np.isfinite(transition).all()
    largest = float(np.max(np.abs(np.linalg.eigvals(transition)))) if finite else np.inf
    return Growth(float(np.log(largest)) / piece.dt, float(piece.time[-1] - piece.time[0]))


def largest_growth(problem: Misfit, z: FloatArray) -> Growth:
    """Return the largest growth over the pieces of a problem at a search vector (D + E,)."""
    rows = [problem.candidates(z[None, :], i)[0] for i in range(len(problem.pieces))]
    pairs = zip(problem.pieces, rows, strict=True)
    each = [growth(problem.layout.vehicle, piece, own) for piece, own in pairs]
    return max(each, key=lambda one: one.rate * one.seconds)


def growth_at_start(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> Growth:
    """Return the largest growth over windows at the start where it is smaller: the file's values or the regression.

    Where a window excites little, the regression makes stable vehicles unstable; one that is unstable is so by both.
    """
    problem, _ = estimation_problem(vehicle, flights, windows, DEFAULTS)
    nuisances = np.zeros(problem.extra)
    each = [largest_growth(problem, np.concatenate([x, nuisances])) for x in starts(problem)]
    return min(each, key=lambda one: one.rate * one.seconds)
