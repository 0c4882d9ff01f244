"""Diversity: what is done about a population that has drawn together, in place or in cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop_studies.optimizers.pieces.sequel import Turn


@dataclass(frozen=True)
class Migration:
    """A population that has drawn together in place is strewn anew about its best.

    A variable of a member counts as diverse if it lies further than `width` from the best's. Where the share of
    diverse variables falls below `tolerance`, every other member is drawn anew: each variable between the best's
    and one end of the box, the end with a probability that is the best's distance from it.

    Attributes
    ----------
    tolerance : share of diverse variables below which there is a migration
    width : of the box; below it two values are the same

    References
    ----------
    Chiou and Wang (1999), Comput. Chem. Eng. 23, 1277-1291; there the width is relative to the best's value.
    """

    tolerance: float = 0.1
    width: float = 1e-5

    def __call__(
        self, turn: Turn, ledger: Ledger, generator: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Return members and costs; a migration takes n - 1 evaluations."""
        best = int(turn.F.argmin())
        others = np.delete(turn.X, best, axis=0)
        if (np.abs(others - turn.X[best]) > self.width).mean() >= self.tolerance:
            return turn.X, turn.F
        strewn = strew(turn.X[best], len(others), generator)
        F = ledger.costs(strewn, ledger.full)
        return np.insert(strewn, best, turn.X[best], axis=0), np.insert(F, best, turn.F[best])


def strew(x: FloatArray, number: int, generator: np.random.Generator) -> FloatArray:
    """Return points, (number, D), each variable uniform between x's and the end of the box that is drawn."""
    down = generator.random((number, len(x))) < x
    reach = np.where(down, -x, 1.0 - x)
    points: FloatArray = x + generator.random((number, len(x))) * reach
    return points


@dataclass(frozen=True)
class SecondMutation:
    """A population that has drawn together in cost is mutated a second time.

    Where the variance of the costs, relative to their mean squared, falls below `threshold`, each member but the
    best is replaced, with a probability that grows from 0 there to `probability` at no variance, by a Gaussian
    step from itself.

    Attributes
    ----------
    threshold : relative variance below which members are mutated
    probability : of a member, where all costs are equal
    spread : standard deviation of the step, in the unit box
    """

    threshold: float = 1e-8
    probability: float = 0.3
    spread: float = 0.25

    def __call__(
        self, turn: Turn, ledger: Ledger, generator: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Return members and costs; each mutated member takes one evaluation."""
        variance = relative_variance(turn.F)
        if not variance < self.threshold:
            return turn.X, turn.F
        chance = self.probability * (1.0 - variance / self.threshold)
        chosen = generator.random(len(turn.X)) < chance
        chosen[turn.F.argmin()] = False
        if not chosen.any():
            return turn.X, turn.F
        X, F = turn.X.copy(), turn.F.copy()
        steps = self.spread * generator.standard_normal((int(chosen.sum()), X.shape[1]))
        X[chosen] = np.clip(X[chosen] + steps, 0.0, 1.0)
        F[chosen] = ledger.costs(X[chosen], ledger.full)
        return X, F


def relative_variance(F: FloatArray) -> float:
    """Return the variance of costs, (n,), over their mean squared; inf where a cost is infinite or all are zero."""
    mean = float(F.mean())
    if not np.isfinite(mean) or mean == 0.0:
        return np.inf
    return float(((F / mean - 1.0) ** 2).mean())
