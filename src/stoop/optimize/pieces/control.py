"""Control: with which scale the differences of a mutation are multiplied, and with which rate one crosses over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np

from stoop.optimize.arrays import FloatArray

Factor: TypeAlias = float | FloatArray  #: one for all parents, or one for each, (n, 1)


class Control(Protocol):
    """Scale and rate of each generation, and what is learnt from how its trials fared.

    The memory is kept in the optimizer's state: numbers, arrays (n, ...), None, or a dataclass of these that
    `stoop.optimize.store` names.
    """

    def begin(self, members: int) -> Any:
        """Return the memory of a population that has not moved yet."""
        ...

    def sample(self, memory: Any, F: FloatArray, generator: np.random.Generator) -> tuple[Factor, Factor]:
        """Return scale and rate for parents of costs F, (n,): a number each, or (n, 1)."""
        ...

    def learn(self, memory: Any, scale: Factor, rate: Factor, before: FloatArray, costs: FloatArray) -> Any:
        """Return the memory after trials of the given costs, (n,), met parents of costs `before`, (n,)."""
        ...


@dataclass(frozen=True)
class Fixed:
    """The same scale and rate for all, always."""

    scale: float = 0.5
    rate: float = 0.9

    def begin(self, members: int) -> None:
        """Return nothing: there is nothing to remember."""
        return

    def sample(self, memory: None, F: FloatArray, generator: np.random.Generator) -> tuple[float, float]:
        """Return scale and rate."""
        return self.scale, self.rate

    def learn(self, memory: None, scale: Factor, rate: Factor, before: FloatArray, costs: FloatArray) -> None:
        """Learn nothing."""
        return
