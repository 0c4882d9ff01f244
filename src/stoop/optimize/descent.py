"""The long way down: Levenberg-Marquardt with geodesic acceleration, for one hard regression from a far start.

Where `refine` is built to be cheap in trajectories and to let go early, this is built to arrive: a Jacobian in
every iteration, QR instead of normal equations, steps that bend along narrow curved valleys, and a scale that
remembers, so that parameters do not run off to where nothing depends on them any more. At the end undamped
Gauss-Newton steps go on as long as they become shorter: a cost shows half of a parameter's digits at most.

References
----------
Transtrum and Sethna (2012), Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares
minimization, arXiv:1201.5885 (geodesic acceleration, eqs. 13 to 15).
More (1978), The Levenberg-Marquardt algorithm: implementation and theory, LNM 630, 105-116 (the scale).
Nielsen (1999), Damping parameter in Marquardt's method, IMM-REP-1999-05 (the update of the damping).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import lstsq

from stoop.base.arrays import BoolArray, FloatArray
from stoop.optimize.ledger import sum_of_squares
from stoop.optimize.local_refinement import LOST, SMALLEST_DAMPING, Refinement
from stoop.optimize.problem import Problem

ITERATIONS: Final = 10_000
FADING: Final = 0.8  #: of the scale from one iteration to the next; Marquardt's has 0, More's has 1
PROBE: Final = 0.1  #: of the step: where the second derivative along it is taken
BEND: Final = 0.75  #: largest acceleration against velocity that is still a correction
FLAT: Final = 1e-15  #: a relative gain below this says no more
POLISH: Final = 100  #: at most so many undamped steps
SHORTER: Final = 0.9  #: times the last one; an undamped step that is longer is rounding
ARRIVED: Final = 1e-12  #: of the cost, left to gain


@dataclass(frozen=True, eq=False)
class _Place:
    """A point with all that is known there."""

    z: FloatArray
    r: FloatArray
    cost: float
    jacobian: FloatArray
    free: BoolArray  # not held at a bound that descent would cross


def descend(problem: Problem, z: FloatArray, rung: int, iterations: int = ITERATIONS) -> Refinement:
    """Minimize the sum of squares from z on one rung, to the last digit.

    Parameters
    ----------
    problem : Problem
        With the best Jacobian that there is: digits of the answer are digits of its gradient.
    z : (D + E,), the first D are kept in [0, 1], the rest are free
    rung : int
    iterations : at most so many

    Returns
    -------
    Refinement
        Ending "converged" (less than `ARRIVED` of the cost is left to gain), "stalled" (more is left, but no
        step gains it), "limit" or "diverged".
    """
    return _Descent(problem, rung).run(z, iterations)


class _Descent:
    """The moving parts of one descent."""

    def __init__(self, problem: Problem, rung: int) -> None:
        self.problem, self.rung = problem, rung
        self.lower = np.concatenate([np.zeros(problem.dimension), np.full(problem.extra, -np.inf)])
        self.upper = np.concatenate([np.ones(problem.dimension), np.full(problem.extra, np.inf)])
        self.damping, self.growth = 0.01, 2.0
        self.scale = np.zeros(problem.dimension + problem.extra)

    def run(self, z: FloatArray, iterations: int) -> Refinement:
        """Go down, then polish."""
        z = np.clip(z, self.lower, self.upper)
        r = self.residuals(z)
        if not np.isfinite(sum_of_squares(r)):
            return Refinement(z, np.inf, "diverged", 0)
        place = self.place(z, r)
        for i in range(iterations):
            below = self.advance(place)
            if below is None or place.cost - below.cost <= FLAT * place.cost:
                return self.polished(below or place, i + 1)
            place = below
        return Refinement(place.z, place.cost, "limit", iterations)

    def residuals(self, z: FloatArray) -> FloatArray:
        """Return the residuals at a point."""
        return np.asarray(self.problem.residuals(z[None, :], self.rung)[0])

    def place(self, z: FloatArray, r: FloatArray) -> _Place:
        """Return a point with its Jacobian; a column that is not finite holds its variable."""
        J = np.array(self.problem.jacobian(z, self.rung, r)[0])
        J[:, ~np.isfinite(J).all(axis=0)] = 0.0
        gradient = np.einsum("nv,n->v", J, r)
        held = ((z <= self.lower) & (gradient > 0)) | ((z >= self.upper) & (gradient < 0))
        return _Place(z, r, sum_of_squares(r), J, ~held & (np.abs(J).max(axis=0) > 0.0))

    def advance(self, place: _Place) -> _Place | None:
        """Damp until a step lowers the cost; None where none does."""
        self.scale = np.maximum(FADING * self.scale, np.sqrt((place.jacobian**2).sum(axis=0)))
        while self.damping < LOST * LOST:
            velocity = self.solved(place, place.r)
            z = np.clip(place.z + self.bent(place, velocity), self.lower, self.upper)
            r = self.residuals(z)
            if sum_of_squares(r) < place.cost:
                self.relax(place, velocity, place.cost - sum_of_squares(r))
                return self.place(z, r)
            self.damping *= self.growth
            self.growth *= 2.0
        return None

    def relax(self, place: _Place, velocity: FloatArray, gain: float) -> None:
        """Lower the damping by how well the linear model foresaw the gain."""
        foreseen = place.cost - sum_of_squares(place.r + place.jacobian @ velocity)
        ratio = gain / foreseen if foreseen > 0.0 else 0.0
        self.damping = max(SMALLEST_DAMPING, self.damping * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3))
        self.growth = 2.0

    def bent(self, place: _Place, v: FloatArray) -> FloatArray:
        """Return velocity and acceleration together; not a number where the acceleration is more than a correction."""
        with np.errstate(over="ignore", invalid="ignore"):
            probed = (self.residuals(place.z + PROBE * v) - place.r) / PROBE
            second = 2.0 / PROBE * (probed - place.jacobian @ v)
        if not np.isfinite(second).all():
            return np.full_like(v, np.nan)
        a = self.solved(place, second)
        bend = 2.0 * np.linalg.norm(self.scale * a)
        return v + 0.5 * a if bend <= BEND * np.linalg.norm(self.scale * v) else np.full_like(v, np.nan)

    def solved(self, place: _Place, right: FloatArray) -> FloatArray:
        """Return the damped least-squares solution of J s = -right, in the free variables."""
        free = place.free
        s = np.zeros(len(free))
        damped = np.sqrt(self.damping) * np.eye(int(free.sum()))
        rows = np.vstack([place.jacobian[:, free] / self.scale[free], damped])
        s[free] = lstsq(rows, np.concatenate([-right, np.zeros(len(damped))]), lapack_driver="gelsy")[0]
        s[free] /= self.scale[free]
        return s

    def polished(self, place: _Place, iterations: int) -> Refinement:
        """Take undamped steps while they become shorter, measured by what they change in the residuals."""
        last = np.inf
        self.damping = 0.0
        for _ in range(POLISH):
            self.scale = np.maximum(np.sqrt((place.jacobian**2).sum(axis=0)), np.finfo(float).tiny)
            step = self.solved(place, place.r)
            length = sum_of_squares(place.jacobian @ step)
            if not length < SHORTER**2 * last:
                break
            z = np.clip(place.z + step, self.lower, self.upper)
            place, last = self.place(z, self.residuals(z)), length
            iterations += 1
        arrived = last <= ARRIVED * place.cost
        return Refinement(place.z, place.cost, "converged" if arrived else "stalled", iterations)
