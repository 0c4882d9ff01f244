"""Success-history differential evolution: L-SHADE and jSO, whose population shrinks over the planned budget; ordered SHADE.

References
----------
Tanabe and Fukunaga (2013), IEEE CEC, 71-78 (SHADE).
Tanabe and Fukunaga (2014), Improving the search performance of SHADE using linear population size reduction,
IEEE CEC, 1658-1665; the constants are those of the paper's section IV.
Zhang and Sanderson (2009), IEEE TEC 13, 945-958 (JADE: current-to-pbest).
Brest, Maucec and Boskovic (2017), Single objective real-parameter optimization: algorithm jSO, IEEE CEC,
1311-1318.
Brest, Maucec and Boskovic (2016), iL-SHADE: improved L-SHADE algorithm for single objective real-parameter
optimization, IEEE CEC, 1188-1195 (the entry fixed at 0.9, and an elite other than the parent at first).
Auger and Hansen (2005), IEEE CEC, 1769-1776, for restarts with a growing population; the PS-GDE paper's eq. (12) for the
order in the difference, its section IV.C for local search from the best.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import log, sqrt
from typing import ClassVar, Final

import numpy as np
from numpy.random import Generator

from stoop.base.arrays import BoolArray, Factor, FloatArray, IntArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.population import (
    MEMBERS,
    ParameterMemory,
    Population,
    Strategy,
    binomial,
    elite,
    latin_hypercube,
    midpoint,
    success_means,
    two_others,
    update_archive,
)
from stoop.optimize.problem import Problem, ScalarProblem
from stoop.optimize.state import Event, State
from stoop_studies.optimizers.evolution import advanced, begun, first_population
from stoop_studies.optimizers.local_search import LevenbergMarquardt, QuasiNewton

FEWEST: Final = 4  #: members at the end; the mutation needs as many
TERMINAL: Final = -1.0  #: a rate of the memory below zero: only crossover rate 0 works, and stays
FIXED: Final = 0.9  #: scale and rate of the entry that jSO never learns
#: larger than the default's, chosen on BBOB instances 6 to 15
STRATEGY: Final = Strategy(elite=0.2, separation=0.1)
Choice = Callable[[FloatArray, float, Generator], IntArray]


@dataclass(frozen=True)
class CurrentToPBest:
    """Current-to-pbest/1: x + scale (pull (p - x) + a - b), b of the members and the archive together."""

    archive: FloatArray  #: (m, D), may be empty
    share: float = 0.11  #: of the members that count as elite
    pull: float = 1.0  #: weight of the step towards the elite (jSO's Fw over F)
    choose: Choice = elite  #: who of the elite is p

    def __call__(self, X: FloatArray, F: FloatArray, scale: Factor, generator: Generator) -> FloatArray:
        """Return mutants, (n, D)."""
        towards = X[self.choose(F, self.share, generator)]
        pool = np.concatenate([X, self.archive])
        a, b = two_others(len(X), len(pool), generator)
        mutants: FloatArray = X + scale * (self.pull * (towards - X) + X[a] - pool[b])
        return mutants


def elite_but_self(F: FloatArray, share: float, generator: Generator) -> IntArray:
    """Return for each member, (n,), one of the best `share` of all that is not the member itself."""
    size, order = max(2, round(share * len(F))), np.argsort(F, kind="stable")
    rank = np.empty(len(F), dtype=np.intp)
    rank[order] = np.arange(len(F))
    draw = (generator.random(len(F)) * np.where(rank < size, size - 1, size)).astype(np.intp)
    chosen: IntArray = order[draw + (draw >= rank)]
    return chosen


@dataclass(frozen=True, kw_only=True)
class ShadeState(State):
    """State of a shrinking population."""

    #: X, F: (n, D) and (n,), members and their costs
    X: FloatArray
    F: FloatArray
    archive: FloatArray  #: (a, D), parents that lost
    memory: ParameterMemory  #: scales and rates that worked
    first: int  #: members of the first population


@dataclass(frozen=True)
class LShade:
    """L-SHADE: success-history adaptation, current-to-pbest with archive, and linear population size reduction.

    It plans over its budget, in trajectories (None: 10,000 per variable, as in the competitions): where the run is given
    another one, it is not at its best. After the planned budget its last four members go on. It never claims convergence.
    """

    budget: float | None = None
    name: ClassVar[str] = "l-shade"  #: registered name
    archived: ClassVar[float] = 2.6  #: size of the archive, in members

    def members(self, dimension: int) -> int:
        """Return the size of the first population: 18 for each variable."""
        return 18 * dimension

    def memory(self) -> ParameterMemory:
        """Return the memory at the start: six entries of 0.5."""
        return ParameterMemory.fresh(6, scale=0.5, rate=0.5)

    def learn(
        self,
        memory: ParameterMemory,
        scales: FloatArray,
        rates: FloatArray,
        gains: FloatArray,
        won: BoolArray,
    ) -> ParameterMemory:
        """Return the memory after a generation; scales, rates, gains and `won` are (n,)."""
        if not won.any():
            return memory
        scale, rate = success_means(scales, rates, gains, won)
        return self.renewed(memory, scale, TERMINAL if rates[won].max() <= 0.0 else rate)

    def renewed(self, memory: ParameterMemory, scale: float, rate: float) -> ParameterMemory:
        """Return the memory with the means of what won; a rate that has come down to zero stays there."""
        return memory.renewed(scale, TERMINAL if memory.rates[memory.slot] < 0.0 else rate)

    def limit(self, scales: FloatArray, rates: FloatArray, progress: float) -> tuple[FloatArray, FloatArray]:
        """Return scales and rates, (n,) each, bounded at a progress in [0, 1]: as they are."""
        return scales, rates

    def mutation(self, archive: FloatArray, progress: float) -> CurrentToPBest:
        """Return the mutation at a progress."""
        return CurrentToPBest(archive)

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> ShadeState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger, generator, X, F = first_population(problem, seed, starts, self.members(problem.dimension))
        fields = {"archive": np.empty((0, problem.dimension)), "memory": self.memory(), "first": len(X)}
        return begun(ShadeState, self.name, ledger, generator, X=X, F=F, **fields)

    def step(self, state: ShadeState, problem: Problem) -> tuple[ShadeState, Event]:
        """Do one generation; a trial as good as its parent replaces it but teaches nothing."""
        ledger = Ledger.at(problem, state.evaluations)
        plan = self.budget if self.budget is not None else 10_000.0 * problem.dimension
        progress = min(state.evaluations.trajectories / plan, 1.0)
        generator = state.stream.generator()
        scales, rates = self.limit(*state.memory.sample(len(state.X), generator), progress)
        mutants = self.mutation(state.archive, progress)(state.X, state.F, scales[:, None], generator)
        trials = binomial(state.X, midpoint(mutants, state.X), rates[:, None], generator)
        costs = ledger.costs(trials, ledger.full)
        won, replaced = costs < state.F, costs <= state.F
        with np.errstate(invalid="ignore"):
            gains = state.F - costs
        archive = update_archive(state.archive, state.X[won], round(self.archived * len(state.X)), generator)
        X, F = np.where(replaced[:, None], trials, state.X), np.where(replaced, costs, state.F)
        size = max(FEWEST, linear_size(state.first, FEWEST, ledger.spent / plan))
        if size < len(X):
            X, F = keep_best(X, F, size)
            archive = update_archive(archive, X[:0], round(self.archived * size), generator)
        memory = self.learn(state.memory, scales, rates, gains, won)
        event = Event("evolution", float(F.min()), ledger.full)
        return advanced(state, ledger, generator, X=X, F=F, archive=archive, memory=memory), event


def linear_size(first: int, last: int, progress: float) -> int:
    """Return the size on the straight line from `first` to `last` as progress goes from 0 to 1."""
    return round(first + (last - first) * min(max(progress, 0.0), 1.0))


def keep_best(X: FloatArray, F: FloatArray, number: int) -> tuple[FloatArray, FloatArray]:
    """Return the `number` cheapest members, (number, D), and their costs; the order stays as it was."""
    kept = np.sort(np.argsort(F, kind="stable")[:number])
    return X[kept], F[kept]


class JSO(LShade):
    """jSO (Brest, Maucec and Boskovic 2017).

    Beside its numbers three rules differ from L-SHADE: a weighted step towards the elite, bounds on early scales and rates,
    and an elite other than the parent at first.
    """

    name, archived = "jso", 1.0

    def members(self, dimension: int) -> int:
        """Return 25 ln(D) sqrt(D)."""
        return max(FEWEST, round(25.0 * log(dimension) * sqrt(dimension)))

    def memory(self) -> ParameterMemory:
        """Return four entries of scale 0.3 and rate 0.8, and the fixed one."""
        return ParameterMemory(np.array([0.3] * 4 + [FIXED]), np.array([0.8] * 4 + [FIXED]), 0)

    def renewed(self, memory: ParameterMemory, scale: float, rate: float) -> ParameterMemory:
        """Return the memory halfway from the old entry to the means; the turn of the last entry comes, but it stays at 0.9."""
        slot = memory.slot
        if slot == len(memory.scales) - 1:
            return memory.renewed(FIXED, FIXED)
        old_scale, old_rate = float(memory.scales[slot]), float(memory.rates[slot])
        return memory.renewed(0.5 * (scale + old_scale), 0.5 * (rate + old_rate))

    def limit(self, scales: FloatArray, rates: FloatArray, progress: float) -> tuple[FloatArray, FloatArray]:
        """Return scales and rates, (n,) each, that are kept from extremes early in the search."""
        if progress < 0.6:
            scales = np.minimum(scales, 0.7)
        least = 0.7 if progress < 0.25 else 0.6 if progress < 0.5 else 0.0
        return scales, np.maximum(rates, least)

    def mutation(self, archive: FloatArray, progress: float) -> CurrentToPBest:
        """Return the mutation: the elite shrinks from a quarter of the members to half of that."""
        pull = 0.7 if progress < 0.2 else 0.8 if progress < 0.4 else 1.2
        choose = elite_but_self if progress < 0.5 else elite
        return CurrentToPBest(archive, 0.25 * (1.0 - 0.5 * progress), pull, choose)


@dataclass(frozen=True, kw_only=True)
class OrderedShadeState(State):
    """State of ordered SHADE: its population, the ends of the local searches, (m, D), and the size of the next population."""

    population: Population
    optima: FloatArray
    population_size: int


@dataclass(frozen=True)
class OrderedShade:
    """Ordered SHADE: the population of the default on its own, without scouts and shortened records.

    A step is a generation, a local search from the best member not searched from, or a new population in place of one that
    has collapsed or stagnates. A local search is Levenberg-Marquardt where the problem has residuals, else L-BFGS-B on
    differences of the cost. It restarts, plans over no budget and never claims convergence.
    """

    name: str = "ordered-shade"  #: registered name
    members: int = MEMBERS  #: of the first population
    strategy: Strategy = STRATEGY  #: numbers of the population
    #: local search where only the cost is known
    quasi_newton: QuasiNewton = field(default_factory=QuasiNewton)

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> OrderedShadeState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger, generator, X, F = first_population(problem, seed, starts, self.members, latin_hypercube)
        fields = {"population": Population.first(X, F), "population_size": self.strategy.grown(self.members)}
        optima = np.empty((0, problem.dimension))
        return begun(OrderedShadeState, self.name, ledger, generator, optima=optima, **fields)

    def step(self, state: OrderedShadeState, problem: Problem) -> tuple[OrderedShadeState, Event]:
        """Do what is next: a new population, a local search or a generation."""
        ledger, population = Ledger.at(problem, state.evaluations), state.population
        generator, text = state.stream.generator(), ""
        if population.exhausted:
            # a larger population, independent of all earlier results
            X = latin_hypercube(state.population_size, ledger.dimension, generator)
            population = Population.first(X, ledger.costs(X, ledger.full))
            text = f"new population of {len(X)}"
            size = self.strategy.grown(state.population_size)
            state = replace(state, optima=state.optima[:0], population_size=size)
        else:
            if population.age >= population.due:
                member, population = population.next_start(state.optima, self.strategy.separation)
                if member is not None:
                    search = (
                        LevenbergMarquardt()
                        if not isinstance(ledger.problem, ScalarProblem)
                        else self.quasi_newton
                    )
                    start, best = float(population.F[member]), float(population.F.min())
                    incumbent = best if start > best else np.inf
                    x, cost = search(ledger, population.X[member].copy(), start, incumbent)
                    population = population.with_refined(member, x, cost, cost < best * (1.0 - 1e-12))
                    optima = np.concatenate([state.optima, x[None, :]])
                    after = advanced(state, ledger, population=population, optima=optima)
                    return after, Event("refinement", cost, ledger.full)
            trials = population.ask(generator, self.strategy.elite)
            population = population.tell(trials, ledger.costs(trials.X, ledger.full), generator)
        event = Event("evolution", float(population.F.min()), ledger.full, text)
        return advanced(state, ledger, generator, population=population), event
