"""Ordered SHADE: success-history differential evolution with the paper's ordered difference.

Ask for trials, tell their costs; the herd also says which of its members is the next prey for a dive.

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
from stoop.optimize.pieces.adaptation import Memory, fresh_memory
from stoop.optimize.pieces.archive import remember
from stoop.optimize.pieces.bounds import midpoint
from stoop.optimize.pieces.crossover import binomial
from stoop.optimize.pieces.directed import OrderedToPBest
from stoop.optimize.pieces.selection import greedy

ELITE: Final = 0.11  #: share of the herd that counts as best
PERIOD: Final = 10  #: generations between prey
SEPARATION: Final = 0.02  #: of the unit box: nearer to an earlier dive's end is no new prey
COLLAPSED: Final = 1e-9  #: spread in the unit box
GROWTH: Final = 1.5  #: of the herd at each restart
LARGEST: Final = 500  #: herd
FLAT: Final = 1e-13  #: relative spread of costs


@dataclass(frozen=True)
class Herd:
    """A population and what it has learnt.

    Attributes
    ----------
    X, F : (n, D) and (n,), members and their costs with the nuisances at zero
    dived : (n,), members from which (or near whose end) a dive was made
    archive : (a, D), parents that lost, at most n
    memory : scales and rates that worked
    age : generations
    due : age at which the next prey is taken
    period : generations between prey at present
    idle : generations without a better best
    """

    X: FloatArray
    F: FloatArray
    dived: BoolArray
    archive: FloatArray
    memory: Memory
    age: int = 0
    due: int = 0
    period: int = PERIOD
    idle: int = 0


@dataclass(frozen=True)
class Trials:
    """What a herd asks to be tried, and with which scales and rates it was made."""

    X: FloatArray
    scales: FloatArray
    rates: FloatArray


def gather(X: FloatArray, F: FloatArray) -> Herd:
    """Return a herd that has not moved yet."""
    return Herd(X, F, np.zeros(len(X), dtype=np.bool_), np.empty((0, X.shape[1])), fresh_memory())


def ask(herd: Herd, generator: np.random.Generator, elite: float = ELITE) -> Trials:
    """Return one trial per member; a share of `elite` of the herd counts as best."""
    scales, rates = herd.memory.sample(len(herd.X), generator)
    mutants = OrderedToPBest(herd.archive, elite)(herd.X, herd.F, scales[:, None], generator)
    X = binomial(herd.X, midpoint(mutants, herd.X), rates[:, None], generator)
    return Trials(X, scales, rates)


def tell(herd: Herd, trials: Trials, costs: FloatArray, generator: np.random.Generator) -> Herd:
    """Return the herd after selection."""
    X, F, won = greedy(herd.X, herd.F, trials.X, costs)
    with np.errstate(invalid="ignore"):
        gains = herd.F - costs
    return replace(
        herd,
        X=X,
        F=F,
        dived=herd.dived & ~won,
        archive=remember(herd.archive, herd.X[won], len(X), generator),
        memory=herd.memory.learn(trials.scales, trials.rates, gains, won),
        age=herd.age + 1,
        idle=0 if _improved(herd.F, F) else herd.idle + 1,
    )


def prey(herd: Herd, ends: FloatArray, separation: float = SEPARATION) -> tuple[int | None, Herd]:
    """Return the best member not dived at yet, or None if it lies beside an earlier dive's end, (m, D)."""
    open_costs = np.where(herd.dived, np.inf, herd.F)
    i = int(open_costs.argmin())
    marked = herd.dived.copy()
    marked[i] = True
    near = len(ends) > 0 and np.abs(ends - herd.X[i]).max(axis=1).min() <= separation
    herd = replace(herd, dived=marked, due=herd.age + herd.period)
    return (None if near or not np.isfinite(open_costs[i]) else i), herd


def settle(herd: Herd, member: int, x: FloatArray, cost: float, improved: bool) -> Herd:
    """Put a dive's end in the member's place if it is better, and set the time of the next prey.

    Diving pays as long as it improves on the best; where it does not, the herd is left alone for longer.
    """
    X, F = herd.X.copy(), herd.F.copy()
    if cost < F[member]:
        X[member], F[member] = x, cost
    period = max(PERIOD // 2, 1) if improved else min(2 * herd.period, 20 * PERIOD)
    return replace(herd, X=X, F=F, period=period, due=herd.age + period)


def grown(size: int, growth: float = GROWTH, largest: int = LARGEST) -> int:
    """Return how many members the next herd has."""
    return min(int(size * growth), largest)


def spent(herd: Herd) -> bool:
    """Whether the herd has collapsed or stopped improving, so that a new one should be gathered."""
    best, worst = float(herd.F.min()), float(herd.F.max())
    tight = float((herd.X.max(axis=0) - herd.X.min(axis=0)).max()) < COLLAPSED
    flat = np.isfinite(worst) and worst - best <= FLAT * abs(best)
    return bool(tight or flat or herd.idle > 100 + 20 * herd.X.shape[1])


def _improved(before: FloatArray, after: FloatArray) -> bool:
    """Whether the best moved by more than rounding."""
    old, new = float(before.min()), float(after.min())
    return new < old - 1e-9 * abs(old) if np.isfinite(old) else new < old
