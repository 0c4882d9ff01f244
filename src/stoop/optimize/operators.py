"""Operators of differential evolution: initialization, mutation, bounds, crossover, selection, archive.

References
----------
Zhang and Sanderson (2009), JADE: adaptive differential evolution with optional external archive, IEEE TEC 13,
945-958 (current-to-pbest, the archive, the midpoint rule at the bounds).
The paper's eqs. (7) (crossover), (8) (selection) and (12) (the order in the difference).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, Factor, FloatArray, IntArray

MEMBERS: Final = 50  #: of a population, for every method that has one


def latin_hypercube(number: int, dimension: int, generator: np.random.Generator) -> FloatArray:
    """Return points, (number, dimension), of which each variable falls once in each of `number` equal slices."""
    slices = np.argsort(generator.random((number, dimension)), axis=0)
    points: FloatArray = (slices + generator.random((number, dimension))) / number
    return points


def midpoint(mutants: FloatArray, parents: FloatArray) -> FloatArray:
    """Return mutants, (n, D), set halfway between the parent and the bound of the unit box that they crossed (JADE)."""
    inside: FloatArray = np.where(mutants < 0.0, 0.5 * parents, mutants)
    return np.where(inside > 1.0, 0.5 * (parents + 1.0), inside)


def binomial(
    parents: FloatArray, mutants: FloatArray, rate: float | FloatArray, generator: np.random.Generator
) -> FloatArray:
    """Take each variable from the mutant with probability `rate`, one always (the paper's eq. 7).

    Parameters
    ----------
    parents, mutants : (n, D)
    rate : one for all, or one per parent, (n, 1)
    generator : numpy Generator
    """
    number, dimension = parents.shape
    # a draw below any rate at one place per parent is "one always", and saves a second mask
    draws = generator.random((number, dimension))
    always = (generator.random(number) * dimension).astype(np.intp)
    draws[np.arange(number), always] = -1.0
    trials: FloatArray = np.where(draws <= rate, mutants, parents)
    return trials


def greedy(
    parents: FloatArray, costs: FloatArray, trials: FloatArray, trial_costs: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Let a trial replace its parent where it costs less (the paper's eq. 8).

    Returns
    -------
    survivors : (n, D)
    survivor_costs : (n,)
    won : (n,), where the trial replaced the parent
    """
    won = trial_costs < costs
    return np.where(won[:, None], trials, parents), np.where(won, trial_costs, costs), won


def update_archive(
    archive: FloatArray, losers: FloatArray, most: int, generator: np.random.Generator
) -> FloatArray:
    """Return the archive, (a, D), with the losers, (k, D), added; beyond `most`, members are removed at random.

    Parents that lost are kept because the way away from them is a direction worth trying. The generator advances only
    where something is removed.
    """
    kept = np.concatenate([archive, losers])
    if len(kept) > most:
        kept = kept[generator.permutation(len(kept))[:most]]
    return kept


def elite_size(F: FloatArray, share: float) -> int:
    """Return how many members of costs F, (n,), are the best `share`; two at least."""
    return max(2, round(share * len(F)))


def elite(F: FloatArray, share: float, generator: np.random.Generator) -> IntArray:
    """Return for each member, (n,), one of the best `share` of all."""
    ranks = (generator.random(len(F)) * elite_size(F, share)).astype(np.intp)
    chosen: IntArray = np.argsort(F, kind="stable")[ranks]
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
class OrderedToPBest:
    """Current-to-pbest/1 with the paper's order (eq. 12) in the difference: x + scale (p - x + better - worse).

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
