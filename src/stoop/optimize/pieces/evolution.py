"""Differential evolution, composed of initialization, mutation, bounds, crossover, selection and prey.

"de-rand-1-bin", "de-best-2-bin" and the paper's "ps-gde" are three compositions of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from stoop.optimize.arrays import FloatArray
from stoop.optimize.ledger import Ledger, blank, opened
from stoop.optimize.pieces.bounds import clip
from stoop.optimize.pieces.crossover import binomial
from stoop.optimize.pieces.golden import SteepestDive
from stoop.optimize.pieces.initialization import chaos, uniform
from stoop.optimize.pieces.mutation import Best2, Mutation, Ordered, Rand1
from stoop.optimize.pieces.selection import greedy
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, State
from stoop.optimize.stream import from_generator, from_seed


@dataclass(frozen=True, kw_only=True)
class PopulationState(State):
    """Where a population stands.

    Attributes
    ----------
    X, F : (n, D) and (n,), members and their costs
    """

    X: FloatArray
    F: FloatArray


class LocalDive(Protocol):
    """From a member and its cost to where a local search ends, and the cost there."""

    def __call__(self, ledger: Ledger, x: FloatArray, cost: float) -> tuple[FloatArray, float]:
        """Return the end of the dive; never worse than its start."""
        ...


@dataclass(frozen=True)
class PreySchedule:
    """When the best members are dived from, in place of a generation.

    Attributes
    ----------
    dive : the local search
    period : generations from one local search to the next (the paper's NC)
    share : of the members that are dived from (the paper's pr)
    """

    dive: LocalDive
    period: int = 20
    share: float = 0.05


@dataclass(frozen=True)
class DifferentialEvolution:
    """Differential evolution on the full record; it never claims convergence.

    A step is a generation: evolution, or where the schedule says so, dives from the best members.

    Attributes
    ----------
    name : registered name
    mutation : from a population to mutants
    initialization : first population
    mend : what becomes of mutants outside the box
    members : of the population
    rate : of crossover
    prey : schedule of local search, or None
    """

    name: str
    mutation: Mutation
    initialization: Callable[[int, int, np.random.Generator], FloatArray] = uniform
    mend: Callable[[FloatArray, FloatArray], FloatArray] = clip
    members: int = 50
    rate: float = 0.9
    prey: PreySchedule | None = None

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> PopulationState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger = opened(problem, blank(problem))
        generator = from_seed(seed).generator()
        X = self.initialization(self.members, problem.dimension, generator)
        X[: len(starts)] = np.clip(starts, 0.0, 1.0)[: len(X)]
        F = ledger.costs(X, ledger.full)
        stream, books = from_generator(generator), ledger.books
        return PopulationState(optimizer=self.name, generation=0, stream=stream, books=books, X=X, F=F)

    def step(self, state: PopulationState, problem: Problem) -> tuple[PopulationState, Event]:
        """Do one generation."""
        ledger = opened(problem, state.books)
        if self.prey is not None and (state.generation + 1) % self.prey.period == 0:
            return _hunt(self.prey, state, ledger)
        trials, state = self.ask(state)
        state = self.tell(state, trials, ledger.costs(trials, ledger.full))
        return replace(state, books=ledger.books), Event("evolution", float(state.F.min()), ledger.full)

    def ask(self, state: PopulationState) -> tuple[FloatArray, PopulationState]:
        """Return one trial per member, and the state with its random numbers moved on."""
        generator = state.stream.generator()
        mutants = self.mend(self.mutation(state.X, state.F, generator), state.X)
        trials = binomial(state.X, mutants, self.rate, generator)
        return trials, replace(state, stream=from_generator(generator))

    def tell(self, state: PopulationState, trials: FloatArray, costs: FloatArray) -> PopulationState:
        """Return the state after selection."""
        X, F, _ = greedy(state.X, state.F, trials, costs)
        return replace(state, X=X, F=F, generation=state.generation + 1)


def _hunt(prey: PreySchedule, state: PopulationState, ledger: Ledger) -> tuple[PopulationState, Event]:
    """Dive from the best members."""
    X, F = state.X.copy(), state.F.copy()
    number = max(1, int(np.floor(prey.share * len(X) + 0.5)))
    for i in np.argsort(F, kind="stable")[:number]:
        X[i], F[i] = prey.dive(ledger, X[i].copy(), float(F[i]))
    event = Event("dive", float(F.min()), ledger.full, f"{number} prey")
    return replace(state, X=X, F=F, generation=state.generation + 1, books=ledger.books), event


def de_rand_1_bin() -> DifferentialEvolution:
    """Return DE/rand/1/bin (Storn and Price 1997, J. Global Optim. 11, 341-359; the paper's eq. 6)."""
    return DifferentialEvolution("de-rand-1-bin", Rand1(0.5))


def de_best_2_bin() -> DifferentialEvolution:
    """Return DE/best/2/bin (the paper's eq. 6, second line)."""
    return DifferentialEvolution("de-best-2-bin", Best2(0.5))


def ps_gde() -> DifferentialEvolution:
    """Return the paper's PS-GDE: chaotic start, ordered mutation (eq. 12), gradient prey.

    What the paper leaves open or prints wrongly is read as follows: local search when NC divides the
    generation, in place of evolution; the gradient by forward differences, which are counted; golden section
    on [0, 0.1] of the unit negative gradient; greedy replacement; F = 0.6, CR = 0.9; clipping at the bounds;
    0.05 x 50 prey rounded to 3.
    """
    prey = PreySchedule(SteepestDive())
    return DifferentialEvolution("ps-gde", Ordered(0.6), initialization=chaos, prey=prey)
