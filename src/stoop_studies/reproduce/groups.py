"""The runs of one method up to one number of iterations, on whatever problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from stoop.base.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Group:
    """The runs of one method up to one number of iterations.

    Attributes
    ----------
    method : str
    iterations : int
    values : (n, D)
        Best of each run.
    costs : (n,)
        Fitness J of each.
    hits : (n,)
        Evaluations up to the target; inf where that was not reached.
    evaluations : (n,)
        Spent.
    """

    method: str
    iterations: int
    values: FloatArray
    costs: FloatArray
    hits: FloatArray
    evaluations: FloatArray

    @classmethod
    def of(
        cls,
        method: str,
        iterations: int,
        told: Sequence[Mapping[str, Any]],
        order: Sequence[int] | None = None,
    ) -> Self:
        """Return what `stoop_studies.search.search` told of each run; ``order`` picks among the values."""
        values = np.array([t["values"] for t in told], dtype=float)
        return cls(
            method,
            iterations,
            values if order is None else values[:, list(order)],
            np.array([t["cost"] for t in told], dtype=float),
            np.array([np.inf if t["hit"] is None else t["hit"] for t in told]),
            np.array([t["evaluations"] for t in told], dtype=float),
        )

    @property
    def reached(self) -> int:
        """How many runs came to the target."""
        return int(np.isfinite(self.hits).sum())

    @property
    def median_hit(self) -> float:
        """Median evaluations of those; NaN where there is none."""
        reached = self.hits[np.isfinite(self.hits)]
        return float(np.median(reached)) if reached.size else np.nan

    @property
    def hits_told(self) -> str:
        """The median and how many came there, as a page shows it; a dash where none did."""
        return "–" if not self.reached else f"{self.median_hit:.0f} ({self.reached})"
