"""Mutation: from a population to one mutant per parent.

An operator is any callable of (X, F, generator) that returns mutants of the shape of X; bounds are mended
afterwards. Adding one takes a class of a few lines::

    @dataclass(frozen=True)
    class Rand1:
        scale: float

        def __call__(self, X, F, generator):
            a, b, c = distinct(len(X), 3, generator)
            return X[c] + self.scale * (X[a] - X[b])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stoop.optimize.arrays import FloatArray, IntArray


class Mutation(Protocol):
    """From a population X, (n, D), of costs F, (n,), to mutants, (n, D)."""

    def __call__(self, X: FloatArray, F: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Return mutants; bounds are mended by the caller."""
        ...


@dataclass(frozen=True)
class Rand1:
    """DE/rand/1: c + scale (a - b), the paper's eq. (6), first line."""

    scale: float

    def __call__(self, X: FloatArray, F: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Return mutants."""
        a, b, c = distinct(len(X), 3, generator)
        mutants: FloatArray = X[c] + self.scale * (X[a] - X[b])
        return mutants


@dataclass(frozen=True)
class Best2:
    """DE/best/2: best + scale (a - b + c - d), the paper's eq. (6), second line."""

    scale: float

    def __call__(self, X: FloatArray, F: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Return mutants."""
        a, b, c, d = distinct(len(X), 4, generator)
        mutants: FloatArray = X[F.argmin()] + self.scale * (X[a] - X[b] + X[c] - X[d])
        return mutants


@dataclass(frozen=True)
class Ordered:
    """The paper's eq. (12): x + scale (a - x + b - c), with a, b, c the best, middle and worst of three."""

    scale: float

    def __call__(self, X: FloatArray, F: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Return mutants."""
        a, b, c = ranked(distinct(len(X), 3, generator), F)
        mutants: FloatArray = X + self.scale * (X[a] - X + X[b] - X[c])
        return mutants


def distinct(number: int, picks: int, generator: np.random.Generator) -> IntArray:
    """Draw `picks` indices for each of `number` parents, all different and none the parent's own.

    The k-th draw is uniform over what is left and is then moved up past each index that is taken, lowest
    first: exact, and without trial and error.

    Returns
    -------
    indices : (picks, number)
    """
    taken = np.arange(number)[None, :]
    left = np.arange(number - 1, number - 1 - picks, -1)[:, None]
    draws = (generator.random((picks, number)) * left).astype(np.intp)
    for k in range(picks):
        for low in taken:
            draws[k] += draws[k] >= low
        if k + 1 < picks:
            taken = np.sort(np.concatenate([taken, draws[k : k + 1]]), axis=0)
    return draws


def ranked(indices: IntArray, F: FloatArray) -> IntArray:
    """Order each parent's indices by cost, best first; ties stay as drawn."""
    order = np.argsort(F[indices], axis=0, kind="stable")
    return np.take_along_axis(indices, order, axis=0)
