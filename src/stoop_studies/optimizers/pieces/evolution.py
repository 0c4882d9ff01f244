"""The loop of differential evolution; everything that can differ is a piece of its own.

A generation is: scale and rate (control), mutants (mutation, within a structure), bounds (mend), trials (crossover),
survivors (selection), sequels; or, where a schedule says so, dives from the best in its place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from stoop.base.arrays import BoolArray, Factor, FloatArray
from stoop.optimize.ledger import Evaluations, Ledger
from stoop.optimize.operators import MEMBERS, binomial, greedy
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State
from stoop_studies.optimizers.pieces.control import Control, Fixed
from stoop_studies.optimizers.pieces.islands import Structure, Whole
from stoop_studies.optimizers.pieces.mutation import Mutation
from stoop_studies.optimizers.pieces.operators import clip, placed, uniform
from stoop_studies.optimizers.pieces.prey import PreySchedule
from stoop_studies.optimizers.pieces.sequel import Sequel, Turn


@dataclass(frozen=True, kw_only=True)
class PopulationState(State):
    """Where a population stands.

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
        self, parents: FloatArray, mutants: FloatArray, rate: Factor, generator: np.random.Generator
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


@dataclass(frozen=True)
class DifferentialEvolution:
    """Differential evolution on the full record; it never claims convergence.

    A step is a generation: evolution, or where the schedule says so, dives from the best members.

    Attributes
    ----------
    name : registered name
    mutation : from a population to mutants
    control : scale and rate of each generation
    initialization : first population
    crossover : from parents and mutants to trials
    mend : what becomes of mutants outside the box
    selection : who survives
    structure : who may breed with whom
    sequels : done one after the other between selection and the next generation
    members : of the population
    prey : schedule of local search, or None
    """

    name: str
    mutation: Mutation
    control: Control = field(default_factory=Fixed)
    initialization: Callable[[int, int, np.random.Generator], FloatArray] = uniform
    crossover: Crossover = binomial
    mend: Callable[[FloatArray, FloatArray], FloatArray] = clip
    selection: Selection = greedy
    structure: Structure = field(default_factory=Whole)
    sequels: tuple[Sequel, ...] = ()
    members: int = MEMBERS
    prey: PreySchedule | None = None

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> PopulationState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger = Ledger.at(problem, Evaluations.none(problem))
        generator = RandomStream.from_seed(seed).generator()
        X = placed(self.initialization(self.members, problem.dimension, generator), starts)
        F = ledger.costs(X, ledger.full)
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
            return _hunt(self.prey, state, ledger)
        return self._evolve(state, ledger)

    def _evolve(self, state: PopulationState, ledger: Ledger) -> tuple[PopulationState, Event]:
        """Breed, select, and let the sequels follow."""
        generator = state.stream.generator()
        scale, rate = self.control.sample(state.memory, state.F, generator)
        trials = self._trials(state.X, state.F, scale, rate, generator)
        costs = ledger.costs(trials, ledger.full)
        X, F, _ = self.selection(state.X, state.F, trials, costs)
        for sequel in self.sequels:
            X, F = sequel(Turn(X, F, state.F, state.generation + 1), ledger, generator)
        after = PopulationState(
            optimizer=state.optimizer,
            generation=state.generation + 1,
            stream=RandomStream.of(generator),
            evaluations=ledger.evaluations,
            X=X,
            F=F,
            memory=self.control.learn(state.memory, scale, rate, state.F, costs),
        )
        return after, Event("evolution", float(F.min()), ledger.full)

    def _trials(
        self, X: FloatArray, F: FloatArray, scale: Factor, rate: Factor, generator: np.random.Generator
    ) -> FloatArray:
        """Return one trial per member."""
        mutants = self.structure.breed(self.mutation, X, F, scale, generator)
        return self.crossover(X, self.mend(mutants, X), rate, generator)


def _hunt(prey: PreySchedule, state: PopulationState, ledger: Ledger) -> tuple[PopulationState, Event]:
    """Dive from the best members."""
    X, F = prey.hunt(ledger, state.X, state.F)
    event = Event("refinement", float(F.min()), ledger.full, f"{prey.number(len(X))} prey")
    return replace(state, X=X, F=F, generation=state.generation + 1, evaluations=ledger.evaluations), event
