"""Quasi-Newton prey for problems of which only the cost is known: L-BFGS-B on forward differences.

Every difference is booked: a gradient is D evaluations beside the point itself.

References
----------
Byrd, Lu, Nocedal and Zhu (1995), A limited memory algorithm for bound constrained optimization, SIAM J. Sci.
Comput. 16, 1190-1208; the implementation is SciPy's.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from stoop.optimize.arrays import FloatArray
from stoop.optimize.ledger import Ledger


class _LetGo(Exception):  # noqa: N818 - not an error: the prey is not worth following
    """The dive no longer pays."""


@dataclass(frozen=True)
class QuasiNewtonDive:
    """L-BFGS-B from a member, let go where it stays above the incumbent and no longer comes down.

    Attributes
    ----------
    iterations : at most
    patience : iterations after which a dive above the incumbent must show that it will get there
    fall : share of the way that is left to the incumbent which it must gain in so many iterations
    step : of the forward differences, in the unit box
    """

    iterations: int = 200
    patience: int = 8
    fall: float = 0.05
    step: float = 1e-8

    def __call__(
        self, ledger: Ledger, x: FloatArray, cost: float, incumbent: float = np.inf
    ) -> tuple[FloatArray, float]:
        """Return the best point met from x, (D,), and its cost; never worse than the start."""
        from scipy.optimize import minimize

        path = _Path(self, ledger, x, cost, incumbent)
        options = {"maxiter": self.iterations, "maxcor": len(x), "ftol": 1e-15, "gtol": 1e-14}
        search: Any = minimize  # the stubs know no callback that takes the place alone
        box = [(0.0, 1.0)] * len(x)
        # its matrices are tiny: more threads would only wait for each other, and round differently
        with _threads().limit(limits=1, user_api="blas"), suppress(_LetGo):
            search(
                path.evaluate, x, jac=True, method="L-BFGS-B", bounds=box, callback=path.look, options=options
            )
        return path.x, path.cost


class _Path:
    """A dive under way: what it asks, and the best it met."""

    def __init__(
        self, dive: QuasiNewtonDive, ledger: Ledger, x: FloatArray, cost: float, incumbent: float
    ) -> None:
        self.dive, self.ledger, self.incumbent = dive, ledger, incumbent
        self.x, self.cost = x, cost
        self.costs = [cost]

    def evaluate(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return cost and gradient, (D,), at x; all D + 1 points are asked for at once."""
        steps = np.where(x + self.dive.step <= 1.0, self.dive.step, -self.dive.step)
        F = self.ledger.costs(np.concatenate([x[None, :], x + np.diag(steps)]), self.ledger.full)
        if not np.isfinite(F).all():
            raise _LetGo
        if F[0] < self.cost:
            self.x, self.cost = x.copy(), float(F[0])
        # the step that was taken, not the one that was wished: x + h is rounded
        return float(F[0]), (F[1:] - F[0]) / ((x + steps) - x)

    def look(self, x: FloatArray) -> None:
        """Let go where the incumbent is out of reach."""
        self.costs.append(self.cost)
        back = len(self.costs) - 1 - self.dive.patience
        if back < 0 or self.cost <= self.incumbent:
            return
        if self.costs[back] - self.cost < self.dive.fall * (self.cost - self.incumbent):
            raise _LetGo


@cache
def _threads() -> ThreadpoolController:
    """Return the handle of the BLAS libraries; finding them takes a millisecond."""
    return ThreadpoolController()
