"""The ascent of a likelihood by Fisher's scoring, damped as Levenberg and Marquardt do, within bounds.

References
----------
M. R. Osborne, "Fisher's method of scoring", *International Statistical Review* 60(1), 1992, pp. 99-117.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.estimate.filter_error.likelihood import Innovations, Likelihood

ITERATIONS: Final = 60
LEFT: Final = 1e-4  #: of -ln L that is left to gain where the ascent ends: a seventieth of a standard error
LOST: Final = 1e8  #: damping at which no step helps


@dataclass(frozen=True, eq=False)
class Ascent:
    """Where an ascent ended.

    Attributes
    ----------
    z : (k,)
    cost : float
        Twice the negative logarithm of the posterior.
    converged, interrupted : bool
    iterations : int
    history : (i, 2)
        Iterations and cost.
    """

    z: FloatArray
    cost: float
    converged: bool
    interrupted: bool
    iterations: int
    history: FloatArray


@dataclass(frozen=True, eq=False)
class Slope:
    """Gradient (k,) and Fisher's information (k, k) of the negative logarithm of the posterior."""

    gradient: FloatArray
    information: FloatArray
    pieces: tuple[Innovations, ...]


def slope(likelihood: Likelihood, z: FloatArray) -> Slope:
    """Return gradient and information at a point."""
    gradient, information = likelihood.prior(z)
    pieces = tuple(likelihood.innovations(z))
    for piece in pieces:
        gradient[piece.entries] += piece.gradient
        information[np.ix_(piece.entries, piece.entries)] += piece.information
    return Slope(gradient, information, pieces)


def ascend(likelihood: Likelihood, z: FloatArray, left: float = LEFT) -> Ascent:
    """Climb from z until so much of -ln L is left to gain; Ctrl-C keeps the best so far."""
    climb = _Climb(likelihood, z, left)
    try:
        converged = climb.run()
    except KeyboardInterrupt:
        return climb.end(converged=False, interrupted=True)
    return climb.end(converged, interrupted=False)


class _Climb:
    """The moving parts of an ascent."""

    def __init__(self, likelihood: Likelihood, z: FloatArray, enough: float) -> None:
        self.likelihood, self.enough = likelihood, enough
        self.lower, self.upper = likelihood.bounds
        self.z = np.clip(z, self.lower, self.upper)
        self.cost = likelihood.cost(self.z)
        self.damping, self.growth = 1e-3, 4.0
        self.history = [(0.0, self.cost)]

    def end(self, converged: bool, interrupted: bool) -> Ascent:
        many = len(self.history) - 1
        return Ascent(self.z, self.cost, converged, interrupted, many, np.array(self.history))

    def run(self) -> bool:
        """Return whether it converged."""
        for i in range(ITERATIONS):
            if not np.isfinite(self.cost):
                return False
            at = slope(self.likelihood, self.z)
            if self.left(at) < self.enough:
                return True
            if not self.advance(at):
                return False
            self.history.append((i + 1.0, self.cost))
        return False

    def left(self, at: Slope) -> float:
        """Return how much of -ln L is left to gain, by the quadratic model."""
        free = self.free(at.gradient)
        g = at.gradient[free]
        return 0.5 * float(g @ _solve(at.information[np.ix_(free, free)], g, 0.0))

    def free(self, gradient: FloatArray) -> NDArray[np.intp]:
        """Return the unknowns that no bound holds."""
        held = ((self.z <= self.lower) & (gradient > 0.0)) | ((self.z >= self.upper) & (gradient < 0.0))
        return np.flatnonzero(~held)

    def advance(self, at: Slope) -> bool:
        """Take a step that helps; return whether there is one."""
        free = self.free(at.gradient)
        while self.damping < LOST:
            step = np.zeros_like(self.z)
            step[free] = _solve(at.information[np.ix_(free, free)], -at.gradient[free], self.damping)
            z = np.clip(self.z + step, self.lower, self.upper)
            cost = self.likelihood.cost(z)
            if cost < self.cost:
                self.z, self.cost = z, cost
                self.damping, self.growth = max(self.damping / 10.0, 1e-9), 4.0
                return True
            self.damping, self.growth = self.damping * self.growth, 2.0 * self.growth
        self.damping = 1e-3
        return False


def _solve(information: FloatArray, right: FloatArray, damping: float) -> FloatArray:
    """Solve with the diagonal scaled to one, so that units do not matter."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    matrix = information * np.outer(scale, scale)
    matrix[np.diag_indices_from(matrix)] += max(damping, 1e-12)
    return np.asarray(scale * np.linalg.solve(matrix, scale * right))
