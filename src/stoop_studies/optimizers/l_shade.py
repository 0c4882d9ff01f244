"""L-SHADE: success-history differential evolution whose population shrinks linearly over the planned budget.

`LinearShade` also carries jSO (`methods.jso`), which differs in its numbers and in three rules only.

References
----------
Tanabe and Fukunaga (2014), Improving the search performance of SHADE using linear population size reduction,
IEEE CEC, 1658-1665; the constants are those of the paper's section IV.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.optimize.adaptation import ParameterMemory
from stoop.optimize.ledger import Evaluations, Ledger
from stoop.optimize.operators import binomial, elite, midpoint, update_archive
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State
from stoop_studies.optimizers.pieces.operators import Choice, CurrentToPBest, learn_terminal, placed, uniform
from stoop_studies.optimizers.pieces.structure import keep_best, linear_size

FEWEST: Final = 4  #: members at the end; the mutation needs as many
PER_VARIABLE: Final = 18  #: members of L-SHADE's first population
PLAN: Final = 10_000  #: evaluations per variable when no budget is given, as in the competitions


@dataclass(frozen=True, kw_only=True)
class ShadeState(State):
    """Where a run stands.

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
    memory : before anything is learnt
    learn : how the memory is renewed
    limit : what becomes of scales and rates, (n,) each, at a progress in [0, 1]
    share : of the members that count as elite, at a progress
    pull : weight of the step towards the elite, at a progress
    choose : who of the elite, at a progress
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
        ledger = Ledger.at(problem, Evaluations.none(problem))
        generator = RandomStream.from_seed(seed).generator()
        X = placed(uniform(self.members(problem.dimension), problem.dimension, generator), starts)
        F = ledger.costs(X, ledger.full)
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
        """Do one generation."""
        ledger = Ledger.at(problem, state.evaluations)
        plan = self.budget if self.budget is not None else float(PLAN * problem.dimension)
        progress = min(state.evaluations.trajectories / plan, 1.0)
        generator = state.stream.generator()
        trials, scales, rates = self.ask(state, progress, generator)
        state = self.tell(state, trials, ledger.costs(trials, ledger.full), scales, rates, generator)
        size = max(FEWEST, linear_size(state.first, FEWEST, ledger.spent / plan))
        state = replace(self.shrunk(state, size, generator), stream=RandomStream.of(generator))
        return replace(state, evaluations=ledger.evaluations), Event(
            "evolution", float(state.F.min()), ledger.full
        )

    def ask(
        self, state: ShadeState, progress: float, generator: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return one trial per member, (n, D), and the scales and rates that made them, (n,) each."""
        scales, rates = state.memory.sample(len(state.X), generator)
        scales, rates = self.limit(scales, rates, progress)
        mutation = CurrentToPBest(
            state.archive, self.share(progress), self.pull(progress), self.choose(progress)
        )
        mutants = mutation(state.X, state.F, scales[:, None], generator)
        trials = binomial(state.X, midpoint(mutants, state.X), rates[:, None], generator)
        return trials, scales, rates

    def tell(
        self,
        state: ShadeState,
        trials: FloatArray,
        costs: FloatArray,
        scales: FloatArray,
        rates: FloatArray,
        generator: np.random.Generator,
    ) -> ShadeState:
        """Return the state after selection; a trial as good as its parent replaces it but teaches nothing."""
        won, moved = costs < state.F, costs <= state.F
        with np.errstate(invalid="ignore"):
            gains = state.F - costs
        most = round(self.archive * len(state.X))
        return replace(
            state,
            X=np.where(moved[:, None], trials, state.X),
            F=np.where(moved, costs, state.F),
            archive=update_archive(state.archive, state.X[won], most, generator),
            memory=self.learn(state.memory, scales, rates, gains, won),
            generation=state.generation + 1,
        )

    def shrunk(self, state: ShadeState, size: int, generator: np.random.Generator) -> ShadeState:
        """Return the state with the worst members gone, and as much of the archive as that asks for."""
        if size >= len(state.X):
            return state
        X, F = keep_best(state.X, state.F, size)
        archive = update_archive(state.archive, X[:0], round(self.archive * size), generator)
        return replace(state, X=X, F=F, archive=archive)


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
