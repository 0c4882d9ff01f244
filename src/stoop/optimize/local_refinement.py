"""The dive: projected Levenberg-Marquardt with a secant Jacobian, built to be cheap in trajectories.

A Jacobian by differences costs D + E trajectories, a trial step one. So a Jacobian is kept as long as
Broyden's update carries it, and a prey that will not come down is let go early.

References
----------
Marquardt (1963), SIAM J. Appl. Math. 11, 431-441 (damping scaled by the diagonal).
Nielsen (1999), Damping parameter in Marquardt's method, IMM-REP-1999-05 (the update of the damping).
Broyden (1965), Math. Comp. 19, 577-593 (the secant update).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.optimize.ledger import HUGE, inner, sum_of_squares
from stoop.optimize.normal_equations import TallMatrix, solve_damped
from stoop.optimize.problem import Problem

Ending = Literal["converged", "agreed", "stalled", "hopeless", "limit", "diverged"]

AGREE: Final = 1e-3  #: relative difference of two costs that count as the same optimum
FORESEEN: Final = 0.25  #: a gain within this of the predicted one leaves the Jacobian in use
FLATTEST: Final = 1e-8  #: curvature, of a scaled problem, that differences still resolve
TINY_STEP: Final = 1e-12  #: of the unit box
LOST: Final = 1e8  #: damping beyond which no step helps any more
SMALLEST_DAMPING: Final = 1e-12
FAR: Final = 2.0  #: times the cost of the known optimum: what is above is not held up by noise
CRAWL: Final = 16  #: steps in which a dive that is far must come down by ...
CRAWLED: Final = 0.8  #: ... this factor, or it is let go


@dataclass(frozen=True)
class Settings:
    """How long a dive is followed.

    Attributes
    ----------
    iterations : at most so many trial steps
    gain : a relative gain below this, twice running with a fresh Jacobian between, is convergence
    predicted : a predicted relative gain below this, at low damping, is convergence
    stall : let go when the last so many steps together gained less than 10 % ...
    stall_damping : ... and the damping is above this (0: whatever the damping)
    patience : let go when above the incumbent and not falling threefold in so many steps
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
    """Where a dive ended.

    Attributes
    ----------
    z : (D + E,)
    cost : on the dive's rung
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
        Best cost known on this rung; a dive that stays above it must fall fast or is let go.
    acceptable : float
        A dive below this cost is not let go early (inf: never): near an optimum that noise or an imperfect
        model keeps far above zero, every dive falls slowly.
    optimum : float
        Cost of an optimum that another dive converged to; this one ends as soon as it agrees with it, or crawls
        far above it.
    """
    start = np.concatenate([np.clip(z[: problem.dimension], 0.0, 1.0), z[problem.dimension :]])
    r = problem.residuals(start[None, :], rung)[0]
    cost = sum_of_squares(r)
    if not np.isfinite(cost):
        return Refinement(start, np.inf, "diverged", 0)
    return _Descent(problem, rung, settings, incumbent, acceptable, optimum, start, r, cost).run()


class _Descent:
    """The moving parts of one dive."""

    def __init__(
        self,
        problem: Problem,
        rung: int,
        settings: Settings,
        incumbent: float,
        acceptable: float,
        optimum: float,
        z: FloatArray,
        r: FloatArray,
        cost: float,
    ) -> None:
        self.problem, self.rung, self.settings = problem, rung, settings
        self.incumbent, self.acceptable, self.optimum = incumbent, acceptable, optimum
        self.z, self.r, self.cost = z, r, cost
        self.lower = np.concatenate([np.zeros(problem.dimension), np.full(problem.extra, -np.inf)])
        self.upper = np.concatenate([np.ones(problem.dimension), np.full(problem.extra, np.inf)])
        self.floor = 1e-18 * _finite(problem.reference(rung))
        self.damping, self.growth = settings.damping, 2.0
        self.costs = [cost]
        self.slow = False  # the last gain was below settings.gain
        self.stale = True  # no Jacobian for this place
        self.fresh = False  # the Jacobian is by differences at z, not by update

    def run(self) -> Refinement:
        """Step until an ending is found."""
        for i in range(self.settings.iterations):
            ending = self.iterate()
            if ending is not None:
                return Refinement(self.z, self.cost, ending, i + 1)
        return Refinement(self.z, self.cost, "limit", self.settings.iterations)

    def iterate(self) -> Ending | None:
        """Take one trial step."""
        if self.cost <= self.floor:
            return "converged"
        if self.stale:
            self.refresh()
        step = self.propose()
        if step is None:
            return "converged"
        if np.abs(step).max() < TINY_STEP:
            return self.doubt()
        left = self.decrement()
        if left < self.settings.predicted * self.cost:
            return self.doubt()
        if self.agrees(left):
            return "agreed"
        ending = self.attempt(step, -float(2.0 * (self.gradient @ step) + step @ self.normal @ step))
        self.costs.append(self.cost)
        return ending or self.tired()

    def refresh(self) -> None:
        """Take the Jacobian by differences."""
        J, _ = self.problem.jacobian(self.z, self.rung, self.r)
        self.differences = TallMatrix.of(J.T, HUGE)
        self.updates: list[tuple[FloatArray, FloatArray]] = []
        self.normal = self.differences.gram()
        self.gradient = self.differences.project(self.r)
        self.stale, self.fresh = False, True

    def propose(self) -> FloatArray | None:
        """Return the damped Gauss-Newton step inside the bounds; None where every way is barred."""
        free = self.free()
        if not free.any():
            return None
        step = np.zeros_like(self.z)
        step[free] = solve_damped(self.normal[np.ix_(free, free)], -self.gradient[free], self.damping)
        inside: FloatArray = np.clip(self.z + step, self.lower, self.upper) - self.z
        return inside

    def free(self) -> BoolArray:
        """Return which variables are not held at a bound that descent would cross."""
        held = ((self.z <= self.lower) & (self.gradient > 0)) | ((self.z >= self.upper) & (self.gradient < 0))
        return np.logical_not(held)

    def decrement(self) -> float:
        """Return what the linear model says is left to gain, whatever the damping.

        A damped step along a flat valley promises little although much is left; only this tells them apart.
        """
        free = self.free()
        g = self.gradient[free]
        return float(g @ solve_damped(self.normal[np.ix_(free, free)], g, FLATTEST))

    def agrees(self, left: float) -> bool:
        """Whether this is as good as the known optimum to within AGREE, with little more to be gained."""
        band = AGREE * self.optimum
        return self.optimum <= self.cost <= self.optimum + band and left <= band

    def doubt(self) -> Ending | None:
        """Take a vanishing step or gain for convergence only if the Jacobian can be trusted."""
        if self.fresh:
            return "converged"
        self.stale = True
        return None

    def attempt(self, step: FloatArray, predicted: float) -> Ending | None:
        """Try the step."""
        z = self.z + step
        r = self.problem.residuals(z[None, :], self.rung)[0]
        cost = sum_of_squares(r)
        if cost < self.cost:
            return self.accept(z, r, cost, (self.cost - cost) / predicted if predicted > 0 else -1.0)
        return self.reject()

    def accept(self, z: FloatArray, r: FloatArray, cost: float, ratio: float) -> Ending | None:
        """Move, update the Jacobian, relax the damping."""
        small = self.cost - cost <= self.settings.gain * self.cost
        poor = ratio < 0.25 or (cost > 0.5 * self.cost and abs(ratio - 1.0) > FORESEEN)
        self.stale = small or poor
        if not self.stale or (small and self.slow):  # else the next step begins with new differences
            self.secant(z - self.z, r)
        self.z, self.r, self.cost = z, r, cost
        if ratio > 0:
            self.damping = max(SMALLEST_DAMPING, self.damping * max(0.2, 1.0 - (2.0 * ratio - 1.0) ** 3))
        self.growth = 2.0
        if small and self.slow:
            return self.settle()
        self.slow = small
        return None

    def secant(self, step: FloatArray, r: FloatArray) -> None:
        """Update Jacobian, normal matrix and gradient so that they explain the step just taken (Broyden).

        The Jacobian is that by differences and a few products of a miss and a step, which are never added up:
        a pass over it takes longer than a trajectory.
        """
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
        self.fresh = False

    def reject(self) -> Ending | None:
        """Stay; renew an updated Jacobian, else damp."""
        if not self.fresh:
            self.stale = True
            return None
        self.damping *= self.growth
        self.growth *= 2.0
        return self.settle() if self.damping > LOST else None

    def settle(self) -> Ending:
        """Say what it is when no step helps any more: an optimum only if little was left to gain."""
        return "converged" if self.decrement() <= AGREE * self.cost else "stalled"

    def tired(self) -> Ending | None:
        """Let go of a prey that no longer comes down."""
        s, past = self.settings, self.costs
        if self.crawls():
            return "hopeless"
        if past[-1] <= self.acceptable:
            return None
        if len(past) > s.stall and past[-1] > 0.9 * past[-1 - s.stall] and self.damping > s.stall_damping:
            return "stalled"
        above = past[-1] > self.incumbent and len(past) > s.patience
        return "hopeless" if above and past[-1] > 0.3 * past[-1 - s.patience] else None

    def crawls(self) -> bool:
        """Whether this falls slowly where no noise excuses it: far above an optimum that is known."""
        past = self.costs
        far = np.isfinite(self.optimum) and past[-1] > FAR * self.optimum
        return bool(far and len(past) > CRAWL and past[-1] > CRAWLED * past[-1 - CRAWL])


def _finite(value: float) -> float:
    """Return the value, or zero where there is none."""
    return value if np.isfinite(value) else 0.0
