"""Ordered SHADE: success-history differential evolution with the paper's ordered difference.

Ask for trials, tell their costs; the population also names the member from which the next local refinement starts.

References
----------
Tanabe and Fukunaga (2013), IEEE CEC (SHADE); Zhang and Sanderson (2009), IEEE TEC 13, 945-958 (JADE: archive
and current-to-pbest); the paper's eq. (12) for the order in the difference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.optimize.adaptation import ParameterMemory
from stoop.optimize.operators import OrderedToPBest, binomial, greedy, midpoint, update_archive

ELITE: Final = 0.11  #: share of the population that counts as best
PERIOD: Final = 10  #: generations between local refinements
SEPARATION: Final = 0.02  #: of the unit box: no refinement starts nearer to the end of an earlier one
COLLAPSED: Final = 1e-9  #: spread in the unit box
GROWTH: Final = 1.5  #: of the population at each restart
LARGEST: Final = 500  #: population
FLAT: Final = 1e-13  #: relative spread of costs


@dataclass(frozen=True)
class Trials:
    """Trial vectors, with the scales and rates that they were made with."""

    X: FloatArray
    scales: FloatArray
    rates: FloatArray


@dataclass(frozen=True)
class Population:
    """A population and what it has learnt.

    Attributes
    ----------
    X, F : (n, D) and (n,), members and their costs with the nuisances at zero
    refined : (n,), members from which (or near whose end) a local refinement started
    archive : (a, D), parents that lost, at most n
    memory : scales and rates that worked
    age : generations
    due : age at which the next local refinement starts
    period : generations between local refinements at present
    idle : generations without a better best
    """

    X: FloatArray
    F: FloatArray
    refined: BoolArray
    archive: FloatArray
    memory: ParameterMemory
    age: int = 0
    due: int = 0
    period: int = PERIOD
    idle: int = 0

    @classmethod
    def first(cls, X: FloatArray, F: FloatArray) -> Population:
        """Return a population of members (n, D) with costs (n,) that has not moved yet."""
        nothing = np.zeros(len(X), dtype=np.bool_)
        return cls(X, F, nothing, np.empty((0, X.shape[1])), ParameterMemory.fresh())

    def ask(self, generator: np.random.Generator, elite: float = ELITE) -> Trials:
        """Return one trial per member; a share of `elite` of the population counts as best."""
        scales, rates = self.memory.sample(len(self.X), generator)
        mutants = OrderedToPBest(self.archive, elite)(self.X, self.F, scales[:, None], generator)
        X = binomial(self.X, midpoint(mutants, self.X), rates[:, None], generator)
        return Trials(X, scales, rates)

    def tell(self, trials: Trials, costs: FloatArray, generator: np.random.Generator) -> Population:
        """Return the population after selection."""
        X, F, won = greedy(self.X, self.F, trials.X, costs)
        with np.errstate(invalid="ignore"):
            gains = self.F - costs
        old, new = float(self.F.min()), float(F.min())
        improved = new < old - 1e-9 * abs(old) if np.isfinite(old) else new < old
        return replace(
            self,
            X=X,
            F=F,
            refined=self.refined & ~won,
            archive=update_archive(self.archive, self.X[won], len(X), generator),
            memory=self.memory.learn(trials.scales, trials.rates, gains, won),
            age=self.age + 1,
            idle=0 if improved else self.idle + 1,
        )

    def next_start(self, optima: FloatArray, separation: float = SEPARATION) -> tuple[int | None, Population]:
        """Return the best member not refined yet, or None if it lies beside an earlier refinement's end, (m, D)."""
        open_costs = np.where(self.refined, np.inf, self.F)
        i = int(open_costs.argmin())
        marked = self.refined.copy()
        marked[i] = True
        near = len(optima) > 0 and np.abs(optima - self.X[i]).max(axis=1).min() <= separation
        population = replace(self, refined=marked, due=self.age + self.period)
        return (None if near or not np.isfinite(open_costs[i]) else i), population

    def with_refined(self, member: int, x: FloatArray, cost: float, improved: bool) -> Population:
        """Put a refinement's end in the member's place if it is better, and schedule the next refinement.

        Refinement pays as long as it improves on the best; where it does not, evolution goes on for longer.
        """
        X, F = self.X.copy(), self.F.copy()
        if cost < F[member]:
            X[member], F[member] = x, cost
        period = max(PERIOD // 2, 1) if improved else min(2 * self.period, 20 * PERIOD)
        return replace(self, X=X, F=F, period=period, due=self.age + period)

    @property
    def exhausted(self) -> bool:
        """Whether it has collapsed or stopped improving, so that a new population should start."""
        best, worst = float(self.F.min()), float(self.F.max())
        tight = float((self.X.max(axis=0) - self.X.min(axis=0)).max()) < COLLAPSED
        flat = np.isfinite(worst) and worst - best <= FLAT * abs(best)
        return bool(tight or flat or self.idle > 100 + 20 * self.X.shape[1])


def grown(size: int, growth: float = GROWTH, largest: int = LARGEST) -> int:
    """Return how many members the next population has."""
    return min(int(size * growth), largest)
