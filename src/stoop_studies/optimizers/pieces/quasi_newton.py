"""Quasi-Newton prey for problems of which only the cost is known: L-BFGS-B on differences of the cost.

Every difference is booked: a gradient is D evaluations beside the point itself, or 2 D where it must be exact.

References
----------
Byrd, Lu, Nocedal and Zhu (1995), A limited memory algorithm for bound constrained optimization, SIAM J. Sci.
Comput. 16, 1190-1208; the implementation is SciPy's.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.libraries import one_blas_thread


class _LetGo(Exception):  # noqa: N818 - not an error: the prey is not worth following
    """The dive no longer pays."""


@dataclass(frozen=True)
class QuasiNewtonDive:
    """L-BFGS-B from a member, let go where it stays above the incumbent and no longer comes down.

    Forward differences first. Where they lead below the incumbent, central ones go on from there: in a narrow
    valley a forward difference no longer knows where the floor is.

    Attributes
    ----------
    iterations : at most
    patience : iterations after which a dive above the incumbent must show that it will get there
    fall : share of the way that is left to the incumbent which it must gain in so many iterations
    step : of the forward differences, in the unit box
    wide : of the central differences
    """

    iterations: int = 200
    patience: int = 8
    fall: float = 0.05
    step: float = 1e-8
    wide: float = 1e-7

    def __call__(
        self, ledger: Ledger, x: FloatArray, cost: float, incumbent: float = np.inf
    ) -> tuple[FloatArray, float]:
        """Return the best point met from x, (D,), and its cost; never worse than the start."""
        path = _Path(self, ledger, x, cost, incumbent)
        with one_blas_thread(), suppress(_LetGo):
            path.descend(path.forward)
            if path.cost < incumbent:
                path.descend(path.central)
        return path.x, path.cost


class _Path:
    """A dive under way: what it asks, and the best it met."""

    def __init__(
        self, dive: QuasiNewtonDive, ledger: Ledger, x: FloatArray, cost: float, incumbent: float
    ) -> None:
        self.dive, self.ledger, self.incumbent = dive, ledger, incumbent
        self.x, self.cost = x, cost
        self.costs = [cost]

    def descend(self, gradient: Callable[[FloatArray], tuple[float, FloatArray]]) -> None:
        """Run L-BFGS-B from the best place so far to its end."""
        from scipy.optimize import minimize

        search: Any = minimize  # the stubs know no callback that takes the place alone
        box = [(0.0, 1.0)] * len(self.x)
        options = {"maxiter": self.dive.iterations, "maxcor": len(self.x), "ftol": 1e-15, "gtol": 1e-14}
        search(gradient, self.x, jac=True, method="L-BFGS-B", bounds=box, callback=self.look, options=options)

    def forward(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return cost and gradient, (D,), by forward differences, backward at an upper bound."""
        h = np.where(x + self.dive.step <= 1.0, self.dive.step, -self.dive.step)
        F = self._ask(np.concatenate([x[None, :], x + np.diag(h)]))
        # the step that was taken, not the one that was wished: x + h is rounded
        return float(F[0]), (F[1:] - F[0]) / ((x + h) - x)

    def central(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return cost and gradient, (D,), by central differences, cut short at a bound."""
        high, low = np.minimum(x + self.dive.wide, 1.0), np.maximum(x - self.dive.wide, 0.0)
        F = self._ask(np.concatenate([x[None, :], x + np.diag(high - x), x + np.diag(low - x)]))
        return float(F[0]), (F[1 : len(x) + 1] - F[len(x) + 1 :]) / (high - low)

    def _ask(self, X: FloatArray) -> FloatArray:
        """Return the costs of x and the places about it; remember x if it is the best."""
        F = self.ledger.costs(X, self.ledger.full)
        if not np.isfinite(F).all():
            raise _LetGo
        if F[0] < self.cost:
            self.x, self.cost = X[0].copy(), float(F[0])
        return F

    def look(self, x: FloatArray) -> None:
        """Let go where the incumbent is out of reach."""
        self.costs.append(self.cost)
        back = len(self.costs) - 1 - self.dive.patience
        if back < 0 or self.cost <= self.incumbent:
            return
        if self.costs[back] - self.cost < self.dive.fall * (self.cost - self.incumbent):
            raise _LetGo
