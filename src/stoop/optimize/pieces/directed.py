"""Mutations that go from the parent towards one of the elite, with an archive behind the difference.

References
----------
Zhang and Sanderson (2009), IEEE TEC 13, 945-958 (JADE: current-to-pbest and the archive).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stoop.base.arrays import Factor, FloatArray, IntArray

Choice = Callable[[FloatArray, float, np.random.Generator], IntArray]


def elite(F: FloatArray, share: float, generator: np.random.Generator) -> IntArray:
    """Return for each member, (n,), one of the best `share` of all; two at least are in the draw."""
    ranks = (generator.random(len(F)) * _size(F, share)).astype(np.intp)
    chosen: IntArray = np.argsort(F, kind="stable")[ranks]
    return chosen


def elite_but_self(F: FloatArray, share: float, generator: np.random.Generator) -> IntArray:
    """Return for each member, (n,), one of the best `share` of all that is not the member itself."""
    size, order = _size(F, share), np.argsort(F, kind="stable")
    rank = np.empty(len(F), dtype=np.intp)
    rank[order] = np.arange(len(F))
    draw = (generator.random(len(F)) * np.where(rank < size, size - 1, size)).astype(np.intp)
    chosen: IntArray = order[draw + (draw >= rank)]
    return chosen


def two_others(members: int, pool: int, generator: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Draw for each member another member, and one of the pool that is neither.

    Parameters
    ----------
    members : n
    pool : members and archive together, members first; at least 3
    generator : numpy Generator

    Returns
    -------
    a, b : (n,) each
    """
    own = np.arange(members)
    a = (generator.random(members) * (members - 1)).astype(np.intp)
    a += a >= own
    b = (generator.random(members) * (pool - 2)).astype(np.intp)
    low, high = np.minimum(own, a), np.maximum(own, a)
    b += b >= low
    b += b >= high
    return a, b


@dataclass(frozen=True)
class CurrentToPBest:
    """Current-to-pbest/1: x + scale (pull (p - x) + a - b), b of the members and the archive together.

    Attributes
    ----------
    archive : (m, D), may be empty
    share : of the members that count as elite
    pull : weight of the step towards the elite (jSO's Fw over F)
    choose : who of the elite is p
    """

    archive: FloatArray
    share: float = 0.11
    pull: float = 1.0
    choose: Choice = elite

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, (n, D); scale is one for all or (n, 1)."""
        towards = X[self.choose(F, self.share, generator)]
        pool = np.concatenate([X, self.archive])
        a, b = two_others(len(X), len(pool), generator)
        mutants: FloatArray = X + scale * (self.pull * (towards - X) + X[a] - pool[b])
        return mutants


@dataclass(frozen=True)
class OrderedToPBest:
    """The same with the paper's order (eq. 12) in the difference: x + scale (p - x + better - worse).

    Members of the archive lost once, and so count as worse than any member.

    Attributes
    ----------
    archive : (m, D), may be empty
    share : of the members that count as elite
    """

    archive: FloatArray
    share: float = 0.11

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, (n, D); scale is one for all or (n, 1)."""
        towards, better, worse = self.parents(X, F, generator)
        mutants: FloatArray = X + scale * (towards - X + better - worse)
        return mutants

    def parents(
        self, X: FloatArray, F: FloatArray, generator: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return one of the elite, and two others, the better first; (n, D) each."""
        towards = X[elite(F, self.share, generator)]
        pool = np.concatenate([X, self.archive])
        cost = np.concatenate([F, np.full(len(self.archive), np.inf)])
        a, b = two_others(len(X), len(pool), generator)
        swap = cost[b] < cost[a]
        return towards, pool[np.where(swap, b, a)], pool[np.where(swap, a, b)]


def _size(F: FloatArray, share: float) -> int:
    """Return how many are elite."""
    return max(2, round(share * len(F)))
