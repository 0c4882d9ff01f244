"""Mutation: from a population to one mutant per parent.

An operator is any callable of (X, F, scale, generator) that returns mutants of the shape of X; bounds are mended
afterwards, and where the scale comes from is not its business (`pieces.control`). Adding one takes a few lines::

    @dataclass(frozen=True)
    class Rand1:
        def __call__(self, X, F, scale, generator):
            a, b, c = X[distinct(len(X), 3, generator)]
            return c + scale * (a - b)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stoop.base.arrays import Factor, FloatArray, IntArray


class Mutation(Protocol):
    """From a population X, (n, D), of costs F, (n,), and a scale, one or (n, 1), to mutants, (n, D)."""

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants; bounds are mended by the caller."""
        ...


@dataclass(frozen=True)
class Rand1:
    """DE/rand/1: c + scale (a - b), the paper's eq. (6), first line."""

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, (n, D)."""
        a, b, c = X[distinct(len(X), 3, generator)]
        mutants: FloatArray = c + scale * (a - b)
        return mutants


@dataclass(frozen=True)
class Best2:
    """DE/best/2: best + scale (a - b + c - d), the paper's eq. (6), second line."""

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, (n, D)."""
        a, b, c, d = X[distinct(len(X), 4, generator)]
        mutants: FloatArray = X[F.argmin()] + scale * (a - b + c - d)
        return mutants


@dataclass(frozen=True)
class Ordered:
    """The paper's eq. (12): x + scale (a - x + b - c), with a, b, c the best, middle and worst of three."""

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, (n, D)."""
        a, b, c = X[ranked(distinct(len(X), 3, generator), F)]
        mutants: FloatArray = X + scale * (a - X + b - c)
        return mutants


@dataclass(frozen=True)
class Unordered:
    """Eq. (12) with its three picks as drawn: what the sorting is worth."""

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, (n, D)."""
        a, b, c = X[distinct(len(X), 3, generator)]
        mutants: FloatArray = X + scale * (a - X + b - c)
        return mutants


@dataclass(frozen=True)
class Localized:
    """Random localization: best + scale (a - b), the best of three random members its base, a and b the rest.

    References
    ----------
    Kaelo and Ali (2006), A numerical study of some modified differential evolution algorithms, Eur. J. Oper.
    Res. 169, 1176-1184 (DERL).
    """

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, (n, D)."""
        picks = distinct(len(X), 3, generator)
        members, best = np.arange(len(X)), F[picks].argmin(axis=0)
        base, a, b = (picks[(best + k) % 3, members] for k in range(3))
        mutants: FloatArray = X[base] + scale * (X[a] - X[b])
        return mutants


def distinct(number: int, picks: int, generator: np.random.Generator) -> IntArray:
    """Draw `picks` indices for each of `number` parents, all different and none the parent's own.

    The k-th draw is uniform over what is left and is then moved up past each index that is taken, lowest
    first: exact, and without trial and error.

    Returns
    -------
    indices : (picks, number)
    """
    left = np.arange(number - 1, number - 1 - picks, -1)[:, None]
    draws = (generator.random((picks, number)) * left).astype(np.intp)
    taken = [np.arange(number)]
    for draw in draws:
        for low in taken:
            draw += draw >= low
        if len(taken) < picks:
            _insert(taken, draw)
    return draws


def _insert(rows: list[IntArray], new: IntArray) -> None:
    """Add a row to rows that ascend in each column, so that they still do."""
    for k, row in enumerate(rows):
        rows[k] = np.minimum(row, new)
        new = np.maximum(row, new)
    rows.append(new)


def ranked(indices: IntArray, F: FloatArray) -> IntArray:
    """Order each parent's indices, (picks, n), by cost, best first; ties stay as drawn."""
    order = np.argsort(F[indices], axis=0, kind="stable")
    return indices[order, np.arange(indices.shape[1])]
