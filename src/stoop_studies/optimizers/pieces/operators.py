"""Operators that only the optimizers of the studies use, beside those of :mod:`stoop.optimize.operators`.

References
----------
Zhang and Sanderson (2009), IEEE TEC 13, 945-958 (JADE: current-to-pbest).
Tanabe and Fukunaga (2014), IEEE CEC, 1658-1665 (L-SHADE: the terminal rate).
Brest, Maucec and Boskovic (2017), Single objective real-parameter optimization: algorithm jSO, IEEE CEC,
1311-1318.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, Factor, FloatArray, IntArray
from stoop.optimize.adaptation import ParameterMemory, success_means
from stoop.optimize.operators import elite, elite_size, two_others

EXCLUDED: Final = (0.0, 0.25, 0.5, 0.75, 1.0)  #: starts from which the logistic map is not chaotic
ABSORBING: Final = 1e-12  #: nearer to 0 or 1 than this, the map is absorbed
TERMINAL: Final = -1.0  #: a rate of the memory below zero: only crossover rate 0 works, and stays
FIXED: Final = 0.9  #: scale and rate of the entry that jSO never learns

Choice = Callable[[FloatArray, float, np.random.Generator], IntArray]


def uniform(number: int, dimension: int, generator: np.random.Generator) -> FloatArray:
    """Return independent uniform points, (number, dimension)."""
    return generator.random((number, dimension))


def placed(X: FloatArray, starts: FloatArray) -> FloatArray:
    """Return members X, (n, D), of which the user's own values, (k, D) or wider, take the first places."""
    first = np.clip(starts[: len(X), : X.shape[1]], 0.0, 1.0)
    return np.concatenate([first, X[len(first) :]])


def chaos(number: int, dimension: int, generator: np.random.Generator) -> FloatArray:
    """Return successive iterates of the logistic map, one orbit per variable (the paper's eq. 9, u = 4)."""
    points = np.empty((number, dimension))
    c = chaotic_start(dimension, generator)
    for i in range(number):
        points[i] = c
        c = 4.0 * c * (1.0 - c)
        absorbed = (c < ABSORBING) | (c > 1.0 - ABSORBING)
        if absorbed.any():
            c[absorbed] = chaotic_start(int(absorbed.sum()), generator)
    return points


def chaotic_start(dimension: int, generator: np.random.Generator) -> FloatArray:
    """Return uniform numbers, none of them a start from which the map is not chaotic."""
    c = generator.random(dimension)
    while (bad := np.isin(c, EXCLUDED)).any():
        c[bad] = generator.random(int(bad.sum()))
    return c


def clip(mutants: FloatArray, parents: FloatArray) -> FloatArray:
    """Return mutants set on the bound of the unit box that they crossed."""
    inside: FloatArray = np.minimum(np.maximum(mutants, 0.0), 1.0)
    return inside


def elite_but_self(F: FloatArray, share: float, generator: np.random.Generator) -> IntArray:
    """Return for each member, (n,), one of the best `share` of all that is not the member itself."""
    size, order = elite_size(F, share), np.argsort(F, kind="stable")
    rank = np.empty(len(F), dtype=np.intp)
    rank[order] = np.arange(len(F))
    draw = (generator.random(len(F)) * np.where(rank < size, size - 1, size)).astype(np.intp)
    chosen: IntArray = order[draw + (draw >= rank)]
    return chosen


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


def learn_terminal(
    memory: ParameterMemory, scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray
) -> ParameterMemory:
    """Return the memory after a generation of L-SHADE: a rate that has come down to zero stays there."""
    if not won.any():
        return memory
    scale, rate = success_means(scales, rates, gains, won)
    ended = memory.rates[memory.slot] < 0.0 or rates[won].max() <= 0.0
    return memory.renewed(scale, TERMINAL if ended else rate)


def learn_halfway(
    memory: ParameterMemory, scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray
) -> ParameterMemory:
    """Return the memory after a generation of jSO: halfway from the old entry to what won.

    The turn of the last entry comes round as any other's, but it stays at 0.9.
    """
    if not won.any():
        return memory
    scale, rate = success_means(scales, rates, gains, won)
    rate = rate if rates[won].max() > 0.0 else TERMINAL
    if memory.slot == len(memory.scales) - 1:
        return memory.renewed(FIXED, FIXED)
    old_scale, old_rate = float(memory.scales[memory.slot]), float(memory.rates[memory.slot])
    return memory.renewed(0.5 * (scale + old_scale), 0.5 * (rate + old_rate))
