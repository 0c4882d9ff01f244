"""Local refinement: Levenberg-Marquardt in the unit box with a secant Jacobian, built to be cheap in trajectories.

A Jacobian by differences costs D + E trajectories, a trial step one. So a Jacobian is kept as long as
Broyden's update carries it, and a refinement that does not come down is given up early.

References
----------
Nielsen (1999), Damping parameter in Marquardt's method, IMM-REP-1999-05 (the update of the damping).
Broyden (1965), Math. Comp. 19, 577-593 (the secant update).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.optimize.ledger import HUGE, inner, sum_of_squares
from stoop.optimize.levenberg_marquardt import (
    Damping,
    Ending,
    LinearModel,
    NielsenDamping,
    Trial,
    levenberg_marquardt,
)
from stoop.optimize.normal_equations import TallMatrix, solve_damped
from stoop.optimize.problem import Problem

AGREE: Final = 1e-3  #: relative difference of two costs that count as the same optimum
PREDICTED_WELL: Final = 0.25  #: a gain within this of the predicted one leaves the Jacobian in use
FLATTEST: Final = 1e-8  #: curvature, of a scaled problem, that differences still resolve
MIN_STEP: Final = 1e-12  #: of the unit box
FAR: Final = 2.0  #: times the cost of the known optimum: what is above is not held up by noise
SLOW_STEPS: Final = 16  #: steps in which a refinement that is far must come down by ...
SLOW_FACTOR: Final = 0.8  #: ... this factor, or it is given up


@dataclass(frozen=True)
class Settings:
    """How long a refinement is followed.

    Attributes
    ----------
    iterations : at most so many trial steps
    gain : a relative gain below this, twice running with a fresh Jacobian between, is convergence
    predicted : a predicted relative gain below this, at low damping, is convergence
    stall : give up when the last so many steps together gained less than 10 % ...
    stall_damping : ... and the damping is above this (0: whatever the damping)
    patience : give up when above the incumbent and not falling threefold in so many steps
    damping : at the start
    """

    iterations: int
    gain: float
    predicted: float
    stall: int
    stall_damping: float
    patience: int = 8
    damping: float = 0.03


FULL: Final = Settings(80, 1e-10, 1e-7, 6, 1e-3)  #: on the full record: the optimum itself
RUNG: Final = Settings(25, 1e-3, 0.0, 4, 0.0)  #: on a shortened record: near enough to try the next rung


@dataclass(frozen=True)
class Refinement:
    """Where a local refinement ended.

    Attributes
    ----------
    z : (D + E,)
    cost : on its rung
    ending : "converged", "agreed" (above the known optimum by less than AGREE, with less than that to gain),
        "stalled" (no longer falling), "hopeless" (above the incumbent and falling too
        slowly), "limit" (iterations used up) or "diverged" (no finite cost at the start)
    iterations : trial steps taken
    """

    z: FloatArray
    cost: float
    ending: Ending
    iterations: int

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
    """Minimize the sum of squares from z on one rung.

    Parameters
    ----------
    problem : Problem
    z : (D + E,), the first D are kept in [0, 1], the rest are free
    rung : int
    settings : Settings
    incumbent : float
        Best cost known on this rung; a refinement that stays above it must fall fast or is given up.
    acceptable : float
        A refinement below this cost is not given up early (inf: never): near an optimum that noise or an imperfect
        model keeps far above zero, every one falls slowly.
    optimum : float
        Cost of an optimum that another refinement converged to; this one ends as soon as it agrees with it, or falls
        slowly far above it.
    """
    model = SecantModel(problem, z, rung, settings)
    model.incumbent, model.acceptable, model.optimum = incumbent, acceptable, optimum
    damping = NielsenDamping(settings.damping, shrink=0.2)
    found = levenberg_marquardt(model, damping, max_trials=settings.iterations)
    return Refinement(model.z, model.cost, found.ending, found.trials)


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

    @property
    def optimal(self) -> bool:
        """Whether the cost is rounding."""
        return self.cost <= self.floor

    def linearize(self) -> None:
        """Take the Jacobian by differences."""
        J, _ = self.problem.jacobian(self.z, self.rung, self.r)
        self.differences = TallMatrix.of(J.T, HUGE)
        self.updates: list[tuple[FloatArray, FloatArray]] = []
        self.normal = self.differences.gram()
        self.gradient = self.differences.project(self.r)
        self.current = self.exact = True

    def step(self, damping: float) -> FloatArray | None:
        """Return the damped Gauss-Newton step inside the bounds; None where every direction is held."""
        free = self.free()
        if not free.any():
            return None
        step = np.zeros_like(self.z)
        step[free] = solve_damped(self.normal[np.ix_(free, free)], -self.gradient[free], damping)
        inside: FloatArray = np.clip(self.z + step, self.lower, self.upper) - self.z
        return inside

    def free(self) -> BoolArray:
        """Return which variables are not held at a bound that descent would cross."""
        return not_held(self.z, self.gradient, self.lower, self.upper)

    def decrement(self) -> float:
        """Return what the linear model says is left to gain, whatever the damping.

        A damped step along a flat valley promises little although much is left; only this tells them apart.
        """
        free = self.free()
        g = self.gradient[free]
        return float(g @ solve_damped(self.normal[np.ix_(free, free)], g, FLATTEST))

    def finished(self, step: FloatArray) -> Ending | Literal["renew"] | None:
        """Take a vanishing step or gain for convergence only if the Jacobian is exact; see whether the optimum is known."""
        if np.abs(step).max() < MIN_STEP:
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
        return Trial((z, r), sum_of_squares(r), predicted)

    def accept(self, trial: Trial, ratio: float) -> None:
        """Go there; keep the Jacobian by Broyden's update where it predicted well and the gain was not small."""
        z, r = trial.point
        small = self.cost - trial.cost <= self.settings.gain * self.cost
        poor = ratio < 0.25 or (trial.cost > 0.5 * self.cost and abs(ratio - 1.0) > PREDICTED_WELL)
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
        # slow where no noise excuses it: far above an optimum that is known
        far = np.isfinite(self.optimum) and past[-1] > FAR * self.optimum
        if far and len(past) > SLOW_STEPS and past[-1] > SLOW_FACTOR * past[-1 - SLOW_STEPS]:
            return "hopeless"
        if past[-1] <= self.acceptable:
            return None
        if len(past) > s.stall and past[-1] > 0.9 * past[-1 - s.stall] and damping.value > s.stall_damping:
            return "stalled"
        above = past[-1] > self.incumbent and len(past) > s.patience
        return "hopeless" if above and past[-1] > 0.3 * past[-1 - s.patience] else None


def box(problem: Any) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper bounds, (D + E,) each, of the variables of a problem."""
    wide = np.full(problem.extra, np.inf)
    lower = np.concatenate([np.zeros(problem.dimension), -wide])
    return lower, np.concatenate([np.ones(problem.dimension), wide])


def not_held(z: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray) -> BoolArray:
    """Return which variables, (n,), are not at a bound that descent would cross."""
    return np.logical_not(((z <= lower) & (gradient > 0)) | ((z >= upper) & (gradient < 0)))
