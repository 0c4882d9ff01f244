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
from stoop.optimize import herd as herds
from stoop.optimize.herd import Herd
from stoop.optimize.ledger import Ledger, opened
from stoop.optimize.levenberg import dive
from stoop.optimize.pieces.initialization import MEMBERS, latin_hypercube
from stoop.optimize.problem import Problem
from stoop.optimize.scalar import has_residuals
from stoop.optimize.state import Event, State
from stoop.optimize.stream import from_generator
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
    herd : the population
    ends : (m, D), of the local searches
    size : of the next population
    """

    herd: Herd
    ends: FloatArray
    size: int


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
    growth: float = herds.GROWTH
    largest: int = herds.LARGEST
    elite: float = ELITE
    separation: float = SEPARATION
    quasi_newton: QuasiNewton = field(default_factory=QuasiNewton)

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> HerdState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger, generator, X, F = first_population(problem, seed, starts, self.members, latin_hypercube)
        return HerdState(
            optimizer=self.name,
            generation=0,
            stream=from_generator(generator),
            books=ledger.books,
            herd=herds.gather(X, F),
            ends=np.empty((0, problem.dimension)),
            size=herds.grown(self.members, self.growth, self.largest),
        )

    def step(self, state: HerdState, problem: Problem) -> tuple[HerdState, Event]:
        """Do what is next: a new population, a generation or a local search."""
        ledger = opened(problem, state.books)
        state, event = self._act(state, ledger)
        return replace(state, books=ledger.books, generation=state.generation + 1), event

    def _act(self, state: HerdState, ledger: Ledger) -> tuple[HerdState, Event]:
        if herds.spent(state.herd):
            return self._restart(state, ledger)
        if state.herd.age < state.herd.due:
            return self._evolve(state, ledger)
        member, herd = herds.prey(state.herd, state.ends, self.separation)
        state = replace(state, herd=herd)
        return self._evolve(state, ledger) if member is None else self._refine(state, member, ledger)

    def _restart(self, state: HerdState, ledger: Ledger) -> tuple[HerdState, Event]:
        """Draw a new, larger population, independent of all earlier results."""
        generator = state.stream.generator()
        X = latin_hypercube(state.size, ledger.dimension, generator)
        herd = herds.gather(X, ledger.costs(X, ledger.full))
        event = Event("evolution", float(herd.F.min()), ledger.full, f"new herd of {len(X)}")
        size, stream = herds.grown(state.size, self.growth, self.largest), from_generator(generator)
        return replace(state, herd=herd, ends=state.ends[:0], size=size, stream=stream), event

    def _refine(self, state: HerdState, member: int, ledger: Ledger) -> tuple[HerdState, Event]:
        """Search locally from a member; the end takes its place."""
        before = float(state.herd.F.min())
        x, cost = self._search(ledger, state.herd.X[member].copy(), float(state.herd.F[member]), before)
        herd = herds.settle(state.herd, member, x, cost, cost < before * (1.0 - 1e-12))
        ends = np.concatenate([state.ends, x[None, :]])
        return replace(state, herd=herd, ends=ends), Event("dive", cost, ledger.full)

    def _search(
        self, ledger: Ledger, x: FloatArray, cost: float, incumbent: float
    ) -> tuple[FloatArray, float]:
        """Return the end of the local search that suits the problem, and the cost there with the nuisances at zero."""
        above = incumbent if cost > incumbent else np.inf
        if not has_residuals(ledger):
            return self.quasi_newton(ledger, x, cost, above)
        end = dive(ledger, np.concatenate([x, np.zeros(ledger.extra)]), ledger.full, incumbent=above)
        y = end.z[: len(x)]
        # members of the population have their nuisances at zero: only there may they be compared
        lower = float(ledger.costs(y[None, :], ledger.full)[0]) if ledger.extra else end.cost
        return (y, lower) if lower < cost else (x, cost)

    def _evolve(self, state: HerdState, ledger: Ledger) -> tuple[HerdState, Event]:
        """Evolve the population by one generation."""
        generator = state.stream.generator()
        trials = herds.ask(state.herd, generator, self.elite)
        herd = herds.tell(state.herd, trials, ledger.costs(trials.X, ledger.full), generator)
        event = Event("evolution", float(herd.F.min()), ledger.full)
        return replace(state, herd=herd, stream=from_generator(generator)), event
