"""First populations in the unit box, each a function of (number, dimension, generator)."""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray

MEMBERS: Final = 50  #: of a population, for every method that has one
EXCLUDED: Final = (0.0, 0.25, 0.5, 0.75, 1.0)  #: starts from which the logistic map is not chaotic
ABSORBING: Final = 1e-12  #: nearer to 0 or 1 than this, the map has been caught


def uniform(number: int, dimension: int, generator: np.random.Generator) -> FloatArray:
    """Return independent uniform points, (number, dimension)."""
    return generator.random((number, dimension))


def placed(X: FloatArray, starts: FloatArray) -> FloatArray:
    """Return members X, (n, D), of which the user's own values, (k, D) or wider, have taken the first places."""
    first = np.clip(starts[: len(X), : X.shape[1]], 0.0, 1.0)
    return np.concatenate([first, X[len(first) :]])


def latin_hypercube(number: int, dimension: int, generator: np.random.Generator) -> FloatArray:
    """Return points of which each variable falls once in each of `number` equal slices."""
    slices = np.argsort(generator.random((number, dimension)), axis=0)
    points: FloatArray = (slices + generator.random((number, dimension))) / number
    return points


def chaos(number: int, dimension: int, generator: np.random.Generator) -> FloatArray:
    """Return successive iterates of the logistic map, one orbit per variable (the paper's eq. 9, u = 4)."""
    points = np.empty((number, dimension))
    c = chaotic_start(dimension, generator)
    for i in range(number):
        points[i] = c
        c = 4.0 * c * (1.0 - c)
        caught = (c < ABSORBING) | (c > 1.0 - ABSORBING)
        if caught.any():
            c[caught] = chaotic_start(int(caught.sum()), generator)
    return points


def chaotic_start(dimension: int, generator: np.random.Generator) -> FloatArray:
    """Return uniform numbers, none of them a start from which the map is not chaotic."""
    c = generator.random(dimension)
    while (bad := np.isin(c, EXCLUDED)).any():
        c[bad] = generator.random(int(bad.sum()))
    return c
