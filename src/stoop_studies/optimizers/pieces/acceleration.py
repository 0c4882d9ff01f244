"""Acceleration: where a generation did not better the best, the best goes down its gradient.

References
----------
Chiou and Wang (1999), Hybrid method of evolutionary algorithms for static and dynamic optimization problems with
application to a fed-batch fermentation process, Comput. Chem. Eng. 23, 1277-1291.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop_studies.optimizers.pieces.golden import forward_gradient
from stoop_studies.optimizers.pieces.sequel import Turn


@dataclass(frozen=True)
class Acceleration:
    """A step along the negative gradient from the best, halved until it descends.

    The publication steps by the gradient times a factor that begins at 1. A gradient has the unit of the cost, so
    here the first step is as long as the population's mean distance from its best.

    Attributes
    ----------
    halvings : of the step at most; then the best stays where it is
    """

    halvings: int = 4

    def __call__(
        self, turn: Turn, ledger: Ledger, generator: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Return members and costs; the gradient takes D evaluations, each step one."""
        best = int(turn.F.argmin())
        if turn.improved or not np.isfinite(turn.F[best]):
            return turn.X, turn.F
        x, cost = self._descend(ledger, turn.X[best], float(turn.F[best]), _distance(turn.X, best))
        X, F = turn.X.copy(), turn.F.copy()
        X[best], F[best] = x, cost
        return X, F

    def _descend(self, ledger: Ledger, x: FloatArray, cost: float, reach: float) -> tuple[FloatArray, float]:
        """Return the end of the first step that descends, else where it began."""
        gradient = forward_gradient(ledger, x, cost)
        length = float(np.sqrt((gradient * gradient).sum()))
        if not np.isfinite(length) or length == 0.0:
            return x, cost
        for _ in range(self.halvings + 1):
            y = np.clip(x - reach * gradient / length, 0.0, 1.0)
            lower = float(ledger.costs(y[None, :], ledger.full)[0])
            if lower < cost:
                return y, lower
            reach *= 0.5
        return x, cost


def _distance(X: FloatArray, best: int) -> float:
    """Return the mean distance of members (n, D) from one of them."""
    return float(np.sqrt(((X - X[best]) ** 2).sum(axis=1)).mean())
