"""Prey: when the best members are dived from, and how."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.local_refinement import FULL, Settings, refine


class LocalDive(Protocol):
    """From a member and its cost to where a local search ends, and the cost there."""

    def __call__(self, ledger: Ledger, x: FloatArray, cost: float) -> tuple[FloatArray, float]:
        """Return the end of the dive; never worse than its start."""
        ...


@dataclass(frozen=True)
class PreySchedule:
    """When the best members are dived from, in place of a generation.

    Attributes
    ----------
    dive : the local search
    period : generations from one local search to the next (the paper's NC)
    share : of the members that are dived from (the paper's pr)
    swapped : evolve every `period` generations and dive in all others: the paper's steps 4 and 5 as printed
    """

    dive: LocalDive
    period: int = 20
    share: float = 0.05
    swapped: bool = False

    def due(self, generation: int) -> bool:
        """Whether a generation, counted from 1, is one of local search."""
        return (generation % self.period == 0) != self.swapped

    def number(self, members: int) -> int:
        """Return how many members are dived from; half a member counts as one."""
        return max(1, int(np.floor(self.share * members + 0.5)))

    def hunt(self, ledger: Ledger, X: FloatArray, F: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return members (n, D) and costs (n,) after a dive from each of the best."""
        X, F = X.copy(), F.copy()
        for i in np.argsort(F, kind="stable")[: self.number(len(X))]:
            X[i], F[i] = self.dive(ledger, X[i].copy(), float(F[i]))
        return X, F


@dataclass(frozen=True)
class LevenbergDive:
    """Levenberg-Marquardt on the full record: prey for problems that have residuals.

    Nuisances are free on the way down; a member is compared, and kept, with them at zero.
    """

    settings: Settings = FULL

    def __call__(self, ledger: Ledger, x: FloatArray, cost: float) -> tuple[FloatArray, float]:
        """Return where the dive from x, (D,), ends, and the cost there."""
        end = refine(ledger, np.concatenate([x, np.zeros(ledger.extra)]), ledger.full, self.settings)
        y, lower = end.z[: len(x)], end.cost
        if ledger.extra and lower < cost:
            lower = float(ledger.costs(y[None, :], ledger.full)[0])
        return (y, lower) if lower < cost else (x, cost)
