"""Genetic algorithm: binary tournament, simulated binary crossover, polynomial mutation, elitist survival.

The algorithm of pymoo's ``GA``, with its constants and random numbers drawn in its order: a test holds the two to
the same members, bit for bit. It works on arrays, because a generation of pymoo's loop over individuals costs more
than the simulation of its members. ``pymoo-ga`` runs the original.

References
----------
Blank and Deb (2020), pymoo: multi-objective optimization in Python, IEEE Access 8, 89497-89509.
Deb and Agrawal (1995), Simulated binary crossover for continuous search space, Complex Systems 9, 115-148.
Deb and Goyal (1996), A combined genetic adaptive search (GeneAS) for engineering design, Computer Science and
Informatics 26, 30-45 (polynomial mutation).
Deb, Sindhya and Okabe (2007), Self-adaptive simulated binary crossover for real-parameter optimization, GECCO,
1187-1194 (the distribution cut off at bounds).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.random import Generator

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.population import MEMBERS
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event
from stoop_studies.optimizers.evolution import PopulationState, advanced, begun, clip, first_population

CROSSED_OVER: Final = 0.9  #: share of couples that cross over, and of children that may mutate


@dataclass(frozen=True)
class SimulatedBinary:
    """Simulated binary crossover: children lie about their parents as those of one-point crossover of bits do."""

    eta: float = 15.0  #: distribution index; the larger, the nearer to the parents
    mated: float = CROSSED_OVER  #: share of couples that cross over
    crossed: float = 0.5  #: share of a couple's variables that do
    swapped: float = 0.5  #: share of these that change places between the children

    def __call__(self, parents: FloatArray, generator: Generator) -> FloatArray:
        """Return two children, (2, n, D), of each of n couples, (2, n, D)."""
        mate: BoolArray = generator.random((parents.shape[1],)) < self.mated
        if not mate.any():
            return parents
        generator.random(len(mate))  # pymoo draws here whether a couple's children may change places: all may
        cross = generator.random(parents.shape[1:]) < self.crossed
        cross &= np.abs(parents[0] - parents[1]) > 1e-14  # nearer ones hand it on as it is
        u = generator.random(int(cross.sum()))
        low, high = parents[:, cross].min(axis=0), parents[:, cross].max(axis=0)
        gap, both = high - low, low + high
        below = clip(0.5 * (both - self._spread(u, 1.0 + 2.0 * low / gap) * gap))
        above = clip(0.5 * (both + self._spread(u, 1.0 + 2.0 * (1.0 - high) / gap) * gap))
        swap = generator.random(len(below)) < self.swapped
        children = parents.copy()
        children[0, cross] = np.where(swap, above, below)
        children[1, cross] = np.where(swap, below, above)
        children[:, ~mate] = parents[:, ~mate]
        return children

    def _spread(self, u: FloatArray, room: FloatArray) -> FloatArray:
        """Return the children's distance over the parents', where `room` is the largest that fits the box."""
        share = u * (2.0 - np.power(room, -(self.eta + 1.0)))
        inner = share <= 1.0
        spread: FloatArray = np.power(np.where(inner, share, 1.0 / (2.0 - share)), 1.0 / (self.eta + 1.0))
        return spread


@dataclass(frozen=True)
class Polynomial:
    """Polynomial mutation: a small step, cut off at the bounds, of one variable in D on average."""

    eta: float = 20.0  #: distribution index; the larger, the smaller the step
    mutated: float = CROSSED_OVER  #: share of children that may mutate

    def __call__(self, children: FloatArray, generator: Generator) -> FloatArray:
        """Return the children, (n, D), after mutation."""
        number, dimension = children.shape
        chosen = generator.random(children.shape) < min(0.5, 1.0 / dimension)
        mutants = children.copy()
        x = children[chosen]
        mutants[chosen] = clip(x + self._step(x, generator.random(len(x))))
        spared = generator.random(number) > self.mutated
        mutants[spared] = children[spared]
        return mutants

    def _step(self, x: FloatArray, u: FloatArray) -> FloatArray:
        """Return the steps of values x, (k,), by uniform numbers u, (k,): down below one half."""
        down = u <= 0.5
        far = np.power(1.0 - np.where(down, x, 1.0 - x), self.eta + 1.0)
        base = np.where(down, 2.0 * u + (1.0 - 2.0 * u) * far, 2.0 * (1.0 - u) + 2.0 * (u - 0.5) * far)
        reach = np.power(base, 1.0 / (self.eta + 1.0))
        step: FloatArray = np.where(down, reach - 1.0, 1.0 - reach)
        return step


@dataclass(frozen=True)
class GeneticAlgorithm:
    """The genetic algorithm; it never claims convergence."""

    name: str = "ga"
    members: int = MEMBERS
    crossover: SimulatedBinary = field(default_factory=SimulatedBinary)
    mutation: Polynomial = field(default_factory=Polynomial)

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> PopulationState:
        """Evaluate the first population; the user's own values take the first places."""
        ledger, generator, X, F = first_population(problem, seed, starts, self.members)
        return begun(PopulationState, self.name, ledger, generator, X=X, F=F)

    def step(self, state: PopulationState, problem: Problem) -> tuple[PopulationState, Event]:
        """Do one generation: as many children as members, and the best of both live on."""
        ledger = Ledger.at(problem, state.evaluations)
        generator = state.stream.generator()
        children = self.children(state.X, state.F, generator)
        costs = ledger.costs(children, ledger.full) if len(children) else np.empty(0)
        X, F = np.concatenate([state.X, children]), np.append(state.F, costs)
        best = np.argsort(F, kind="stable")[: len(state.X)]
        after = advanced(state, ledger, generator, X=X[best], F=F[best])
        return after, Event("evolution", float(F[best[0]]), ledger.full)

    def children(self, X: FloatArray, F: FloatArray, generator: Generator) -> FloatArray:
        """Return as many children as members, none of them the same as another or as a member."""
        children = np.empty((0, X.shape[1]))
        for _ in range(100):  # tries to fill the generation with children that are new
            missing = len(X) - len(children)
            if not missing:
                break
            couples = -(-missing // 2)
            parents = X[tournament(F, 2 * couples, generator)].reshape(couples, 2, -1).swapaxes(0, 1)
            new = self.mutation(self.crossover(parents, generator).reshape(2 * couples, -1), generator)
            new = new[~repeated(new, X, children)]
            children = np.concatenate([children, new[:missing]])
        return children


def tournament(F: FloatArray, number: int, generator: Generator) -> IntArray:
    """Return the winners, (number,), of pairs from random permutations; equal costs are drawn by lot."""
    rounds = -(-2 * number // len(F))
    order = np.concatenate([generator.permutation(len(F)) for _ in range(rounds)])
    pairs = order[: 2 * number].reshape(number, 2)
    first, second = F[pairs].T
    winners: IntArray = np.where(first < second, pairs[:, 0], pairs[:, 1])
    for i in np.flatnonzero(first == second):
        winners[i] = generator.choice(pairs[i])
    return winners


def repeated(new: FloatArray, *others: FloatArray) -> BoolArray:
    """Return which of the new, (n,), are the same as an earlier one of them, or as one of the others."""
    from scipy.spatial.distance import cdist

    least = 1e-16**2  # squared distance at which two members are one
    known = np.asarray(np.tril(cdist(new, new, "sqeuclidean") <= least, -1).any(axis=1))
    for other in others:
        if len(other):
            known |= (cdist(new, other, "sqeuclidean") <= least).any(axis=1)
    return known
