"""Mutation, from a population to one mutant per parent, and control, the scale and crossover rate that it works with.

A mutation is any callable of (X, F, scale, generator) that returns mutants of the shape of X. The caller brings
mutants back into the box, and a control decides on the scale. A new operator takes a few lines::

    def rand_1(X, F, scale, generator):
        a, b, c = X[distinct(len(X), 3, generator)]
        return c + scale * (a - b)

References
----------
Fan and Lampinen (2003), A trigonometric mutation operation to differential evolution, J. Global Optim. 27, 105-129.
Kaelo and Ali (2006), A numerical study of some modified differential evolution algorithms, Eur. J. Oper. Res. 169,
1176-1184 (DERL).
Wu, Wang and Zhou (2007), Self-adapting control parameters modified differential evolution for trajectory planning of
manipulators, J. Control Theory Appl. 5, 365-373.
Tanabe and Fukunaga (2013), IEEE CEC, 71-78 (SHADE).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.random import Generator

from stoop.base.arrays import Factor, FloatArray, IntArray
from stoop.optimize.population import ParameterMemory

#: From a population X, (n, D), of costs F, (n,), and a scale, one or (n, 1), to mutants, (n, D).
Mutation = Callable[[FloatArray, FloatArray, Factor, Generator], FloatArray]


def rand_1(X: FloatArray, F: FloatArray, scale: Factor, generator: Generator) -> FloatArray:
    """Return mutants of DE/rand/1: c + scale (a - b), the paper's eq. (6), first line."""
    a, b, c = X[distinct(len(X), 3, generator)]
    mutants: FloatArray = c + scale * (a - b)
    return mutants


def best_2(X: FloatArray, F: FloatArray, scale: Factor, generator: Generator) -> FloatArray:
    """Return mutants of DE/best/2: best + scale (a - b + c - d), the paper's eq. (6), second line."""
    a, b, c, d = X[distinct(len(X), 4, generator)]
    mutants: FloatArray = X[F.argmin()] + scale * (a - b + c - d)
    return mutants


def ordered(X: FloatArray, F: FloatArray, scale: Factor, generator: Generator) -> FloatArray:
    """Return mutants by the paper's eq. (12): x + scale (a - x + b - c), with a, b, c the best, middle, worst of three picks."""
    a, b, c = X[ranked(distinct(len(X), 3, generator), F)]
    mutants: FloatArray = X + scale * (a - X + b - c)
    return mutants


def unordered(X: FloatArray, F: FloatArray, scale: Factor, generator: Generator) -> FloatArray:
    """Return mutants by eq. (12) with its three picks as drawn: what the sorting is worth."""
    a, b, c = X[distinct(len(X), 3, generator)]
    mutants: FloatArray = X + scale * (a - X + b - c)
    return mutants


def localized(X: FloatArray, F: FloatArray, scale: Factor, generator: Generator) -> FloatArray:
    """Return mutants of random localization: base + scale (a - b), the best of three picks the base (Kaelo and Ali)."""
    picks = distinct(len(X), 3, generator)
    members, best = np.arange(len(X)), F[picks].argmin(axis=0)
    base, a, b = (picks[(best + k) % 3, members] for k in range(3))
    mutants: FloatArray = X[base] + scale * (X[a] - X[b])
    return mutants


def weighted_centroid(X: FloatArray, F: FloatArray, scale: Factor, generator: Generator) -> FloatArray:
    """Return mutants from bases between a random member and the weighted centroid of three.

    v = c + k (m - c) + scale (d - e), with m the centroid of a, b, c, each weighted by how far it lies below the
    population's worst finite cost. The convergence factor k is one minus the mean width of the population in the
    unit box: at first a base is a random member, in the end a centroid.
    """
    picks = distinct(len(X), 5, generator)
    finite = np.isfinite(F)
    below = np.where(finite, F[finite].max(initial=-np.inf) - np.where(finite, F, 0.0), 0.0)
    p = _shares(below[picks[:3]])[:, :, None]
    a, b, c, d, e = X[picks]
    centroid = p[0] * a + p[1] * b + p[2] * c
    factor = 1.0 - float((X.max(axis=0) - X.min(axis=0)).mean())
    mutants: FloatArray = c + factor * (centroid - c) + scale * (d - e)
    return mutants


@dataclass(frozen=True)
class Trigonometric:
    """DE/rand/1, now and then replaced by a step from the center of three picks towards the cheaper of them.

    With p the share of each pick in the sum of the three absolute costs, the trigonometric mutant is
    (a + b + c) / 3 + (p_b - p_a) (a - b) + (p_c - p_b) (b - c) + (p_a - p_c) (c - a) (Fan and Lampinen).
    """

    probability: float = 0.05  #: of the trigonometric mutant

    def __call__(self, X: FloatArray, F: FloatArray, scale: Factor, generator: Generator) -> FloatArray:
        """Return mutants, (n, D)."""
        replaced = np.flatnonzero(generator.random(len(X)) < self.probability)
        picks = distinct(len(X), 3, generator)
        a, b, c = X[picks]
        mutants: FloatArray = c + scale * (a - b)
        if replaced.size:
            a, b, c = X[picks[:, replaced]]
            p = _shares(np.abs(F[picks[:, replaced]]))[:, :, None]
            center = (a + b + c) / 3.0
            steps = (p[1] - p[0]) * (a - b), (p[2] - p[1]) * (b - c), (p[0] - p[2]) * (c - a)
            mutants[replaced] = center + steps[0] + steps[1] + steps[2]
        return mutants


@dataclass(frozen=True)
class ScaledByCost:
    """Best + F (middle - worst) of three picks; F grows from `lowest` to the scale with the middle one's cost.

    F = lowest + (scale - lowest) (f_middle - f_best) / (f_worst - f_best); the scale where that is not defined (Wu et al.).
    """

    lowest: float = 0.1  #: scale where the middle costs as little as the best

    def __call__(self, X: FloatArray, F: FloatArray, scale: Factor, generator: Generator) -> FloatArray:
        """Return mutants, (n, D)."""
        picks = ranked(distinct(len(X), 3, generator), F)
        (best, middle, worst), f = picks, F[picks]
        with np.errstate(invalid="ignore", divide="ignore"):
            place = (f[1] - f[0]) / (f[2] - f[0])
        place = np.where(np.isnan(place), 1.0, place)
        own = self.lowest + (scale - self.lowest) * place[:, None]
        mutants: FloatArray = X[best] + own * (X[middle] - X[worst])
        return mutants


def distinct(number: int, picks: int, generator: Generator) -> IntArray:
    """Draw `picks` indices for each of `number` parents, all different and none the parent's own.

    The k-th draw is uniform over what is left and is then moved up past each index that is taken, lowest
    first: exact, and without trial and error.

    Returns
    -------
    indices : (picks, number)
    """
    left = np.arange(number - 1, number - 1 - picks, -1)[:, None]
    draws = (generator.random((picks, number)) * left).astype(np.intp)
    taken = np.arange(number)[None, :]
    for draw in draws:
        for low in taken:
            draw += draw >= low
        taken = np.sort(np.concatenate([taken, draw[None, :]]), axis=0)
    return draws


def ranked(indices: IntArray, F: FloatArray) -> IntArray:
    """Order each parent's indices, (picks, n), by cost, best first; ties stay as drawn."""
    return np.take_along_axis(indices, np.argsort(F[indices], axis=0, kind="stable"), axis=0)


def _shares(values: FloatArray) -> FloatArray:
    """Return shares of three non-negative values, (3, m), in their sum; equal ones where that is 0 or infinite."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        total = values.sum(axis=0)
        return np.where(np.isfinite(total) & (total > 0.0), values / total, 1.0 / 3.0)


class Control(Protocol):
    """Scale and rate of each generation, and what it learns from the success of its trials.

    The memory is kept in the optimizer's state: numbers, arrays (n, ...), None, or a dataclass of these that
    `stoop.optimize.state` names.
    """

    def begin(self) -> Any:
        """Return the memory of a population before its first generation."""

    def sample(self, memory: Any, F: FloatArray, generator: Generator) -> tuple[Factor, Factor]:
        """Return scale and rate for parents of costs F, (n,): a number each, or (n, 1)."""
        ...

    def learn(self, memory: Any, scale: Factor, rate: Factor, before: FloatArray, costs: FloatArray) -> Any:
        """Return the memory after trials of the given costs, (n,), met parents of costs `before`, (n,)."""


class Memoryless:
    """A control that learns nothing."""

    def begin(self) -> None:
        """Return None."""

    def learn(self, memory: None, scale: Factor, rate: Factor, before: FloatArray, costs: FloatArray) -> None:
        """Return None."""


@dataclass(frozen=True)
class Fixed(Memoryless):
    """The same scale and rate for all members and generations."""

    scale: float = 0.5
    rate: float = 0.9

    def sample(self, memory: None, F: FloatArray, generator: Generator) -> tuple[float, float]:
        """Return scale and rate."""
        return self.scale, self.rate


@dataclass(frozen=True)
class Signed(Memoryless):
    """A new scale for every mutant, uniform in [low, high] and of either sign, and a fixed rate (Kaelo and Ali)."""

    low: float = 0.4
    high: float = 1.0
    rate: float = 0.5

    def sample(self, memory: None, F: FloatArray, generator: Generator) -> tuple[FloatArray, float]:
        """Return scales (n, 1) and the rate."""
        draws = 2.0 * generator.random((len(F), 1)) - 1.0
        scales: FloatArray = draws * (self.high - self.low) + np.copysign(self.low, draws)
        return scales, self.rate


@dataclass(frozen=True)
class ByCost(Memoryless):
    """A rate that grows with a parent's cost: good parents change little, those better than the mean take `low` (Wu et al.).

    The scale is fixed; a mutation may take it for the largest that it uses (`ScaledByCost`).
    """

    scale: float = 0.9
    low: float = 0.1
    high: float = 0.6

    def sample(self, memory: None, F: FloatArray, generator: Generator) -> tuple[float, FloatArray]:
        """Return the scale and rates (n, 1); a parent of infinite cost takes `high`."""
        finite = np.isfinite(F)
        if not finite.any():
            return self.scale, np.full((len(F), 1), self.high)
        best, worst, mean = F[finite].min(), F[finite].max(), F[finite].mean()
        place = np.where(finite, (F - best) / max(worst - best, 1e-300), 1.0)
        rates = np.where(mean < F, self.low + (self.high - self.low) * place, self.low)
        return self.scale, rates[:, None]


@dataclass(frozen=True)
class SuccessHistory:
    """Scales and rates near those of recent successful trials, one of each for every parent (SHADE)."""

    entries: int = 6

    def begin(self) -> ParameterMemory:
        """Return a memory without any success."""
        return ParameterMemory.fresh(self.entries)

    def sample(
        self, memory: ParameterMemory, F: FloatArray, generator: Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Return scales and rates, (n, 1) each."""
        scales, rates = memory.sample(len(F), generator)
        return scales[:, None], rates[:, None]

    def learn(
        self,
        memory: ParameterMemory,
        scale: FloatArray,
        rate: FloatArray,
        before: FloatArray,
        costs: FloatArray,
    ) -> ParameterMemory:
        """Return the memory after a generation: means of the successful, weighted by the gain in cost."""
        with np.errstate(invalid="ignore"):
            gains = before - costs
        return memory.learn(scale[:, 0], rate[:, 0], gains, costs < before)
