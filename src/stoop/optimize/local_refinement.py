"""Local refinement by Levenberg-Marquardt in the unit box: `refine` is cheap, `descend` converges to the last digit.

`refine`: a Jacobian by differences costs D + E trajectories, a trial step one. So a Jacobian is kept as long as
Broyden's update carries it, and a refinement that does not come down is given up early. Where the model leaves much
unexplained, Gauss-Newton steps crawl: the curvature that they lack is learned from gradients at Jacobians by differences,
and counts where the cost that it foretold was nearer than theirs.

`descend` is for one hard regression from a far start: a Jacobian in every iteration, QR instead of normal equations,
geodesic acceleration along narrow curved valleys, and a scale that remembers, so that parameters do not run off to where
nothing depends on them any more. At the end undamped Gauss-Newton steps go on as long as they become shorter: a cost shows
half of a parameter's digits at most.

References
----------
Nielsen (1999), Damping parameter in Marquardt's method, IMM-REP-1999-05 (the update of the damping).
Broyden (1965), Math. Comp. 19, 577-593 (the secant update).
Dennis, Gay and Welsch (1981), ACM Trans. Math. Softw. 7, 348-368 (what Gauss-Newton lacks, and when it counts).
Transtrum and Sethna (2012), Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares
minimization, arXiv:1201.5885 (geodesic acceleration, eqs. 13 to 15).
More (1978), The Levenberg-Marquardt algorithm: implementation and theory, LNM 630, 105-116 (the scale).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from scipy.linalg import lstsq

from stoop.base.arrays import BoolArray, FloatArray
from stoop.optimize.ledger import HUGE, inner, sum_of_squares
from stoop.optimize.levenberg_marquardt import (
    MAX_DAMPING,
    Damping,
    Ending,
    LinearModel,
    NielsenDamping,
    Trial,
    levenberg_marquardt,
)
from stoop.optimize.normal_equations import dense, solve_damped, tall
from stoop.optimize.problem import Problem
from stoop.optimize.secant import Secant

AGREE: Final = 1e-3  #: relative difference of two costs that count as the same optimum


@dataclass(frozen=True)
class Settings:
    """How long a refinement is followed."""

    iterations: int  #: at most so many trial steps
    gain: float  #: a relative gain below this, twice running with a fresh Jacobian between, is convergence
    predicted: float  #: a predicted relative gain below this, at low damping, is convergence
    stall: int  #: give up when the last so many steps together gained less than 10 % ...
    stall_damping: float  #: ... and the damping is above this (0: whatever the damping)
    patience: int = 8  #: give up when above the incumbent and not falling threefold in so many steps
    damping: float = 0.03  #: at the start


FULL: Final = Settings(80, 1e-10, 1e-7, 6, 1e-3)  #: on the full record: the optimum itself
RUNG: Final = Settings(25, 1e-3, 0.0, 4, 0.0)  #: on a shortened record: near enough to try the next rung


@dataclass(frozen=True)
class Refinement:
    """Where a local refinement ended."""

    z: FloatArray  #: (D + E,)
    cost: float  #: on its rung
    #: "converged", "agreed" (above the known optimum by less than AGREE, with less than that to gain), "stalled" (no longer
    #: falling), "hopeless" (above the incumbent and falling too slowly), "limit" (iterations used up) or "diverged" (no
    #: finite cost at the start)
    ending: Ending
    iterations: int  #: trial steps taken

    @property
    def converged(self) -> bool:
        """Whether the end is a local optimum of its own."""
        return self.ending == "converged"


def refine(
    problem: Problem,
    z: FloatArray,
    rung: int,
    settings: Settings = FULL,
    incumbent: float = np.inf,
    acceptable: float = np.inf,
    optimum: float = np.inf,
) -> Refinement:
    """Minimize the sum of squares from z on one rung, cheaply.

    Parameters
    ----------
    problem, rung, settings
    z : (D + E,), the first D are kept in [0, 1], the rest are free
    incumbent : best cost known on this rung; a refinement that stays above it must fall fast or is given up
    acceptable : a refinement below this cost is not given up early (inf: never): near an optimum that noise or an imperfect
        model keeps far above zero, every one falls slowly
    optimum : cost of an optimum that another refinement converged to; this one ends as soon as it agrees with it, or falls
        slowly far above it
    """
    model = SecantModel(problem, z, rung, settings)
    model.incumbent, model.acceptable, model.optimum = incumbent, acceptable, optimum
    damping = NielsenDamping(settings.damping, shrink=0.2)
    found = levenberg_marquardt(model, damping, max_trials=settings.iterations)
    return Refinement(model.z, model.cost, found.ending, found.trials)


def box(problem: Any) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper bounds, (D + E,) each, of the variables of a problem."""
    wide = np.full(problem.extra, np.inf)
    return np.append(np.zeros(problem.dimension), -wide), np.append(np.ones(problem.dimension), wide)


def not_held(z: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray) -> BoolArray:
    """Return which variables, (n,), are not at a bound that descent would cross."""
    return np.logical_not(((z <= lower) & (gradient > 0)) | ((z >= upper) & (gradient < 0)))


class SecantModel(LinearModel):
    """Residuals of a `Problem` in its box, with a Jacobian by differences that Broyden's update carries along.

    The Jacobian is that by differences and a few products of a miss and a step, which are never added up: a pass over it
    takes longer than a trajectory.
    """

    def __init__(self, problem: Problem, z: FloatArray, rung: int, settings: Settings) -> None:
        self.problem, self.rung, self.settings = problem, rung, settings
        self.lower, self.upper = box(problem)
        self.z = np.clip(z, self.lower, self.upper)
        self.r = problem.residuals(self.z[None, :], rung)[0]
        self.cost = sum_of_squares(self.r)
        self.incumbent = self.acceptable = self.optimum = np.inf
        reference = problem.reference(rung) if np.isfinite(self.cost) else 0.0
        self.floor = 1e-18 * (reference if np.isfinite(reference) else 0.0)
        self.costs = [self.cost]
        self.slow = False  # the last gain was below settings.gain
        self.flat = False  # the last two were
        self.secant = Secant.none(len(self.z))
        self.corrects = False  # whether the secant's correction counts

    @property
    def optimal(self) -> bool:
        """Whether the cost is rounding."""
        return self.cost <= self.floor

    def linearize(self) -> None:
        """Take the Jacobian by differences."""
        J, _ = self.problem.jacobian(self.z, self.rung, self.r)
        self.differences = tall(J).below(HUGE)
        self.updates: list[tuple[FloatArray, FloatArray]] = []
        self.normal = self.differences.gram()
        self.gradient = self.differences.project(self.r)
        self.secant = self.secant.at(self.z, self.gradient, self.normal)
        self.current = self.exact = True

    def curvature(self, free: BoolArray) -> FloatArray:
        """Return the Gauss-Newton matrix of free variables, with what it lacks where that foretold the last cost better."""
        if self.corrects:
            return self.secant.corrected(self.normal, free)
        return self.normal[np.ix_(free, free)]

    def step(self, damping: float) -> FloatArray | None:
        """Return the damped step inside the bounds; None where every direction is held."""
        free = not_held(self.z, self.gradient, self.lower, self.upper)
        if not free.any():
            return None
        step = np.zeros_like(self.z)
        step[free] = solve_damped(self.curvature(free), -self.gradient[free], damping)
        inside: FloatArray = np.clip(self.z + step, self.lower, self.upper) - self.z
        return inside

    def decrement(self) -> float:
        """Return what the linear model says is left to gain, whatever the damping.

        A damped step along a flat valley promises little although much is left; only this tells them apart.
        """
        free = not_held(self.z, self.gradient, self.lower, self.upper)
        g = self.gradient[free]
        # 1e-8: curvature, of a scaled problem, that differences still resolve
        return float(g @ solve_damped(self.curvature(free), g, 1e-8))

    def finished(self, step: FloatArray) -> Ending | Literal["renew"] | None:
        """Take a vanishing step or gain for convergence only if the Jacobian is exact; see whether the optimum is known."""
        if np.abs(step).max() < 1e-12:
            return "converged" if self.exact else "renew"
        left, band = self.decrement(), AGREE * self.optimum
        if left < self.settings.predicted * self.cost:
            return "converged" if self.exact else "renew"
        agrees = self.optimum <= self.cost <= self.optimum + band and left <= band
        return "agreed" if agrees else None

    def evaluate(self, step: FloatArray) -> Trial:
        """Return the residuals after the step."""
        z = self.z + step
        r = self.problem.residuals(z[None, :], self.rung)[0]
        predicted = -float(2.0 * (self.gradient @ step) + step @ self.normal @ step)
        missing, cost = float(step @ self.secant.correction @ step), sum_of_squares(r)
        off = self.cost - cost - predicted  # by how much Gauss-Newton promises too little
        # fewer residuals than variables are a cost in disguise: at any of its local minima refinements would agree
        self.corrects = len(r) >= len(z) and abs(off + missing) < abs(off)
        return Trial((z, r), cost, predicted)

    def accept(self, trial: Trial, ratio: float) -> None:
        """Go there; keep the Jacobian by Broyden's update where it predicted the gain to a quarter and the gain was not small."""
        z, r = trial.point
        small = self.cost - trial.cost <= self.settings.gain * self.cost
        poor = ratio < 0.25 or (trial.cost > 0.5 * self.cost and abs(ratio - 1.0) > 0.25)
        self.flat = small and self.slow
        self.current = not (small or poor)
        if self.current or self.flat:  # else the next step begins with new differences
            self._update(z - self.z, r)
        self.z, self.r, self.cost, self.slow = z, r, trial.cost, small

    def _update(self, step: FloatArray, r: FloatArray) -> None:
        """Update Jacobian, normal matrix and gradient so that they explain the step just taken (Broyden)."""
        square = float(step @ step)
        miss, gradient = r - self.r - self.differences.apply(step), self.differences.project(r)
        for earlier, missed in self.updates:
            miss -= missed * float(earlier @ step)
            gradient += earlier * inner(missed, r)
        miss /= square
        w = np.outer(step, (gradient - self.gradient - self.normal @ step) / square)
        self.normal = self.normal + w + w.T + sum_of_squares(miss) * np.outer(step, step)
        self.gradient = gradient + step * inner(miss, r)
        self.updates.append((step, miss))
        self.exact = False

    def settled(self) -> Ending:
        """Return an optimum only if little was left to gain."""
        return "converged" if self.decrement() <= AGREE * self.cost else "stalled"

    def stopped(self, damping: Damping) -> Ending | None:
        """End where gains vanish, and give up a refinement that no longer comes down."""
        s, past = self.settings, self.costs
        past.append(self.cost)
        if self.flat:
            return self.settled()
        # twice above a known optimum no noise excuses a fall by less than a fifth in 16 steps
        far = np.isfinite(self.optimum) and past[-1] > 2.0 * self.optimum
        if far and len(past) > 16 and past[-1] > 0.8 * past[-17]:
            return "hopeless"
        if past[-1] <= self.acceptable:
            return None
        if len(past) > s.stall and past[-1] > 0.9 * past[-1 - s.stall] and damping.value > s.stall_damping:
            return "stalled"
        above = past[-1] > self.incumbent and len(past) > s.patience
        return "hopeless" if above and past[-1] > 0.3 * past[-1 - s.patience] else None


def descend(problem: Problem, z: FloatArray, rung: int, iterations: int = 10_000) -> Refinement:
    """Minimize the sum of squares from z on one rung, to the last digit.

    The problem should have the best Jacobian that there is: digits of the answer are digits of its gradient. The first D of z,
    (D + E,), are kept in [0, 1]. The ending is "converged" (less than 1e-12 of the cost is left to gain), "stalled" (more is
    left, but no step gains it), "limit" or "diverged".
    """
    model = QRModel(problem, z, rung)
    damping = NielsenDamping(0.01, largest=MAX_DAMPING**2)
    found = levenberg_marquardt(model, damping, max_steps=iterations)
    if found.ending in ("diverged", "limit"):
        cost = model.cost if found.ending == "limit" else np.inf
        return Refinement(model.z, cost, found.ending, found.steps)
    # undamped steps while they become shorter, measured by what they change in the residuals
    steps, last = found.steps + (found.ending == "stalled"), np.inf
    for _ in range(100):
        if not model.current:
            model.linearize(fading=0.0)
        model.scale = np.maximum(np.sqrt((model.jacobian**2).sum(axis=0)), np.finfo(float).tiny)
        step = model.solve(model.r, 0.0)
        length = sum_of_squares(model.jacobian @ step)
        if not length < 0.9**2 * last:  # a step that is longer is rounding
            break
        model.move_to(np.clip(model.z + step, model.lower, model.upper))
        last = length
        steps += 1
    return Refinement(model.z, model.cost, "converged" if last <= 1e-12 * model.cost else "stalled", steps)


class QRModel(LinearModel):
    """Residuals of a `Problem` in its box, with a Jacobian at every point and geodesic steps by QR."""

    def __init__(self, problem: Problem, z: FloatArray, rung: int) -> None:
        self.problem, self.rung = problem, rung
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

    def linearize(self, fading: float = 0.8) -> None:
        """Take the Jacobian; a column that is not finite holds its variable.

        The scale fades from one iteration to the next; Marquardt's has a fading of 0, More's of 1.
        """
        J = np.array(dense(self.problem.jacobian(self.z, self.rung, self.r)[0]))
        J[:, ~np.isfinite(J).all(axis=0)] = 0.0
        gradient = np.einsum("nv,n->v", J, self.r)
        self.jacobian = J
        self.free = not_held(self.z, gradient, self.lower, self.upper) & (np.abs(J).max(axis=0) > 0.0)
        self.scale = np.maximum(fading * self.scale, np.sqrt((J**2).sum(axis=0)))
        self.current = self.exact = True

    def step(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """Return the velocity, and the step with its acceleration; NaN where that is more than a correction.

        The second derivative along the velocity is taken a tenth of it away.
        """
        velocity, probe = self.solve(self.r, damping), 0.1
        lost = np.full_like(velocity, np.nan)
        with np.errstate(over="ignore", invalid="ignore"):
            probed = (self.residuals(self.z + probe * velocity) - self.r) / probe
            second = 2.0 / probe * (probed - self.jacobian @ velocity)
        if not np.isfinite(second).all():
            return velocity, lost
        a = self.solve(second, damping)
        small = 2.0 * np.linalg.norm(self.scale * a) <= 0.75 * np.linalg.norm(self.scale * velocity)
        return velocity, velocity + 0.5 * a if small else lost

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
        self.flat = self.cost - trial.cost <= 1e-15 * self.cost
        self.z, self.r = trial.point
        self.cost = trial.cost
        self.current = self.exact = False

    def stopped(self, damping: Damping) -> Ending | None:
        """End where a gain is rounding."""
        return "converged" if self.flat else None
