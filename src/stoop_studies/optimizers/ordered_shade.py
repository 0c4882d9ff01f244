"""Ordered SHADE: success-history differential evolution with the paper's ordered difference, prey and restarts.

The herd of the default on its own: no scouts, no shortened records. Where the problem has residuals its prey
dives by Levenberg-Marquardt, else by L-BFGS-B on differences of the cost. It plans over no budget.

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
from stoop.optimize.ledger import Evaluations, Ledger
from stoop.optimize.local_refinement import refine
from stoop.optimize.operators import MEMBERS, latin_hypercube
from stoop.optimize.population import GROWTH, LARGEST, Population, grown
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State
from stoop_studies.optimizers.pieces.operators import placed
from stoop_studies.optimizers.pieces.quasi_newton import QuasiNewtonDive

ELITE: Final = 0.2  #: share of the herd that counts as best
SEPARATION: Final = 0.1  #: of the unit box: nearer to an earlier dive's end is no new prey


@dataclass(frozen=True, kw_only=True)
class HerdState(State):
    """Where a run stands.

    Attributes
    ----------
    herd : the population
    ends : (m, D), where dives ended
    size : of the next herd
    """

    herd: Population
    ends: FloatArray
    size: int


@dataclass(frozen=True)
class OrderedShade:
    """The herd, its prey and its restarts; it never claims convergence.

    A step is a generation, a dive, or a new herd in place of one that has collapsed or stands still.

    Attributes
    ----------
    name : registered name
    members : of the first herd
    growth : of the herd at each restart
    largest : herd
    elite : share of the herd that counts as best
    separation : of the unit box, nearer than which to an earlier dive's end is no new prey
    quasi_newton : prey where only the cost is known
    """

    name: str = "ordered-shade"
    members: int = MEMBERS
    growth: float = GROWTH
    largest: int = LARGEST
    elite: float = ELITE
    separation: float = SEPARATION
    quasi_newton: QuasiNewtonDive = field(default_factory=QuasiNewtonDive)

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> HerdState:
        """Evaluate the first herd; the user's own values take the first places."""
        ledger = Ledger.at(problem, Evaluations.none(problem))
        generator = RandomStream.from_seed(seed).generator()
        X = placed(latin_hypercube(self.members, problem.dimension, generator), starts)
        herd = Population.first(X, ledger.costs(X, ledger.full))
        return HerdState(
            optimizer=self.name,
            generation=0,
            stream=RandomStream.of(generator),
            evaluations=ledger.evaluations,
            herd=herd,
            ends=np.empty((0, problem.dimension)),
            size=self._next(self.members),
        )

    def step(self, state: HerdState, problem: Problem) -> tuple[HerdState, Event]:
        """Do what is next: a new herd, a generation or a dive."""
        ledger = Ledger.at(problem, state.evaluations)
        state, event = self._act(state, ledger)
        return replace(state, evaluations=ledger.evaluations, generation=state.generation + 1), event

    def _act(self, state: HerdState, ledger: Ledger) -> tuple[HerdState, Event]:
        if state.herd.exhausted:
            return self._gather(state, ledger)
        if state.herd.age < state.herd.due:
            return self._evolve(state, ledger)
        member, herd = state.herd.next_start(state.ends, self.separation)
        state = replace(state, herd=herd)
        return self._evolve(state, ledger) if member is None else self._dive(state, member, ledger)

    def _next(self, size: int) -> int:
        return grown(size, self.growth, self.largest)

    def _gather(self, state: HerdState, ledger: Ledger) -> tuple[HerdState, Event]:
        """Gather a new herd that knows nothing of what was found before."""
        generator = state.stream.generator()
        X = latin_hypercube(state.size, ledger.dimension, generator)
        herd = Population.first(X, ledger.costs(X, ledger.full))
        event = Event("evolution", float(herd.F.min()), ledger.full, f"new herd of {len(X)}")
        stream = RandomStream.of(generator)
        return replace(
            state, herd=herd, ends=state.ends[:0], size=self._next(state.size), stream=stream
        ), event

    def _dive(self, state: HerdState, member: int, ledger: Ledger) -> tuple[HerdState, Event]:
        """Dive from a member; the end takes its place."""
        before = float(state.herd.F.min())
        x, cost = self._descend(ledger, state.herd.X[member].copy(), float(state.herd.F[member]), before)
        herd = state.herd.with_refined(member, x, cost, cost < before * (1.0 - 1e-12))
        ends = np.concatenate([state.ends, x[None, :]])
        return replace(state, herd=herd, ends=ends), Event("refinement", cost, ledger.full)

    def _descend(
        self, ledger: Ledger, x: FloatArray, cost: float, incumbent: float
    ) -> tuple[FloatArray, float]:
        """Return where the dive that suits the problem ends, and the cost there with the nuisances at zero."""
        above = incumbent if cost > incumbent else np.inf
        if not ledger.has_residuals:
            return self.quasi_newton(ledger, x, cost, above)
        end = refine(ledger, np.concatenate([x, np.zeros(ledger.extra)]), ledger.full, incumbent=above)
        y = end.z[: len(x)]
        # the herd lives where the nuisances are zero: only there may its members be compared
        lower = float(ledger.costs(y[None, :], ledger.full)[0]) if ledger.extra else end.cost
        return (y, lower) if lower < cost else (x, cost)

    def _evolve(self, state: HerdState, ledger: Ledger) -> tuple[HerdState, Event]:
        """Move the herd by one generation."""
        generator = state.stream.generator()
        trials = state.herd.ask(generator, self.elite)
        herd = state.herd.tell(trials, ledger.costs(trials.X, ledger.full), generator)
        event = Event("evolution", float(herd.F.min()), ledger.full)
        return replace(state, herd=herd, stream=RandomStream.of(generator)), event
