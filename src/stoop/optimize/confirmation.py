"""When an optimum counts as confirmed: dives that know nothing of each other end at the same best cost.

Two such dives suffice where the model leaves little unexplained. Where it leaves much, a wrong optimum may
attract as many dives as the right one, so there must be three.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.optimize.levenberg import AGREE, Dive

CLEAR: Final = 0.1  #: share of the trivial model's cost up to which little is left unexplained
NOTHING: Final = 1e-12  #: of the trivial model's cost: two exact fits agree


@dataclass(frozen=True)
class Ends:
    """Where the dives on the full record ended.

    Attributes
    ----------
    X : (m, D)
    costs : (m,)
    lineages : (m,), dives of one lineage may know of each other (members of one herd)
    converged : (m,), to an optimum of their own
    agreed : (m,), broken off as good as an optimum known before
    unfinished : (m,), still falling when the iterations were used up
    """

    X: FloatArray
    costs: FloatArray
    lineages: IntArray
    converged: BoolArray
    agreed: BoolArray
    unfinished: BoolArray

    def add(self, end: Dive, lineage: int) -> Ends:
        """Return the ends with one more."""
        return Ends(
            np.concatenate([self.X, end.z[None, : self.X.shape[1]]]),
            np.append(self.costs, end.cost),
            np.append(self.lineages, lineage),
            np.append(self.converged, end.converged),
            np.append(self.agreed, end.ending == "agreed"),
            np.append(self.unfinished, end.ending == "limit"),
        )

    def best(self) -> int:
        """Return which end is the lowest."""
        return int(self.costs.argmin())

    def optimum(self) -> float:
        """Return the least cost that a dive converged to; inf before there is one."""
        return float(self.costs[self.converged].min(initial=np.inf))

    def confirmed(self, best: float, reference: float) -> bool:
        """Whether the last end is at the best cost known, with enough of other lineages.

        Parameters
        ----------
        best : best cost known on the full record
        reference : the trivial model's cost there; inf if there is none
        """
        if not np.isfinite(best):
            return False
        scale = NOTHING * reference if np.isfinite(reference) else 0.0
        level = np.abs(self.costs - best) <= AGREE * abs(best) + scale
        there = level & (self.converged | self.agreed)
        needed = 2 if best <= CLEAR * reference else 3
        enough = len(np.unique(self.lineages[there])) >= needed
        return bool(there[-1] and enough and (there & self.converged).any())


def no_ends(dimension: int) -> Ends:
    """Return the ends before the first dive."""
    nothing = np.empty(0, dtype=np.bool_)
    return Ends(np.empty((0, dimension)), np.empty(0), np.empty(0, dtype=np.intp), nothing, nothing, nothing)
