"""The loop of differential evolution with pieces put in: control, structure of the population, operators after selection.

A generation is: scale and rate (control), mutants (mutation, within a structure), bounds (mend), trials (crossover),
survivors (selection), operators after selection; or, where a schedule says so, local search from the best instead.

References
----------
Tasoulis, Pavlidis, Plagianakos and Vrahatis (2004), Parallel differential evolution, IEEE CEC, 2023-2029 (islands).
Chiou and Wang (1999), Hybrid method of evolutionary algorithms for static and dynamic optimization problems with
application to a fed-batch fermentation process, Comput. Chem. Eng. 23, 1277-1291 (acceleration, migration).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final, TypeVar

import numpy as np
from numpy.random import Generator

from stoop.base.arrays import BoolArray, Factor, FloatArray
from stoop.errors import IdentificationError
from stoop.optimize.ledger import Evaluations, Ledger
from stoop.optimize.population import MEMBERS, binomial, greedy
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State
from stoop_studies.optimizers.local_search import PreySchedule, steepest_line
from stoop_studies.optimizers.mutation import Control, Fixed, Mutation

SMALLEST: Final = 6  #: members of an island; every mutation finds its partners there
Initialization = Callable[[int, int, Generator], FloatArray]  #: (number, dimension, generator) -> points
#: parents, mutants, rate -> trials
Crossover = Callable[[FloatArray, FloatArray, Factor, Generator], FloatArray]
#: members and their costs after selection, and where a trial replaced its parent
Survivors = tuple[FloatArray, FloatArray, BoolArray]
#: parents and trials, each with costs -> survivors
Selection = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], Survivors]
S = TypeVar("S", bound=State)


def uniform(number: int, dimension: int, generator: Generator) -> FloatArray:
    """Return independent uniform points, (number, dimension)."""
    return generator.random((number, dimension))


def chaos(number: int, dimension: int, generator: Generator) -> FloatArray:
    """Return successive iterates of the logistic map, one orbit per variable (the paper's eq. 9, u = 4)."""
    points = np.empty((number, dimension))
    c = chaotic_start(dimension, generator)
    for i in range(number):
        points[i] = c
        c = 4.0 * c * (1.0 - c)
        absorbed = (c < 1e-12) | (c > 1.0 - 1e-12)
        if absorbed.any():
            c[absorbed] = chaotic_start(int(absorbed.sum()), generator)
    return points


def chaotic_start(dimension: int, generator: Generator) -> FloatArray:
    """Return uniform numbers, none of them a start from which the logistic map is not chaotic."""
    c = generator.random(dimension)
    while (bad := np.isin(c, (0.0, 0.25, 0.5, 0.75, 1.0))).any():
        c[bad] = generator.random(int(bad.sum()))
    return c


def placed(X: FloatArray, starts: FloatArray) -> FloatArray:
    """Return members X, (n, D), of which the user's own values, (k, D) or wider, take the first places."""
    first = np.clip(starts[: len(X), : X.shape[1]], 0.0, 1.0)
    return np.concatenate([first, X[len(first) :]])


def clip(mutants: FloatArray, parents: FloatArray | None = None) -> FloatArray:
    """Return points set on the bound of the unit box that they crossed."""
    inside: FloatArray = np.minimum(np.maximum(mutants, 0.0), 1.0)
    return inside


def first_population(
    problem: Problem, seed: int, starts: FloatArray, members: int, initialization: Initialization = uniform
) -> tuple[Ledger, Generator, FloatArray, FloatArray]:
    """Evaluate a first population, X (n, D) and F (n,), in which the user's own values take the first places."""
    ledger = Ledger.at(problem, Evaluations.none(problem))
    generator = RandomStream.from_seed(seed).generator()
    X = placed(initialization(members, problem.dimension, generator), starts)
    return ledger, generator, X, ledger.costs(X, ledger.full)


def begun(kind: type[S], name: str, ledger: Ledger, generator: Generator, **fields: Any) -> S:
    """Return the state of an optimizer before its first step."""
    stream = RandomStream.of(generator)
    return kind(optimizer=name, generation=0, stream=stream, evaluations=ledger.evaluations, **fields)


def advanced(state: S, ledger: Ledger, generator: Generator | None = None, **fields: Any) -> S:
    """Return the state after a step; without a generator no random numbers were drawn."""
    if generator is not None:
        fields["stream"] = RandomStream.of(generator)
    return replace(state, generation=state.generation + 1, evaluations=ledger.evaluations, **fields)


@dataclass(frozen=True)
class Islands:
    """A number of populations side by side, neighbors in the order of members, that breed on their own island only.

    There are fewer where they would be smaller than `SMALLEST`.
    """

    number: int = 5

    def breed(
        self, mutation: Mutation, X: FloatArray, F: FloatArray, scale: Factor, generator: Generator
    ) -> FloatArray:
        """Return one mutant per member, (n, D), one island after the other."""
        mutants = np.empty_like(X)
        for place in self.places(len(X)):
            own = scale[place] if isinstance(scale, np.ndarray) else scale
            found = mutation(X[place], F[place], own, generator)
            numbers = isinstance(found, np.ndarray) and found.dtype.kind in "fiu"
            if not numbers or found.shape != X[place].shape or not np.isfinite(found).all():
                name = getattr(mutation, "__name__", type(mutation).__name__)
                raise IdentificationError(
                    f"mutation {name}: what it returned is no array of finite numbers {X[place].shape}, one mutant for each "
                    "member; mend the function"
                )
            mutants[place] = found
        return mutants

    def places(self, members: int) -> list[slice]:
        """Return where each island lies in a population."""
        number = max(1, min(self.number, members // SMALLEST))
        return [slice(a, b) for a, b in pairwise(members * k // number for k in range(number + 1))]


@dataclass(frozen=True)
class Selected:
    """A population after selection: survivors and their costs, (n, D) and (n,), and the costs before the generation, (n,)."""

    X: FloatArray
    F: FloatArray
    before: FloatArray

    @property
    def improved(self) -> bool:
        """Whether the generation brought a better best."""
        return bool(self.F.min() < self.before.min())


#: Members and costs for the next generation; what it evaluates goes through the ledger, and the arrays stay as they are.
AfterSelection = Callable[[Selected, Ledger, Generator], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class RingMigration:
    """The best of each island replaces a random member, not the best, of the next one in a ring.

    There is a migration after a generation with this probability (the migration constant).
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
    here the first step is as long as the population's mean distance from its best. After so many halvings the best stays.
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
    and one end of the box, the end with a probability that is the best's distance from it. In the publication the
    width is relative to the best's value.
    """

    tolerance: float = 0.1  #: share of diverse variables below which there is a migration
    width: float = 1e-5  #: of the box; below it two values are the same

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
    """

    threshold: float = 1e-8  #: relative variance below which members are mutated
    probability: float = 0.3  #: of a member, where all costs are equal
    spread: float = 0.25  #: standard deviation of the step, in the unit box

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


@dataclass(frozen=True, kw_only=True)
class PopulationState(State):
    """Members and their costs, (n, D) and (n,), and the memory of the control; None where it has none."""

    X: FloatArray
    F: FloatArray
    memory: Any = None


@dataclass(frozen=True)
class DifferentialEvolution:
    """Differential evolution on the full record; it never claims convergence.

    A step is a generation: evolution, or where the schedule says so, local search from the best members.
    """

    name: str  #: registered name
    mutation: Mutation  #: from a population to mutants
    control: Control = field(default_factory=Fixed)  #: scale and rate of each generation
    initialization: Initialization = uniform  #: first population
    crossover: Crossover = binomial  #: from parents and mutants to trials
    mend: Callable[[FloatArray, FloatArray], FloatArray] = clip  #: brings mutants back into the box
    selection: Selection = greedy  #: of the survivors
    structure: Islands = field(default_factory=lambda: Islands(1))  #: which members may breed with each other
    after_selection: tuple[AfterSelection, ...] = ()  #: done one after the other before the next generation
    members: int = MEMBERS  #: of the population
    prey: PreySchedule | None = None

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> PopulationState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger, generator, X, F = first_population(problem, seed, starts, self.members, self.initialization)
        return begun(PopulationState, self.name, ledger, generator, X=X, F=F, memory=self.control.begin())

    def step(self, state: PopulationState, problem: Problem) -> tuple[PopulationState, Event]:
        """Do one generation."""
        ledger = Ledger.at(problem, state.evaluations)
        if self.prey is not None and self.prey.due(state.generation + 1):
            X, F = self.prey.refine(ledger, state.X, state.F)
            event = Event("refinement", float(F.min()), ledger.full, f"{self.prey.number(len(X))} prey")
            return advanced(state, ledger, X=X, F=F), event
        generator = state.stream.generator()
        scale, rate = self.control.sample(state.memory, state.F, generator)
        mutants = self.structure.breed(self.mutation, state.X, state.F, scale, generator)
        trials = self.crossover(state.X, self.mend(mutants, state.X), rate, generator)
        costs = ledger.costs(trials, ledger.full)
        X, F, _ = self.selection(state.X, state.F, trials, costs)
        for operator in self.after_selection:
            X, F = operator(Selected(X, F, state.F), ledger, generator)
        memory = self.control.learn(state.memory, scale, rate, state.F, costs)
        event = Event("evolution", float(F.min()), ledger.full)
        return advanced(state, ledger, generator, X=X, F=F, memory=memory), event
