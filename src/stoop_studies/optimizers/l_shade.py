"""L-SHADE and jSO: success-history differential evolution whose population shrinks linearly over the planned budget.

jSO differs from L-SHADE in its numbers and in three rules only: a weighted step towards the elite, bounds on early
scales and rates, and an elite other than the parent at first.

References
----------
Tanabe and Fukunaga (2014), Improving the search performance of SHADE using linear population size reduction,
IEEE CEC, 1658-1665; the constants are those of the paper's section IV.
Brest, Maucec and Boskovic (2017), Single objective real-parameter optimization: algorithm jSO, IEEE CEC,
1311-1318.
Brest, Maucec and Boskovic (2016), iL-SHADE: improved L-SHADE algorithm for single objective real-parameter
optimization, IEEE CEC, 1188-1195 (the entry fixed at 0.9, and an elite other than the parent at first).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import log, sqrt
from typing import Final

import numpy as np
from numpy.random import Generator

from stoop.base.arrays import BoolArray, FloatArray
from stoop.optimize.adaptation import ParameterMemory
from stoop.optimize.ledger import Ledger
from stoop.optimize.operators import binomial, elite, midpoint, update_archive
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State
from stoop_studies.optimizers.pieces.evolution import first_population
from stoop_studies.optimizers.pieces.operators import (
    FIXED,
    Choice,
    CurrentToPBest,
    elite_but_self,
    learn_halfway,
    learn_terminal,
)

FEWEST: Final = 4  #: members at the end; the mutation needs as many
PER_VARIABLE: Final = 18  #: members of L-SHADE's first population
PLAN: Final = 10_000  #: evaluations per variable when no budget is given, as in the competitions
JSO_ENTRIES: Final = 5  #: of jSO's memory
JSO_ELITE: Final = 0.25  #: share of elite at the start of jSO; half of it at the end


@dataclass(frozen=True, kw_only=True)
class ShadeState(State):
    """State of a shrinking population.

    Attributes
    ----------
    X, F : (n, D) and (n,), members and their costs
    archive : (a, D), parents that lost
    memory : scales and rates that worked
    first : members of the first population
    """

    X: FloatArray
    F: FloatArray
    archive: FloatArray
    memory: ParameterMemory
    first: int


Learn = Callable[[ParameterMemory, FloatArray, FloatArray, FloatArray, BoolArray], ParameterMemory]
Limit = Callable[[FloatArray, FloatArray, float], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class LinearShade:
    """Success-history adaptation, current-to-pbest with archive, and linear population size reduction.

    It plans over its budget, in trajectories: where the run is given another one, it is not at its best.
    After the planned budget its last four members go on. It never claims convergence.

    Attributes
    ----------
    name : registered name
    budget : trajectories planned; None for 10,000 per variable
    members : first population, from the number of variables
    memory : at the start
    learn : renews the memory
    limit : bounds scales and rates, (n,) each, at a progress in [0, 1]
    share : of the members that count as elite, at a progress
    pull : weight of the step towards the elite, at a progress
    choose : member of the elite, at a progress
    archive : its size in members
    """

    name: str
    budget: float | None
    members: Callable[[int], int]
    memory: ParameterMemory
    learn: Learn
    limit: Limit
    share: Callable[[float], float]
    pull: Callable[[float], float]
    choose: Callable[[float], Choice]
    archive: float

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> ShadeState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger, generator, X, F = first_population(problem, seed, starts, self.members(problem.dimension))
        return ShadeState(
            optimizer=self.name,
            generation=0,
            stream=RandomStream.of(generator),
            evaluations=ledger.evaluations,
            X=X,
            F=F,
            archive=np.empty((0, problem.dimension)),
            memory=self.memory,
            first=len(X),
        )

    def step(self, state: ShadeState, problem: Problem) -> tuple[ShadeState, Event]:
        """Do one generation; a trial as good as its parent replaces it but teaches nothing."""
        ledger = Ledger.at(problem, state.evaluations)
        plan = self.budget if self.budget is not None else float(PLAN * problem.dimension)
        progress = min(state.evaluations.trajectories / plan, 1.0)
        generator = state.stream.generator()
        scales, rates = self.limit(*state.memory.sample(len(state.X), generator), progress)
        trials = self._trials(state, scales, rates, progress, generator)
        costs = ledger.costs(trials, ledger.full)
        won, replaced = costs < state.F, costs <= state.F
        with np.errstate(invalid="ignore"):
            gains = state.F - costs
        archive = update_archive(state.archive, state.X[won], round(self.archive * len(state.X)), generator)
        X, F = np.where(replaced[:, None], trials, state.X), np.where(replaced, costs, state.F)
        size = max(FEWEST, linear_size(state.first, FEWEST, ledger.spent / plan))
        if size < len(X):
            X, F = keep_best(X, F, size)
            archive = update_archive(archive, X[:0], round(self.archive * size), generator)
        after = replace(
            state,
            X=X,
            F=F,
            archive=archive,
            memory=self.learn(state.memory, scales, rates, gains, won),
            generation=state.generation + 1,
            stream=RandomStream.of(generator),
            evaluations=ledger.evaluations,
        )
        return after, Event("evolution", float(F.min()), ledger.full)

    def _trials(
        self, state: ShadeState, scales: FloatArray, rates: FloatArray, progress: float, generator: Generator
    ) -> FloatArray:
        """Return one trial per member, (n, D), with scales and rates, (n,) each."""
        share, pull, choose = self.share(progress), self.pull(progress), self.choose(progress)
        mutation = CurrentToPBest(state.archive, share, pull, choose)
        mutants = mutation(state.X, state.F, scales[:, None], generator)
        return binomial(state.X, midpoint(mutants, state.X), rates[:, None], generator)


def linear_size(first: int, last: int, progress: float) -> int:
    """Return the size on the straight line from `first` to `last` as progress goes from 0 to 1."""
    return round(first + (last - first) * min(max(progress, 0.0), 1.0))


def keep_best(X: FloatArray, F: FloatArray, number: int) -> tuple[FloatArray, FloatArray]:
    """Return the `number` cheapest members, (number, D), and their costs; the order stays as it was."""
    kept = np.sort(np.argsort(F, kind="stable")[:number])
    return X[kept], F[kept]


def l_shade(budget: float | None = None) -> LinearShade:
    """Return L-SHADE, planned over a budget in trajectories (None: 10,000 per variable)."""
    return LinearShade(
        name="l-shade",
        budget=budget,
        members=lambda dimension: PER_VARIABLE * dimension,
        memory=ParameterMemory.fresh(6, scale=0.5, rate=0.5),
        learn=learn_terminal,
        limit=lambda scales, rates, progress: (scales, rates),
        share=lambda progress: 0.11,
        pull=lambda progress: 1.0,
        choose=lambda progress: elite,
        archive=2.6,
    )


def jso(budget: float | None = None) -> LinearShade:
    """Return jSO, planned over a budget in trajectories (None: 10,000 per variable)."""
    scales, rates = np.full(JSO_ENTRIES, 0.3), np.full(JSO_ENTRIES, 0.8)
    scales[-1] = rates[-1] = FIXED
    return LinearShade(
        name="jso",
        budget=budget,
        members=lambda dimension: max(FEWEST, round(25.0 * log(dimension) * sqrt(dimension))),
        memory=ParameterMemory(scales, rates, 0),
        learn=learn_halfway,
        limit=jso_limit,
        share=lambda progress: JSO_ELITE * (1.0 - 0.5 * progress),
        pull=lambda progress: 0.7 if progress < 0.2 else 0.8 if progress < 0.4 else 1.2,
        choose=lambda progress: elite_but_self if progress < 0.5 else elite,
        archive=1.0,
    )


def jso_limit(scales: FloatArray, rates: FloatArray, progress: float) -> tuple[FloatArray, FloatArray]:
    """Return scales and rates, (n,) each, that are kept from extremes early in the search."""
    if progress < 0.6:
        scales = np.minimum(scales, 0.7)
    least = 0.7 if progress < 0.25 else 0.6 if progress < 0.5 else 0.0
    return scales, np.maximum(rates, least)
