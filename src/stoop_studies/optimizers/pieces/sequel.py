"""Sequels: what may be done to a population between selection and the next generation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger


@dataclass(frozen=True)
class Turn:
    """A generation that has just been selected.

    Attributes
    ----------
    X, F : (n, D) and (n,), survivors and their costs
    before : (n,), costs before the generation
    generation : its number, from 1
    """

    X: FloatArray
    F: FloatArray
    before: FloatArray
    generation: int

    @property
    def improved(self) -> bool:
        """Whether the generation brought a better best."""
        return bool(self.F.min() < self.before.min())


class Sequel(Protocol):
    """Changes survivors; whatever it evaluates goes through the ledger."""

    def __call__(
        self, turn: Turn, ledger: Ledger, generator: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Return members and costs for the next generation; the turn's own arrays are left as they are."""
        ...
