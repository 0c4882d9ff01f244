"""Crossover: from parents and mutants to trials."""

from __future__ import annotations

import numpy as np

from stoop.base.arrays import FloatArray


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
