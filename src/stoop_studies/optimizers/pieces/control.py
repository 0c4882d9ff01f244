"""Control: with which scale the differences of a mutation are multiplied, and with which rate one crosses over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.random import Generator

from stoop.base.arrays import Factor, FloatArray
from stoop.optimize.adaptation import ParameterMemory

TINY: Final = 1e-300  #: keeps a range of costs from being zero


class Control(Protocol):
    """Scale and rate of each generation, and what it learns from the success of its trials.

    The memory is kept in the optimizer's state: numbers, arrays (n, ...), None, or a dataclass of these that
    `stoop.optimize.store` names.
    """

    def begin(self, members: int) -> Any:
        """Return the memory of a population before its first generation."""
        ...

    def sample(self, memory: Any, F: FloatArray, generator: Generator) -> tuple[Factor, Factor]:
        """Return scale and rate for parents of costs F, (n,): a number each, or (n, 1)."""
        ...

    def learn(self, memory: Any, scale: Factor, rate: Factor, before: FloatArray, costs: FloatArray) -> Any:
        """Return the memory after trials of the given costs, (n,), met parents of costs `before`, (n,)."""
        ...


class Memoryless:
    """A control that learns nothing."""

    def begin(self, members: int) -> None:
        """Return None."""

    def learn(self, memory: None, scale: Factor, rate: Factor, before: FloatArray, costs: FloatArray) -> None:
        """Return None."""


@dataclass(frozen=True)
class Fixed(Memoryless):
    """The same scale and rate for all members and generations."""

    scale: float = 0.5
    rate: float = 0.9

    def sample(self, memory: None, F: FloatArray, generator: Generator) -> tuple[float, float]:
        """Return scale and rate."""
        return self.scale, self.rate


@dataclass(frozen=True)
class Signed(Memoryless):
    """A new scale for every mutant, uniform in [low, high] and of either sign; a fixed rate.

    References
    ----------
    Kaelo and Ali (2006), Eur. J. Oper. Res. 169, 1176-1184: F in [-1, -0.4] or [0.4, 1] for each mutated point.
    """

    low: float = 0.4
    high: float = 1.0
    rate: float = 0.5

    def sample(self, memory: None, F: FloatArray, generator: Generator) -> tuple[FloatArray, float]:
        """Return scales (n, 1) and the rate."""
        draws = 2.0 * generator.random((len(F), 1)) - 1.0
        scales: FloatArray = draws * (self.high - self.low) + np.copysign(self.low, draws)
        return scales, self.rate


@dataclass(frozen=True)
class ByCost(Memoryless):
    """A rate that grows with a parent's cost: good parents change little. Those better than the mean take `low`.

    The scale is fixed; a mutation may take it for the largest that it uses (`mutation.ScaledByCost`).

    References
    ----------
    Wu, Wang and Zhou (2007), Self-adapting control parameters modified differential evolution for trajectory
    planning of manipulators, J. Control Theory Appl. 5, 365-373.
    """

    scale: float = 0.9
    low: float = 0.1
    high: float = 0.6

    def sample(self, memory: None, F: FloatArray, generator: Generator) -> tuple[float, FloatArray]:
        """Return the scale and rates (n, 1); a parent of infinite cost takes `high`."""
        finite = np.isfinite(F)
        if not finite.any():
            return self.scale, np.full((len(F), 1), self.high)
        best, worst, mean = F[finite].min(), F[finite].max(), F[finite].mean()
        place = np.where(finite, (F - best) / max(worst - best, TINY), 1.0)
        rates = np.where(mean < F, self.low + (self.high - self.low) * place, self.low)
        return self.scale, rates[:, None]


@dataclass(frozen=True)
class SuccessHistory:
    """Scales and rates near those of recent successful trials, one of each for every parent.

    References
    ----------
    Tanabe and Fukunaga (2013), IEEE CEC, 71-78 (SHADE).
    """

    entries: int = 6

    def begin(self, members: int) -> ParameterMemory:
        """Return a memory without any success."""
        return ParameterMemory.fresh(self.entries)

    def sample(
        self, memory: ParameterMemory, F: FloatArray, generator: Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Return scales and rates, (n, 1) each."""
        scales, rates = memory.sample(len(F), generator)
        return scales[:, None], rates[:, None]

    def learn(
        self,
        memory: ParameterMemory,
        scale: FloatArray,
        rate: FloatArray,
        before: FloatArray,
        costs: FloatArray,
    ) -> ParameterMemory:
        """Return the memory after a generation: means of the successful, weighted by the gain in cost."""
        with np.errstate(invalid="ignore"):
            gains = before - costs
        return memory.learn(scale[:, 0], rate[:, 0], gains, costs < before)
