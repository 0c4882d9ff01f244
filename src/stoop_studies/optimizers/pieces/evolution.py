"""The loop of differential evolution; everything that can differ is a piece of its own.

A generation is: scale and rate (control), mutants (mutation, within a structure), bounds (mend), trials (crossover),
survivors (selection), operators after selection; or, where a schedule says so, local search from the best instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from numpy.random import Generator

from stoop.base.arrays import BoolArray, Factor, FloatArray
from stoop.optimize.ledger import Evaluations, Ledger
from stoop.optimize.operators import MEMBERS, binomial, greedy
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State
from stoop_studies.optimizers.pieces.control import Control, Fixed
from stoop_studies.optimizers.pieces.diversity import AfterSelection, Selected, Structure, Whole
from stoop_studies.optimizers.pieces.local_search import PreySchedule
from stoop_studies.optimizers.pieces.mutation import Mutation
from stoop_studies.optimizers.pieces.operators import clip, placed, uniform

Initialization = Callable[[int, int, Generator], FloatArray]  #: (number, dimension, generator) -> points


@dataclass(frozen=True, kw_only=True)
class PopulationState(State):
    """State of a population.

    Attributes
    ----------
    X, F : (n, D) and (n,), members and their costs
    memory : of the control; None where it has none
    """

    X: FloatArray
    F: FloatArray
    memory: Any = None


class Crossover(Protocol):
    """From parents and mutants, both (n, D), to trials, (n, D)."""

    def __call__(
        self, parents: FloatArray, mutants: FloatArray, rate: Factor, generator: Generator
    ) -> FloatArray:
        """Return trials; each takes at least one variable from its mutant."""
        ...


class Selection(Protocol):
    """From parents and trials to survivors."""

    def __call__(
        self, parents: FloatArray, costs: FloatArray, trials: FloatArray, trial_costs: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return survivors (n, D), their costs (n,), and where a trial replaced its parent (n,)."""
        ...


def first_population(
    problem: Problem, seed: int, starts: FloatArray, members: int, initialization: Initialization = uniform
) -> tuple[Ledger, Generator, FloatArray, FloatArray]:
    """Evaluate a first population; the user's own values take the first places.

    Returns
    -------
    ledger, generator
        After it.
    X, F : (n, D) and (n,)
    """
    ledger, generator = (
        Ledger.at(problem, Evaluations.none(problem)),
        RandomStream.from_seed(seed).generator(),
    )
    X = placed(initialization(members, problem.dimension, generator), starts)
    return ledger, generator, X, ledger.costs(X, ledger.full)


@dataclass(frozen=True)
class DifferentialEvolution:
    """Differential evolution on the full record; it never claims convergence.

    A step is a generation: evolution, or where the schedule says so, local search from the best members.

    Attributes
    ----------
    name : registered name
    mutation : from a population to mutants
    control : scale and rate of each generation
    initialization : first population
    crossover : from parents and mutants to trials
    mend : brings mutants back into the box
    selection : of the survivors
    structure : which members may breed with each other
    after_selection : done one after the other before the next generation
    members : of the population
    prey : schedule of local search, or None
    """

    name: str
    mutation: Mutation
    control: Control = field(default_factory=Fixed)
    initialization: Initialization = uniform
    crossover: Crossover = binomial
    mend: Callable[[FloatArray, FloatArray], FloatArray] = clip
    selection: Selection = greedy
    structure: Structure = field(default_factory=Whole)
    after_selection: tuple[AfterSelection, ...] = ()
    members: int = MEMBERS
    prey: PreySchedule | None = None

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> PopulationState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger, generator, X, F = first_population(problem, seed, starts, self.members, self.initialization)
        return PopulationState(
            optimizer=self.name,
            generation=0,
            stream=RandomStream.of(generator),
            evaluations=ledger.evaluations,
            X=X,
            F=F,
            memory=self.control.begin(len(X)),
        )

    def step(self, state: PopulationState, problem: Problem) -> tuple[PopulationState, Event]:
        """Do one generation."""
        ledger = Ledger.at(problem, state.evaluations)
        if self.prey is not None and self.prey.due(state.generation + 1):
            X, F = self.prey.refine(ledger, state.X, state.F)
            after = replace(state, X=X, F=F)
            event = Event("refinement", float(F.min()), ledger.full, f"{self.prey.number(len(X))} prey")
        else:
            after = self._evolve(state, ledger)
            event = Event("evolution", float(after.F.min()), ledger.full)
        return replace(after, generation=state.generation + 1, evaluations=ledger.evaluations), event

    def _evolve(self, state: PopulationState, ledger: Ledger) -> PopulationState:
        """Return the population after mutation, crossover, selection and what follows it."""
        generator = state.stream.generator()
        scale, rate = self.control.sample(state.memory, state.F, generator)
        mutants = self.structure.breed(self.mutation, state.X, state.F, scale, generator)
        trials = self.crossover(state.X, self.mend(mutants, state.X), rate, generator)
        costs = ledger.costs(trials, ledger.full)
        X, F, _ = self.selection(state.X, state.F, trials, costs)
        for operator in self.after_selection:
            X, F = operator(Selected(X, F, state.F), ledger, generator)
        memory = self.control.learn(state.memory, scale, rate, state.F, costs)
        return replace(state, X=X, F=F, memory=memory, stream=RandomStream.of(generator))
