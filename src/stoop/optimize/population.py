"""Ordered SHADE: success-history differential evolution with the paper's ordered difference, and its operators.

References
----------
Tanabe and Fukunaga (2013), Success-history based parameter adaptation for differential evolution, IEEE CEC, 71-78 (SHADE).
Tanabe and Fukunaga (2014), IEEE CEC, 1658-1665 (L-SHADE: the terminal rate, and the Lehmer mean of the rates).
Zhang and Sanderson (2009), JADE: adaptive differential evolution with optional external archive, IEEE TEC 13, 945-958
(current-to-pbest, the archive, the midpoint rule at the bounds).
The paper's eqs. (7) (crossover), (8) (selection) and (12) (the order in the difference).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.random import Generator

from stoop.base.arrays import BoolArray, Factor, FloatArray, IntArray

MEMBERS: Final = 50  #: of a population, for every method that has one
PERIOD: Final = 10  #: generations between local refinements


@dataclass(frozen=True)
class Strategy:
    """Numbers of a population of ordered SHADE."""

    elite: float = 0.11  #: share of the population that counts as best
    separation: float = 0.02  #: of the unit box: no refinement starts nearer to the end of an earlier one
    growth: float = 1.5  #: of the population at each restart
    largest: int = 500  #: population

    def grown(self, size: int) -> int:
        """Return how many members the next population has."""
        return min(int(size * self.growth), self.largest)


DEFAULT: Final = Strategy()


def latin_hypercube(number: int, dimension: int, generator: Generator) -> FloatArray:
    """Return points, (number, dimension), of which each variable falls once in each of `number` equal slices."""
    slices = np.argsort(generator.random((number, dimension)), axis=0)
    points: FloatArray = (slices + generator.random((number, dimension))) / number
    return points


def midpoint(mutants: FloatArray, parents: FloatArray) -> FloatArray:
    """Return mutants, (n, D), set halfway between the parent and the bound of the unit box that they crossed (JADE)."""
    inside: FloatArray = np.where(mutants < 0.0, 0.5 * parents, mutants)
    return np.where(inside > 1.0, 0.5 * (parents + 1.0), inside)


def binomial(parents: FloatArray, mutants: FloatArray, rate: Factor, generator: Generator) -> FloatArray:
    """Take each variable of parents, (n, D), from the mutant with probability `rate`, one always (the paper's eq. 7)."""
    number, dimension = parents.shape
    # a draw below any rate at one place per parent is "one always", and saves a second mask
    draws = generator.random((number, dimension))
    always = (generator.random(number) * dimension).astype(np.intp)
    draws[np.arange(number), always] = -1.0
    trials: FloatArray = np.where(draws <= rate, mutants, parents)
    return trials


def greedy(
    parents: FloatArray, costs: FloatArray, trials: FloatArray, trial_costs: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return survivors, (n, D), and costs, (n,): a trial replaces its parent where it costs less (the paper's eq. 8), (n,)."""
    won = trial_costs < costs
    return np.where(won[:, None], trials, parents), np.where(won, trial_costs, costs), won


def update_archive(archive: FloatArray, losers: FloatArray, most: int, generator: Generator) -> FloatArray:
    """Return the archive, (a, D), with the losers, (k, D), added; beyond `most`, members are removed at random.

    The generator advances only where something is removed.
    """
    kept = np.concatenate([archive, losers])
    return kept[generator.permutation(len(kept))[:most]] if len(kept) > most else kept


def elite(F: FloatArray, share: float, generator: Generator) -> IntArray:
    """Return for each member of costs F, (n,), one of the best `share` of all, two at least."""
    ranks = (generator.random(len(F)) * max(2, round(share * len(F)))).astype(np.intp)
    chosen: IntArray = np.argsort(F, kind="stable")[ranks]
    return chosen


def two_others(members: int, pool: int, generator: Generator) -> tuple[IntArray, IntArray]:
    """Draw for each member another member, and one of the pool (members first, then archive) that is neither; (n,) each."""
    own = np.arange(members)
    a = (generator.random(members) * (members - 1)).astype(np.intp)
    a += a >= own
    b = (generator.random(members) * (pool - 2)).astype(np.intp)
    low, high = np.minimum(own, a), np.maximum(own, a)
    b += b >= low
    b += b >= high
    return a, b


@dataclass(frozen=True)
class OrderedToPBest:
    """Current-to-pbest/1 with the paper's order (eq. 12) in the difference: x + scale (p - x + better - worse).

    Members of the archive, (m, D), lost once, and so count as worse than any member.
    """

    archive: FloatArray
    share: float = DEFAULT.elite

    def __call__(self, X: FloatArray, F: FloatArray, scale: Factor, generator: Generator) -> FloatArray:
        """Return mutants, (n, D)."""
        towards, better, worse = self.parents(X, F, generator)
        mutants: FloatArray = X + scale * (towards - X + better - worse)
        return mutants

    def parents(
        self, X: FloatArray, F: FloatArray, generator: Generator
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return one of the elite, and two others, the better first; (n, D) each."""
        towards = X[elite(F, self.share, generator)]
        pool = np.concatenate([X, self.archive])
        cost = np.concatenate([F, np.full(len(self.archive), np.inf)])
        a, b = two_others(len(X), len(pool), generator)
        swap = cost[b] < cost[a]
        return towards, pool[np.where(swap, b, a)], pool[np.where(swap, a, b)]


@dataclass(frozen=True)
class ParameterMemory:
    """Scales and rates that succeeded lately, near which each parent draws its own.

    Between SHADE and L-SHADE: Lehmer means of scales and rates as in L-SHADE (SHADE averages the rates arithmetically),
    but no terminal rate; and rates begin at 0.8 (SHADE and L-SHADE: 0.5), as parameters that act together are better
    crossed over together.
    """

    scales: FloatArray  #: (H,)
    rates: FloatArray  #: (H,); below zero stands for "crossover rate 0 only" (L-SHADE's terminal value)
    slot: int  #: which entry is renewed next

    @classmethod
    def fresh(cls, entries: int = 6, scale: float = 0.5, rate: float = 0.8) -> ParameterMemory:
        """Return the memory before the first generation."""
        return cls(np.full(entries, scale), np.full(entries, rate), 0)

    def sample(self, number: int, generator: Generator) -> tuple[FloatArray, FloatArray]:
        """Return a scale (Cauchy, in (0, 1]) and a rate (normal, in [0, 1]) for each parent, (n,) each."""
        entry = (generator.random(number) * len(self.scales)).astype(np.intp)
        means = self.rates[entry]
        rates = np.clip(generator.normal(means, 0.1), 0.0, 1.0)
        rates[means < 0.0] = 0.0
        scales = self.scales[entry] + 0.1 * generator.standard_cauchy(number)
        while (low := scales <= 0.0).any():
            scales[low] = self.scales[entry][low] + 0.1 * generator.standard_cauchy(int(low.sum()))
        return np.minimum(scales, 1.0), rates

    def learn(
        self, scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray
    ) -> ParameterMemory:
        """Return the memory after a generation: Lehmer means of what won, weighted by the gain; all (n,)."""
        return self.renewed(*success_means(scales, rates, gains, won)) if won.any() else self

    def renewed(self, scale: float, rate: float) -> ParameterMemory:
        """Return the memory with the next entry replaced."""
        scales, rates = self.scales.copy(), self.rates.copy()
        scales[self.slot], rates[self.slot] = scale, rate
        return ParameterMemory(scales, rates, (self.slot + 1) % len(scales))


def success_means(
    scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray
) -> tuple[float, float]:
    """Return the Lehmer means of order 2 of the scales and rates that won, weighted by the gains; all (n,).

    Weights are equal where a parent's cost was infinite.
    """
    gained = gains[won]
    total = float(gained.sum())
    known = np.isfinite(total) and total > 0.0
    weights = gained / total if known else np.full(len(gained), 1.0 / len(gained))

    def lehmer(values: FloatArray) -> float:
        return float((weights * values**2).sum() / max(float((weights * values).sum()), 1e-12))

    return lehmer(scales[won]), lehmer(rates[won])


@dataclass(frozen=True)
class Trials:
    """Trial vectors, with the scales and rates that they were made with."""

    X: FloatArray
    scales: FloatArray
    rates: FloatArray


@dataclass(frozen=True)
class Population:
    """A population and what it has learnt: ask for trials, tell their costs.

    It also names the member from which the next local refinement starts.
    """

    X: FloatArray  #: (n, D), members
    F: FloatArray  #: (n,), their costs with the nuisances at zero
    refined: BoolArray  #: (n,), members from which (or near whose end) a local refinement started
    archive: FloatArray  #: (a, D), parents that lost, at most n
    memory: ParameterMemory  #: scales and rates that worked
    age: int = 0  #: generations
    due: int = 0  #: age at which the next local refinement starts
    period: int = PERIOD  #: generations between local refinements at present
    idle: int = 0  #: generations without a better best

    @classmethod
    def first(cls, X: FloatArray, F: FloatArray) -> Population:
        """Return the population of members (n, D) with costs (n,) before its first generation."""
        return cls(X, F, np.zeros(len(X), dtype=np.bool_), np.empty((0, X.shape[1])), ParameterMemory.fresh())

    def ask(self, generator: Generator, elite: float = DEFAULT.elite) -> Trials:
        """Return one trial per member; a share of `elite` of the population counts as best."""
        scales, rates = self.memory.sample(len(self.X), generator)
        mutants = OrderedToPBest(self.archive, elite)(self.X, self.F, scales[:, None], generator)
        X = binomial(self.X, midpoint(mutants, self.X), rates[:, None], generator)
        return Trials(X, scales, rates)

    def tell(self, trials: Trials, costs: FloatArray, generator: Generator) -> Population:
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

    def next_start(
        self, optima: FloatArray, separation: float = DEFAULT.separation
    ) -> tuple[int | None, Population]:
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
        tight = float((self.X.max(axis=0) - self.X.min(axis=0)).max()) < 1e-9
        flat = np.isfinite(worst) and worst - best <= 1e-13 * abs(best)
        return bool(tight or flat or self.idle > 100 + 20 * self.X.shape[1])
