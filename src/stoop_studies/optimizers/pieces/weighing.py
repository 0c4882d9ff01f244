"""Mutations that weigh the costs of their picks, not only their order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stoop.base.arrays import Factor, FloatArray
from stoop_studies.optimizers.pieces.mutation import distinct, ranked


@dataclass(frozen=True)
class Trigonometric:
    """DE/rand/1, now and then replaced by a step from the center of three picks towards the cheaper of them.

    With p the share of each pick in the sum of the three absolute costs, the trigonometric mutant is
    (a + b + c) / 3 + (p_b - p_a) (a - b) + (p_c - p_b) (b - c) + (p_a - p_c) (c - a).

    Attributes
    ----------
    probability : of the trigonometric mutant

    References
    ----------
    Fan and Lampinen (2003), A trigonometric mutation operation to differential evolution, J. Global Optim. 27,
    105-129.
    """

    probability: float = 0.05

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, (n, D)."""
        chosen = np.flatnonzero(generator.random(len(X)) < self.probability)
        picks = distinct(len(X), 3, generator)
        a, b, c = picks
        mutants: FloatArray = X[c] + scale * (X[a] - X[b])
        if chosen.size:
            mutants[chosen] = _trigonometric(X[picks[:, chosen]], F[picks[:, chosen]])
        return mutants


def _trigonometric(points: FloatArray, costs: FloatArray) -> FloatArray:
    """Return mutants (m, D) of three points each, (3, m, D), and their costs, (3, m)."""
    a, b, c = points
    p = _shares(np.abs(costs))[:, :, None]
    center = (a + b + c) / 3.0
    mutants: FloatArray = center + (p[1] - p[0]) * (a - b) + (p[2] - p[1]) * (b - c) + (p[0] - p[2]) * (c - a)
    return mutants


@dataclass(frozen=True)
class Graded:
    """Best + F (middle - worst) of three picks, F between `lowest` and the scale as the middle lies between them.

    F = lowest + (scale - lowest) (f_middle - f_best) / (f_worst - f_best): far apart in cost, a long step.

    Attributes
    ----------
    lowest : scale where the middle costs as little as the best

    References
    ----------
    Wu, Wang and Zhou (2007), Self-adapting control parameters modified differential evolution for trajectory
    planning of manipulators, J. Control Theory Appl. 5, 365-373.
    """

    lowest: float = 0.1

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, (n, D)."""
        picks = ranked(distinct(len(X), 3, generator), F)
        best, middle, worst = picks
        own = self.lowest + (scale - self.lowest) * _between(*F[picks])[:, None]
        mutants: FloatArray = X[best] + own * (X[middle] - X[worst])
        return mutants


def _between(best: FloatArray, middle: FloatArray, worst: FloatArray) -> FloatArray:
    """Return where the middle cost lies, 0 at the best and 1 at the worst; 1 where that cannot be said."""
    with np.errstate(invalid="ignore", divide="ignore"):
        place: FloatArray = (middle - best) / (worst - best)
    return np.where(np.isnan(place), 1.0, place)


@dataclass(frozen=True)
class WeightedCentroid:
    """A base between a random member and the weighted centroid of three, plus scale times a difference.

    v = c + k (m - c) + scale (d - e), with m the centroid of a, b, c, each weighted by how far it lies below the
    population's worst cost. The convergence factor k is one minus the mean width of the population in the unit
    box: at first a base is a random member, in the end a centroid.
    """

    def __call__(
        self, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, (n, D)."""
        picks = distinct(len(X), 5, generator)
        weights = _weights(F)[picks[:3]]
        with np.errstate(invalid="ignore"):
            weights = _shares(weights)
        a, b, c, d, e = X[picks]
        centroid = weights[0, :, None] * a + weights[1, :, None] * b + weights[2, :, None] * c
        mutants: FloatArray = c + _contraction(X) * (centroid - c) + scale * (d - e)
        return mutants


def _weights(F: FloatArray) -> FloatArray:
    """Return how far each cost, (n,), lies below the worst finite one; 0 for an infinite one."""
    finite = np.isfinite(F)
    worst = F[finite].max(initial=-np.inf)
    return np.where(finite, worst - np.where(finite, F, 0.0), 0.0)


def _contraction(X: FloatArray) -> float:
    """Return the convergence factor: 0 while the members fill the unit box, 1 where they are one point."""
    return 1.0 - float((X.max(axis=0) - X.min(axis=0)).mean())


def _shares(values: FloatArray) -> FloatArray:
    """Return shares of three non-negative values, (3, m), in their sum; equal ones where that is 0 or infinite."""
    total = values.sum(axis=0)
    sound = np.isfinite(total) & (total > 0.0)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return np.where(sound, values / total, 1.0 / 3.0)
