"""Ordered SHADE: success-history differential evolution with the paper's ordered difference, prey and restarts.

The population of the default on its own, without scouts and shortened records. Local searches start from its prey:
Levenberg-Marquardt where the problem has residuals, else L-BFGS-B on differences of the cost. It plans over no budget.

Elite and separation are larger than the default's, chosen on BBOB instances 6 to 15; the rest is the default's.

References
----------
Tanabe and Fukunaga (2013), IEEE CEC, 71-78 (SHADE); the paper's eq. (12) for the order, its section IV.C for
prey; Auger and Hansen (2005), IEEE CEC, 1769-1776, for restarts with a growing population.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.local_refinement import refine
from stoop.optimize.operators import MEMBERS, latin_hypercube
from stoop.optimize.population import GROWTH, LARGEST, Population, grown
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State
from stoop_studies.optimizers.pieces.evolution import first_population
from stoop_studies.optimizers.pieces.local_search import QuasiNewton

ELITE: Final = 0.2  #: share of the population that counts as best
SEPARATION: Final = (
    0.1  #: of the unit box: a member nearer to the end of an earlier local search is no new prey
)


@dataclass(frozen=True, kw_only=True)
class HerdState(State):
    """State of the population between steps.

    Attributes
    ----------
    population : the population
    optima : (m, D), of the local searches
    population_size : of the next population
    """

    population: Population
    optima: FloatArray
    population_size: int


@dataclass(frozen=True)
class OrderedShade:
    """The population, its prey and its restarts; it never claims convergence.

    A step is a generation, a local search, or a new population in place of one that has collapsed or stagnates.

    Attributes
    ----------
    name : registered name
    members : of the first population
    growth : of the population at each restart
    largest : population
    elite : share of the population that counts as best
    separation : of the unit box; a member nearer to the end of an earlier local search is no new prey
    quasi_newton : local search where only the cost is known
    """

    name: str = "ordered-shade"
    members: int = MEMBERS
    growth: float = GROWTH
    largest: int = LARGEST
    elite: float = ELITE
    separation: float = SEPARATION
    quasi_newton: QuasiNewton = field(default_factory=QuasiNewton)

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> HerdState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger, generator, X, F = first_population(problem, seed, starts, self.members, latin_hypercube)
        return HerdState(
            optimizer=self.name,
            generation=0,
            stream=RandomStream.of(generator),
            evaluations=ledger.evaluations,
            population=Population.first(X, F),
            optima=np.empty((0, problem.dimension)),
            population_size=grown(self.members, self.growth, self.largest),
        )

    def step(self, state: HerdState, problem: Problem) -> tuple[HerdState, Event]:
        """Do what is next: a new population, a generation or a local search."""
        ledger = Ledger.at(problem, state.evaluations)
        state, event = self._act(state, ledger)
        return replace(state, evaluations=ledger.evaluations, generation=state.generation + 1), event

    def _act(self, state: HerdState, ledger: Ledger) -> tuple[HerdState, Event]:
        if state.population.exhausted:
            return self._restart(state, ledger)
        if state.population.age < state.population.due:
            return self._evolve(state, ledger)
        member, population = state.population.next_start(state.optima, self.separation)
        state = replace(state, population=population)
        return self._evolve(state, ledger) if member is None else self._refine(state, member, ledger)

    def _restart(self, state: HerdState, ledger: Ledger) -> tuple[HerdState, Event]:
        """Draw a new, larger population, independent of all earlier results."""
        generator = state.stream.generator()
        X = latin_hypercube(state.population_size, ledger.dimension, generator)
        population = Population.first(X, ledger.costs(X, ledger.full))
        event = Event("evolution", float(population.F.min()), ledger.full, f"new population of {len(X)}")
        size, stream = grown(state.population_size, self.growth, self.largest), RandomStream.of(generator)
        return replace(
            state, population=population, optima=state.optima[:0], population_size=size, stream=stream
        ), event

    def _refine(self, state: HerdState, member: int, ledger: Ledger) -> tuple[HerdState, Event]:
        """Search locally from a member; the end takes its place."""
        before = float(state.population.F.min())
        x, cost = self._search(
            ledger, state.population.X[member].copy(), float(state.population.F[member]), before
        )
        population = state.population.with_refined(member, x, cost, cost < before * (1.0 - 1e-12))
        optima = np.concatenate([state.optima, x[None, :]])
        return replace(state, population=population, optima=optima), Event("refinement", cost, ledger.full)

    def _search(
        self, ledger: Ledger, x: FloatArray, cost: float, incumbent: float
    ) -> tuple[FloatArray, float]:
        """Return the end of the local search that suits the problem, and the cost there with the nuisances at zero."""
        above = incumbent if cost > incumbent else np.inf
        if not ledger.has_residuals:
            return self.quasi_newton(ledger, x, cost, above)
        end = refine(ledger, np.concatenate([x, np.zeros(ledger.extra)]), ledger.full, incumbent=above)
        y = end.z[: len(x)]
        # members of the population have their nuisances at zero: only there may they be compared
        lower = float(ledger.costs(y[None, :], ledger.full)[0]) if ledger.extra else end.cost
        return (y, lower) if lower < cost else (x, cost)

    def _evolve(self, state: HerdState, ledger: Ledger) -> tuple[HerdState, Event]:
        """Evolve the population by one generation."""
        generator = state.stream.generator()
        trials = state.population.ask(generator, self.elite)
        population = state.population.tell(trials, ledger.costs(trials.X, ledger.full), generator)
        event = Event("evolution", float(population.F.min()), ledger.full)
        return replace(state, population=population, stream=RandomStream.of(generator)), event
