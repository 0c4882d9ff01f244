"""Local search from members of a population: steepest descent, Levenberg-Marquardt, quasi-Newton; the paper's prey.

Every evaluation goes through the ledger: a forward-difference gradient takes D evaluations, a central one 2 D.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from math import sqrt
from typing import Any, Final

import numpy as np
from threadpoolctl import ThreadpoolController

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.libraries import PROCESS_LOCK
from stoop.optimize.local_refinement import refine

BETA: Final = (sqrt(5.0) - 1.0) / 2.0  #: of the golden section

#: From a member, (D,), and its cost to the end of a local search and the cost there, never worse than the start.
LocalSearch = Callable[[Ledger, FloatArray, float], tuple[FloatArray, float]]


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit SciPy and NumPy to one thread: on tiny matrices more only wait, and round differently.

    One caller at a time: two threads that each restore the limit they found could leave the other's.
    """
    with PROCESS_LOCK, _blas_threads().limit(limits=1, user_api="blas"):
        yield


@cache
def _blas_threads() -> ThreadpoolController:
    """Return the handle of the BLAS libraries; finding them takes a millisecond, and they must be loaded."""
    importlib.import_module("scipy.optimize")
    return ThreadpoolController()


@dataclass(frozen=True)
class PreySchedule:
    """When the best members are the starts of a local search, in place of a generation."""

    search: LocalSearch  #: the local search
    period: int = 20  #: generations from one local search to the next (the paper's NC)
    share: float = 0.05  #: of the members from which it starts (the paper's pr)
    #: evolve every `period` generations and search locally in all others: the paper's steps 4 and 5 as printed
    swapped: bool = False

    def due(self, generation: int) -> bool:
        """Whether a generation, counted from 1, is one of local search."""
        return (generation % self.period == 0) != self.swapped

    def number(self, members: int) -> int:
        """Return from how many members a local search starts; half a member counts as one."""
        return max(1, int(np.floor(self.share * members + 0.5)))

    def refine(self, ledger: Ledger, X: FloatArray, F: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return members (n, D) and costs (n,) after a local search from each of the best."""
        X, F = X.copy(), F.copy()
        for i in np.argsort(F, kind="stable")[: self.number(len(X))]:
            X[i], F[i] = self.search(ledger, X[i].copy(), float(F[i]))
        return X, F


def golden_section(function: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Return the middle of the last two points of a golden-section search for a minimum.

    The paper's Fig. 2, with the evaluation that its first branch leaves out: the interval shrinks until the
    two inner points are nearer than `tolerance`.
    """
    right = low + BETA * (high - low)
    left = low + high - right
    f_right, f_left = function(right), function(left)
    while abs(left - right) >= tolerance:
        if f_left <= f_right:
            high, right, f_right = right, left, f_left
            left = low + high - right
            f_left = function(left)
        else:
            low, left, f_left = left, right, f_right
            right = low + BETA * (high - low)
            f_right = function(right)
    return 0.5 * (left + right)


def forward_gradient(ledger: Ledger, x: FloatArray, cost: float) -> FloatArray:
    """Return the gradient of the cost by forward differences, backward at an upper bound; D evaluations."""
    steps = np.where(x + 1e-6 <= 1.0, 1e-6, -1e-6)  # a cost is rounded more coarsely than a residual
    with np.errstate(invalid="ignore"):
        gradient: FloatArray = (ledger.costs(x + np.diag(steps), ledger.full) - cost) / steps
    return gradient


def steepest_line(ledger: Ledger, x: FloatArray, cost: float) -> Callable[[float], FloatArray] | None:
    """Return the points of the unit box along the negative gradient from x, by distance; None without a gradient."""
    gradient = forward_gradient(ledger, x, cost)
    length = float(np.sqrt((gradient * gradient).sum()))
    if not np.isfinite(length) or length == 0.0:
        return None
    return lambda t: np.clip(x - t * gradient / length, 0.0, 1.0)


@dataclass(frozen=True)
class SteepestDescent:
    """The paper's local search (section IV.C): one golden-section step down the gradient, kept if it improves."""

    reach: float = 0.1  #: length of the line along the unit negative gradient, in the unit box
    tolerance: float = 0.1  #: of the search, relative to the reach

    def __call__(self, ledger: Ledger, x: FloatArray, cost: float) -> tuple[FloatArray, float]:
        """Return the end of the step from x, and the cost there."""
        line = steepest_line(ledger, x, cost)
        if line is None:
            return x, cost

        def cost_at(t: float) -> float:
            return float(ledger.costs(line(t)[None, :], ledger.full)[0])

        t = golden_section(cost_at, 0.0, self.reach, self.tolerance * self.reach)
        end = cost_at(t)
        return (line(t), end) if end < cost else (x, cost)


@dataclass(frozen=True)
class LevenbergMarquardt:
    """Levenberg-Marquardt on the full record, for problems that have residuals.

    Nuisances are free on the way down; a member is compared, and kept, with them at zero.
    """

    def __call__(
        self, ledger: Ledger, x: FloatArray, cost: float, incumbent: float = np.inf
    ) -> tuple[FloatArray, float]:
        """Return the end of the descent from x, (D,), and the cost there; one far above the incumbent is given up."""
        z = np.concatenate([x, np.zeros(ledger.extra)])
        end = refine(ledger, z, ledger.full, incumbent=incumbent)
        y = end.z[: len(x)]
        lower = float(ledger.costs(y[None, :], ledger.full)[0]) if ledger.extra else end.cost
        return (y, lower) if lower < cost else (x, cost)


class _Abandoned(Exception):  # noqa: N818 - not an error: the descent no longer pays
    """The descent is given up."""


@dataclass(frozen=True)
class QuasiNewton:
    """L-BFGS-B from a member, given up where it stays above the incumbent and its descent slows down.

    Forward differences first. Where they lead below the incumbent, central ones go on from there: in a narrow
    valley a forward difference is no longer accurate enough.

    References
    ----------
    Byrd, Lu, Nocedal and Zhu (1995), A limited memory algorithm for bound constrained optimization, SIAM J. Sci.
    Comput. 16, 1190-1208; the implementation is SciPy's.
    """

    iterations: int = 200  #: at most
    #: iterations after which a descent above the incumbent must show that it will get there
    patience: int = 8
    #: share of the way that is left to the incumbent which it must gain in so many iterations
    fall: float = 0.05
    step: float = 1e-8  #: of the forward differences, in the unit box
    wide: float = 1e-7  #: of the central differences

    def __call__(
        self, ledger: Ledger, x: FloatArray, cost: float, incumbent: float = np.inf
    ) -> tuple[FloatArray, float]:
        """Return the best point of a descent from x, (D,), and its cost; never worse than the start."""
        from scipy.optimize import minimize

        D, costs = len(x), [cost]  # of the best point, by iteration

        def evaluated(X: FloatArray) -> FloatArray:
            """Return the costs of a point and of those about it; the best of the points is remembered."""
            nonlocal x, cost
            F = ledger.costs(X, ledger.full)
            if not np.isfinite(F).all():
                raise _Abandoned
            if F[0] < cost:
                x, cost = X[0].copy(), float(F[0])
            return F

        def forward(y: FloatArray) -> tuple[float, FloatArray]:
            """Return cost and gradient, (D,), by forward differences, backward at an upper bound."""
            h = np.where(y + self.step <= 1.0, self.step, -self.step)
            F = evaluated(np.concatenate([y[None, :], y + np.diag(h)]))
            # the step that was taken, not the one that was wished: y + h is rounded
            return float(F[0]), (F[1:] - F[0]) / ((y + h) - y)

        def central(y: FloatArray) -> tuple[float, FloatArray]:
            """Return cost and gradient, (D,), by central differences, cut short at a bound."""
            high, low = np.minimum(y + self.wide, 1.0), np.maximum(y - self.wide, 0.0)
            F = evaluated(np.concatenate([y[None, :], y + np.diag(high - y), y + np.diag(low - y)]))
            return float(F[0]), (F[1 : D + 1] - F[D + 1 :]) / (high - low)

        def check(_: FloatArray) -> None:
            """Give up where the incumbent is out of reach."""
            costs.append(cost)
            if len(costs) <= self.patience or cost <= incumbent:
                return
            if costs[-1 - self.patience] - cost < self.fall * (cost - incumbent):
                raise _Abandoned

        search: Any = minimize  # the stubs know no callback that takes the place alone
        options = {"maxiter": self.iterations, "maxcor": D, "ftol": 1e-15, "gtol": 1e-14}
        settings = {"method": "L-BFGS-B", "bounds": [(0.0, 1.0)] * D, "callback": check, "options": options}
        with one_blas_thread(), suppress(_Abandoned):
            search(forward, x, jac=True, **settings)
            if cost < incumbent:
                search(central, x, jac=True, **settings)
        return x, cost
