"""The ledger: counts every trajectory, keeps the best, and ends a run at its budget or target.

Every optimizer reaches the problem through a ledger only, so that counting is the same for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.normal_equations import Jacobian
from stoop.optimize.problem import Problem

HUGE: Final = 1e100  #: a cost beyond this is infinite: its products would overflow


class Halt(Exception):  # noqa: N818 - not an error: the run ends here
    """A run ends inside a step; `status` says why."""

    def __init__(self, status: Literal["budget", "target"]) -> None:
        super().__init__(status)
        self.status: Literal["budget", "target"] = status


@dataclass(frozen=True)
class Evaluations:
    """What has been evaluated and the best of it."""

    trajectories: float  #: of the full record
    best: FloatArray  #: (D + E,), best point on the full record; the center of the box before there is one
    cost: float  #: of the best; inf before there is one
    #: (k, 2), trajectories spent and best cost, one row per improvement, in the order of a batch's candidates
    history: FloatArray

    @classmethod
    def none(cls, problem: Problem) -> Evaluations:
        """Return the count of a run that has not begun."""
        center = np.concatenate([np.full(problem.dimension, 0.5), np.zeros(problem.extra)])
        return cls(0.0, center, np.inf, np.empty((0, 2)))


class Ledger:
    """A problem that counts what it is asked, from the given evaluations on; itself a `Problem`.

    A call that would exceed the budget, in trajectories, raises `Halt` ("budget") after spending what is left; reaching the
    target, a cost on the full record, raises `Halt` ("target").
    """

    def __init__(
        self,
        problem: Problem,
        evaluations: Evaluations | None = None,
        budget: float = np.inf,
        target: float = -np.inf,
    ) -> None:
        self.problem = problem
        self.budget = budget
        self.target = target
        self.dimension = problem.dimension
        self.extra = problem.extra
        self.prices = problem.prices
        self.full = len(problem.prices) - 1
        self.rewind(Evaluations.none(problem) if evaluations is None else evaluations)

    @classmethod
    def at(cls, problem: Problem, evaluations: Evaluations) -> Ledger:
        """Return a ledger at the given count: the problem itself, rewound, if it is one already."""
        if isinstance(problem, Ledger):
            problem.rewind(evaluations)
            return problem
        return cls(problem, evaluations)

    def rewind(self, evaluations: Evaluations) -> None:
        """Go back to the given count."""
        self.spent = evaluations.trajectories
        self.best = evaluations.best
        self.cost = evaluations.cost
        self._earlier = evaluations.history
        self._improvements: list[tuple[float, float]] = []

    @property
    def evaluations(self) -> Evaluations:
        """The count as it stands."""
        history = self._earlier
        if self._improvements:
            history = np.concatenate([history, np.array(self._improvements)])
        return Evaluations(self.spent, self.best, self.cost, history)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return and count costs; whatever is not finite becomes inf."""
        price = self.prices[rung]
        room = self._room(price)
        F = np.asarray(self.problem.costs(X[:room] if room < len(X) else X, rung), dtype=np.float64)
        F = np.where(np.isfinite(F), F, np.inf)
        before = self.spent
        self.spent = before + len(F) * price
        if rung == self.full:
            # each improvement counts at the candidate's own place in the batch
            least = np.minimum.accumulate(np.concatenate([[self.cost], F]))
            for i in np.flatnonzero(least[1:] < least[:-1]).tolist():
                place = before + (i + 1) * price
                if F[i] <= self.target:
                    self.spent = place  # the run ends here: the rest of the batch was not needed
                self._offer(np.concatenate([X[i], np.zeros(self.extra)]), float(F[i]), place)
        if room < len(X):
            raise Halt("budget")
        return F

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return and count residuals."""
        if self._room(self.prices[rung]) < len(Z):
            raise Halt("budget")
        R = np.asarray(self.problem.residuals(Z, rung), dtype=np.float64)
        for z, r in zip(Z, R, strict=True):
            self.spent += self.prices[rung]
            if rung == self.full:
                self._offer(z, sum_of_squares(r), self.spent)
        return R

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[Jacobian, float]:
        """Return and count a Jacobian."""
        if self._room(self.prices[rung]) < len(z):
            raise Halt("budget")
        J, spent = self.problem.jacobian(z, rung, r)
        self.spent += spent
        return J, spent

    def reference(self, rung: int) -> float:
        """Return the cost of the trivial model; inf where it has none."""
        value = float(self.problem.reference(rung))
        return value if np.isfinite(value) else np.inf

    def _room(self, price: float) -> int:
        """Return how many trajectories at this price the budget still pays for."""
        left = (self.budget - self.spent) / price + 1e-9  # rounding of summed prices
        if left < 1.0:
            raise Halt("budget")
        return int(min(left, 2.0**62))

    def _offer(self, z: FloatArray, cost: float, place: float) -> None:
        """Keep z, evaluated at a place of the count, if it is the best so far."""
        if not cost < self.cost:
            return
        self.best, self.cost = z.copy(), cost
        self._improvements.append((place, cost))
        if cost <= self.target:
            raise Halt("target")


def sum_of_squares(r: FloatArray) -> float:
    """Return the cost of a row of residuals; inf where it is not finite, or huge."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = inner(r, r)
    return total if total < HUGE else np.inf


def inner(a: FloatArray, b: FloatArray) -> float:
    """Return the sum of products; by einsum, as a threaded dot product rounds by the number of threads."""
    return float(np.einsum("i,i->", a, b))
