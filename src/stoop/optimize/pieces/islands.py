"""Structure: who may breed with whom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stoop.optimize.arrays import FloatArray
from stoop.optimize.pieces.control import Factor
from stoop.optimize.pieces.mutation import Mutation


class Structure(Protocol):
    """Lets a mutation see the population, or parts of it."""

    def breed(
        self, mutation: Mutation, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return one mutant per member, (n, D)."""
        ...


@dataclass(frozen=True)
class Whole:
    """One population: everybody with everybody."""

    def breed(
        self, mutation: Mutation, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants of the whole population."""
        return mutation(X, F, scale, generator)
