"""Genetic algorithm: binary tournament, simulated binary crossover, polynomial mutation, elitist survival.

The algorithm of pymoo's ``GA``, with its constants: a test holds the two to the same members, bit for bit. It is
composed of pieces on arrays here, because a generation of pymoo's loop over individuals costs more than the
simulation of its members. ``pymoo-ga`` runs the original.

References
----------
Blank and Deb (2020), pymoo: multi-objective optimization in Python, IEEE Access 8, 89497-89509; for the
operators see `pieces.genetic`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Evaluations, Ledger
from stoop.optimize.operators import MEMBERS
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream
from stoop_studies.optimizers.pieces.evolution import PopulationState
from stoop_studies.optimizers.pieces.genetic import Polynomial, SimulatedBinary, repeated, tournament
from stoop_studies.optimizers.pieces.operators import placed, uniform

MATINGS: Final = 100  #: tries to fill a generation with children that are new


@dataclass(frozen=True)
class GeneticAlgorithm:
    """The genetic algorithm; it never claims convergence.

    Attributes
    ----------
    name : registered name
    members : of the population
    crossover : from couples to children
    mutation : of children
    """

    name: str = "ga"
    members: int = MEMBERS
    crossover: SimulatedBinary = field(default_factory=SimulatedBinary)
    mutation: Polynomial = field(default_factory=Polynomial)

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> PopulationState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger = Ledger.at(problem, Evaluations.none(problem))
        generator = RandomStream.from_seed(seed).generator()
        X = placed(uniform(self.members, problem.dimension, generator), starts)
        F = ledger.costs(X, ledger.full)
        stream, books = RandomStream.of(generator), ledger.evaluations
        return PopulationState(optimizer=self.name, generation=0, stream=stream, evaluations=books, X=X, F=F)

    def step(self, state: PopulationState, problem: Problem) -> tuple[PopulationState, Event]:
        """Do one generation: as many children as members, and the best of both live on."""
        ledger = Ledger.at(problem, state.evaluations)
        generator = state.stream.generator()
        children = self.brood(state.X, state.F, generator)
        costs = ledger.costs(children, ledger.full) if len(children) else np.empty(0)
        X, F = np.concatenate([state.X, children]), np.append(state.F, costs)
        best = np.argsort(F, kind="stable")[: len(state.X)]
        after = replace(
            state,
            X=X[best],
            F=F[best],
            generation=state.generation + 1,
            stream=RandomStream.of(generator),
            evaluations=ledger.evaluations,
        )
        return after, Event("evolution", float(F[best[0]]), ledger.full)

    def brood(self, X: FloatArray, F: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Return as many children as members, none of them the same as another or as a member."""
        children = np.empty((0, X.shape[1]))
        for _ in range(MATINGS):
            missing = len(X) - len(children)
            if not missing:
                break
            new = self._mate(X, F, -(-missing // 2), generator)
            new = new[~repeated(new, X, children)]
            children = np.concatenate([children, new[:missing]])
        return children

    def _mate(self, X: FloatArray, F: FloatArray, couples: int, generator: np.random.Generator) -> FloatArray:
        """Return two children, (2 couples, D), of each couple that the tournaments bring together."""
        parents = X[tournament(F, 2 * couples, generator)].reshape(couples, 2, -1).swapaxes(0, 1)
        children = self.crossover(parents, generator).reshape(2 * couples, -1)
        return self.mutation(children, generator)
