"""Structure: who may breed with whom, and who goes from one part of the population to another.

References
----------
Tasoulis, Pavlidis, Plagianakos and Vrahatis (2004), Parallel differential evolution, IEEE CEC, 2023-2029.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Protocol

import numpy as np

from stoop.base.arrays import Factor, FloatArray
from stoop.optimize.ledger import Ledger
from stoop_studies.optimizers.pieces.mutation import Mutation
from stoop_studies.optimizers.pieces.sequel import Turn

SMALLEST: Final = 6  #: members of an island; any mutation finds its partners there


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


@dataclass(frozen=True)
class Islands:
    """Several populations side by side: members breed on their own island only.

    Attributes
    ----------
    number : of islands, neighbors in the order of members; fewer where they would be smaller than `SMALLEST`
    """

    number: int = 5

    def breed(
        self, mutation: Mutation, X: FloatArray, F: FloatArray, scale: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return mutants, one island after the other."""
        mutants = np.empty_like(X)
        for place in self.places(len(X)):
            own = scale[place] if isinstance(scale, np.ndarray) else scale
            mutants[place] = mutation(X[place], F[place], own, generator)
        return mutants

    def places(self, members: int) -> list[slice]:
        """Return where each island lies in a population."""
        number = max(1, min(self.number, members // SMALLEST))
        ends = [members * k // number for k in range(number + 1)]
        return [slice(a, b) for a, b in pairwise(ends)]


@dataclass(frozen=True)
class RingMigration:
    """The best of each island replaces a random member, not the best, of the next one in a ring.

    Attributes
    ----------
    islands : the islands
    probability : that there is a migration after a generation (the migration constant)
    """

    islands: Islands
    probability: float = 0.2

    def __call__(
        self, turn: Turn, ledger: Ledger, generator: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Return members and costs after the migration, if there is one; nothing is evaluated."""
        places = self.islands.places(len(turn.X))
        if generator.random() >= self.probability or len(places) == 1:
            return turn.X, turn.F
        best = [place.start + int(turn.F[place].argmin()) for place in places]
        seats = [_seat(place, keep, generator) for place, keep in zip(places, best, strict=True)]
        X, F = turn.X.copy(), turn.F.copy()
        X[seats], F[seats] = turn.X[np.roll(best, 1)], turn.F[np.roll(best, 1)]
        return X, F


def _seat(place: slice, keep: int, generator: np.random.Generator) -> int:
    """Return a random member of an island other than the one to keep."""
    others: int = place.stop - place.start - 1
    seat = int(place.start) + int(generator.random() * others)
    return seat + (seat >= keep)
