"""Structure and diversity of a population: islands, and what is done between selection and the next generation."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Protocol

import numpy as np
from numpy.random import Generator

from stoop.base.arrays import Factor, FloatArray
from stoop.optimize.ledger import Ledger
from stoop_studies.optimizers.pieces.local_search import steepest_line
from stoop_studies.optimizers.pieces.mutation import Mutation

SMALLEST: Final = 6  #: members of an island; every mutation finds its partners there


@dataclass(frozen=True)
class Selected:
    """A population after selection.

    Attributes
    ----------
    X, F : (n, D) and (n,), survivors and their costs
    before : (n,), costs before the generation
    """

    X: FloatArray
    F: FloatArray
    before: FloatArray

    @property
    def improved(self) -> bool:
        """Whether the generation brought a better best."""
        return bool(self.F.min() < self.before.min())


class AfterSelection(Protocol):
    """Changes the survivors of a generation; whatever it evaluates goes through the ledger."""

    def __call__(self, now: Selected, ledger: Ledger, generator: Generator) -> tuple[FloatArray, FloatArray]:
        """Return members and costs for the next generation; the arrays of `now` are left as they are."""
        ...


class Structure(Protocol):
    """Lets a mutation see the population, or parts of it."""

    def breed(
        self, mutation: Mutation, X: FloatArray, F: FloatArray, scale: Factor, generator: Generator
    ) -> FloatArray:
        """Return one mutant per member, (n, D)."""
        ...


@dataclass(frozen=True)
class Whole:
    """One population."""

    def breed(
        self, mutation: Mutation, X: FloatArray, F: FloatArray, scale: Factor, generator: Generator
    ) -> FloatArray:
        """Return mutants of the whole population."""
        return mutation(X, F, scale, generator)


@dataclass(frozen=True)
class Islands:
    """Several populations side by side: members breed on their own island only.

    Attributes
    ----------
    number : of islands, neighbors in the order of members; fewer where they would be smaller than `SMALLEST`

    References
    ----------
    Tasoulis, Pavlidis, Plagianakos and Vrahatis (2004), Parallel differential evolution, IEEE CEC, 2023-2029.
    """

    number: int = 5

    def breed(
        self, mutation: Mutation, X: FloatArray, F: FloatArray, scale: Factor, generator: Generator
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
        return [slice(a, b) for a, b in pairwise(members * k // number for k in range(number + 1))]


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

    def __call__(self, now: Selected, ledger: Ledger, generator: Generator) -> tuple[FloatArray, FloatArray]:
        """Return members and costs after the migration, if there is one; nothing is evaluated."""
        places = self.islands.places(len(now.X))
        if generator.random() >= self.probability or len(places) == 1:
            return now.X, now.F
        best = [place.start + int(now.F[place].argmin()) for place in places]
        seats = []
        for place, keep in zip(places, best, strict=True):
            seat = place.start + int(generator.random() * (place.stop - place.start - 1))
            seats.append(seat + (seat >= keep))
        X, F = now.X.copy(), now.F.copy()
        X[seats], F[seats] = now.X[np.roll(best, 1)], now.F[np.roll(best, 1)]
        return X, F


@dataclass(frozen=True)
class Acceleration:
    """Where a generation did not improve the best, the best takes a step down its gradient, halved until it descends.

    The publication steps by the gradient times a factor that begins at 1. A gradient has the unit of the cost, so
    here the first step is as long as the population's mean distance from its best.

    Attributes
    ----------
    halvings : of the step at most; then the best stays where it is

    References
    ----------
    Chiou and Wang (1999), Hybrid method of evolutionary algorithms for static and dynamic optimization problems
    with application to a fed-batch fermentation process, Comput. Chem. Eng. 23, 1277-1291.
    """

    halvings: int = 4

    def __call__(self, now: Selected, ledger: Ledger, generator: Generator) -> tuple[FloatArray, FloatArray]:
        """Return members and costs; the gradient takes D evaluations, each step one."""
        best = int(now.F.argmin())
        if now.improved or not np.isfinite(now.F[best]):
            return now.X, now.F
        line = steepest_line(ledger, now.X[best], float(now.F[best]))
        if line is None:
            return now.X, now.F
        X, F = now.X.copy(), now.F.copy()
        reach = float(np.sqrt(((X - X[best]) ** 2).sum(axis=1)).mean())
        for halving in range(self.halvings + 1):
            y = line(reach * 0.5**halving)
            lower = float(ledger.costs(y[None, :], ledger.full)[0])
            if lower < now.F[best]:
                X[best], F[best] = y, lower
                break
        return X, F


@dataclass(frozen=True)
class Migration:
    """A population that has contracted is drawn anew about its best.

    A variable of a member counts as diverse if it lies further than `width` from the best's. Where the share of
    diverse variables falls below `tolerance`, every other member is drawn anew: each variable between the best's
    and one end of the box, the end with a probability that is the best's distance from it.

    Attributes
    ----------
    tolerance : share of diverse variables below which there is a migration
    width : of the box; below it two values are the same

    References
    ----------
    Chiou and Wang (1999), Comput. Chem. Eng. 23, 1277-1291; there the width is relative to the best's value.
    """

    tolerance: float = 0.1
    width: float = 1e-5

    def __call__(self, now: Selected, ledger: Ledger, generator: Generator) -> tuple[FloatArray, FloatArray]:
        """Return members and costs; a migration takes n - 1 evaluations."""
        best = int(now.F.argmin())
        others = np.delete(now.X, best, axis=0)
        if (np.abs(others - now.X[best]) > self.width).mean() >= self.tolerance:
            return now.X, now.F
        X = scattered(now.X[best], len(others), generator)
        F = ledger.costs(X, ledger.full)
        return np.insert(X, best, now.X[best], axis=0), np.insert(F, best, now.F[best])


def scattered(x: FloatArray, number: int, generator: Generator) -> FloatArray:
    """Return points, (number, D), each variable uniform between x's and the end of the box that is drawn."""
    down = generator.random((number, len(x))) < x
    reach = np.where(down, -x, 1.0 - x)
    points: FloatArray = x + generator.random((number, len(x))) * reach
    return points


@dataclass(frozen=True)
class SecondMutation:
    """A population whose costs have become nearly equal is mutated a second time.

    Where the variance of the costs, relative to their mean squared, falls below `threshold`, each member but the
    best is replaced, with a probability that grows from 0 there to `probability` at no variance, by a Gaussian
    step from itself.

    Attributes
    ----------
    threshold : relative variance below which members are mutated
    probability : of a member, where all costs are equal
    spread : standard deviation of the step, in the unit box
    """

    threshold: float = 1e-8
    probability: float = 0.3
    spread: float = 0.25

    def __call__(self, now: Selected, ledger: Ledger, generator: Generator) -> tuple[FloatArray, FloatArray]:
        """Return members and costs; each mutated member takes one evaluation."""
        variance = relative_variance(now.F)
        if not variance < self.threshold:
            return now.X, now.F
        mutated = generator.random(len(now.X)) < self.probability * (1.0 - variance / self.threshold)
        mutated[now.F.argmin()] = False
        if not mutated.any():
            return now.X, now.F
        X, F = now.X.copy(), now.F.copy()
        steps = self.spread * generator.standard_normal((int(mutated.sum()), X.shape[1]))
        X[mutated] = np.clip(X[mutated] + steps, 0.0, 1.0)
        F[mutated] = ledger.costs(X[mutated], ledger.full)
        return X, F


def relative_variance(F: FloatArray) -> float:
    """Return the variance of costs, (n,), over their mean squared; inf where a cost is infinite or all are zero."""
    mean = float(F.mean())
    if not np.isfinite(mean) or mean == 0.0:
        return np.inf
    return float(((F / mean - 1.0) ** 2).mean())
