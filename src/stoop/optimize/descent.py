"""Descent to the last digit: Levenberg-Marquardt with geodesic acceleration, for one hard regression from a far start.

Where `refine` is built to be cheap in trajectories and to give up early, this is built to converge: a Jacobian in
every iteration, QR instead of normal equations, steps that bend along narrow curved valleys, and a scale that
remembers, so that parameters do not run off to where nothing depends on them any more. At the end undamped
Gauss-Newton steps go on as long as they become shorter: a cost shows half of a parameter's digits at most.

References
----------
Transtrum and Sethna (2012), Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares
minimization, arXiv:1201.5885 (geodesic acceleration, eqs. 13 to 15).
More (1978), The Levenberg-Marquardt algorithm: implementation and theory, LNM 630, 105-116 (the scale).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import lstsq

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import sum_of_squares
from stoop.optimize.levenberg_marquardt import (
    MAX_DAMPING,
    Damping,
    Ending,
    LinearModel,
    NielsenDamping,
    Trial,
    levenberg_marquardt,
)
from stoop.optimize.local_refinement import Refinement, box, not_held
from stoop.optimize.problem import Problem

ITERATIONS: Final = 10_000
FADING: Final = 0.8  #: of the scale from one iteration to the next; Marquardt's has 0, More's has 1
FLAT: Final = 1e-15  #: a relative gain below this says no more
POLISH: Final = 100  #: at most so many undamped steps
SHORTER: Final = 0.9  #: times the last one; an undamped step that is longer is rounding
LEFT_TO_GAIN: Final = 1e-12  #: of the cost, at convergence


@dataclass(frozen=True)
class GeodesicAcceleration:
    """The second-order correction of a step along a curved valley.

    Attributes
    ----------
    probe : of the step, where the second derivative along it is taken
    largest : acceleration against velocity that is still a correction
    """

    probe: float = 0.1
    largest: float = 0.75

    def bend(self, model: QRModel, velocity: FloatArray, damping: float) -> FloatArray:
        """Return velocity and acceleration together; NaN where the acceleration is more than a correction."""
        lost = np.full_like(velocity, np.nan)
        with np.errstate(over="ignore", invalid="ignore"):
            probed = (model.residuals(model.z + self.probe * velocity) - model.r) / self.probe
            second = 2.0 / self.probe * (probed - model.jacobian @ velocity)
        if not np.isfinite(second).all():
            return lost
        a = model.solve(second, damping)
        small = 2.0 * np.linalg.norm(model.scale * a) <= self.largest * np.linalg.norm(model.scale * velocity)
        return velocity + 0.5 * a if small else lost


class QRModel(LinearModel):
    """Residuals of a `Problem` in its box, with a Jacobian at every point and damped steps by QR."""

    def __init__(
        self, problem: Problem, z: FloatArray, rung: int, acceleration: GeodesicAcceleration | None
    ) -> None:
        self.problem, self.rung, self.acceleration = problem, rung, acceleration
        self.lower, self.upper = box(problem)
        self.scale = np.zeros(problem.dimension + problem.extra)
        self.flat = False  # the last gain was rounding
        self.move_to(np.clip(z, self.lower, self.upper))

    def residuals(self, z: FloatArray) -> FloatArray:
        """Return the residuals at a point."""
        return np.asarray(self.problem.residuals(z[None, :], self.rung)[0])

    def move_to(self, z: FloatArray) -> None:
        """Go to a point."""
        self.z, self.r = z, self.residuals(z)
        self.cost = sum_of_squares(self.r)
        self.current = self.exact = False

    def linearize(self, fading: float = FADING) -> None:
        """Take the Jacobian; a column that is not finite holds its variable."""
        J = np.array(self.problem.jacobian(self.z, self.rung, self.r)[0])
        J[:, ~np.isfinite(J).all(axis=0)] = 0.0
        gradient = np.einsum("nv,n->v", J, self.r)
        self.jacobian = J
        self.free = not_held(self.z, gradient, self.lower, self.upper) & (np.abs(J).max(axis=0) > 0.0)
        self.scale = np.maximum(fading * self.scale, np.sqrt((J**2).sum(axis=0)))
        self.current = self.exact = True

    def step(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """Return the velocity, and the step with its acceleration."""
        velocity = self.solve(self.r, damping)
        bent = velocity if self.acceleration is None else self.acceleration.bend(self, velocity, damping)
        return velocity, bent

    def solve(self, right: FloatArray, damping: float) -> FloatArray:
        """Return the damped least-squares solution of J s = -right, in the free variables."""
        free = self.free
        s = np.zeros(len(free))
        damped = np.sqrt(damping) * np.eye(int(free.sum()))
        rows = np.vstack([self.jacobian[:, free] / self.scale[free], damped])
        s[free] = lstsq(rows, np.concatenate([-right, np.zeros(len(damped))]), lapack_driver="gelsy")[0]
        s[free] /= self.scale[free]
        return s

    def evaluate(self, step: tuple[FloatArray, FloatArray]) -> Trial:
        """Return the residuals after the step; the prediction is that of the velocity alone."""
        velocity, bent = step
        z = np.clip(self.z + bent, self.lower, self.upper)
        r = self.residuals(z)
        predicted = self.cost - sum_of_squares(self.r + self.jacobian @ velocity)
        return Trial((z, r), sum_of_squares(r), predicted if predicted > 0.0 else np.inf)

    def accept(self, trial: Trial, ratio: float) -> None:
        """Go there."""
        self.flat = self.cost - trial.cost <= FLAT * self.cost
        self.z, self.r = trial.point
        self.cost = trial.cost
        self.current = self.exact = False

    def stopped(self, damping: Damping) -> Ending | None:
        """End where a gain is rounding."""
        return "converged" if self.flat else None


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
        Ending "converged" (less than `LEFT_TO_GAIN` of the cost is left to gain), "stalled" (more is left, but no
        step gains it), "limit" or "diverged".
    """
    model = QRModel(problem, z, rung, GeodesicAcceleration())
    damping = NielsenDamping(0.01, largest=MAX_DAMPING**2)
    found = levenberg_marquardt(model, damping, max_steps=iterations)
    if found.ending in ("diverged", "limit"):
        cost = model.cost if found.ending == "limit" else np.inf
        return Refinement(model.z, cost, found.ending, found.steps)
    return _polish(model, found.steps + (found.ending == "stalled"))


def _polish(model: QRModel, iterations: int) -> Refinement:
    """Take undamped steps while they become shorter, measured by what they change in the residuals."""
    last, tiny = np.inf, np.finfo(float).tiny
    for _ in range(POLISH):
        if not model.current:
            model.linearize(fading=0.0)
        model.scale = np.maximum(np.sqrt((model.jacobian**2).sum(axis=0)), tiny)
        step = model.solve(model.r, 0.0)
        length = sum_of_squares(model.jacobian @ step)
        if not length < SHORTER**2 * last:
            break
        model.move_to(np.clip(model.z + step, model.lower, model.upper))
        last = length
        iterations += 1
    ending: Ending = "converged" if last <= LEFT_TO_GAIN * model.cost else "stalled"
    return Refinement(model.z, model.cost, ending, iterations)
