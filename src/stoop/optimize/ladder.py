"""The horizon ladder, and when an optimum counts as confirmed.

A candidate is refined on ever longer records, and deferred where it does not explain them. On a short record a poor
candidate has not yet departed far from the measurements, so the cost has few wrong optima and is cheap. The gates
know neither the noise nor whether the model is perfect: a rung is passed by explaining most of what a constant does
not, or by doing about as well as any earlier refinement did there.

An optimum is confirmed when independent refinements end at the same best cost. Two suffice where the model leaves
little unexplained. Where it leaves much, a wrong optimum may attract as many refinements as the right one, so there
must be three.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.local_refinement import AGREE, FULL, RUNG, Refinement, refine

GATE: Final = 0.25  #: share of the trivial model's cost that a passing candidate may leave unexplained
NEARLY_EXACT: Final = 1e-4  #: likewise; it stops no candidate, as it may confirm an exact optimum
SIMILAR: Final = 1.2  #: or this many times the least cost that an earlier refinement reached on the rung


@dataclass(frozen=True)
class Climb:
    """Where a candidate, (D + E,), came to on the ladder."""

    z: FloatArray
    rung: int  #: the last tried
    cost: float  #: there; inf where it diverged
    score: float  #: that cost over the trivial model's
    passed: bool  #: whether it passed every shortened record
    least: FloatArray  #: (rungs,), least cost that refinements reached on each rung, this one included


def climb(ledger: Ledger, z: FloatArray, least: FloatArray, bound: float = np.inf) -> Climb:
    """Refine from z on each shortened record in turn, as long as the gates let it pass.

    `least`, (rungs,), are the least costs that earlier refinements reached on each rung; `bound` is what a trusted optimum
    leaves on the full record: a candidate that leaves more on a part of it is not better, so it must fall fast on the way.
    """
    bound = max(bound, NEARLY_EXACT * ledger.reference(ledger.full))
    least = least.copy()
    found = Climb(z, 0, np.inf, 0.0, True, least)
    for rung in range(ledger.full):
        end = refine(ledger, found.z, rung, RUNG, incumbent=bound, acceptable=-np.inf)
        through = end.cost <= bound and passes(ledger, end.cost, rung, least)
        least[rung] = min(least[rung], end.cost)
        found = Climb(end.z, rung, end.cost, relative(ledger, end.cost, rung), through, least)
        if not through:
            break
    return found


def refine_fully(ledger: Ledger, z: FloatArray, optimum: float, score: float = 0.0) -> Refinement:
    """Refine on the full record, measured against the best so far and the best optimum known.

    A refinement is followed to its end, however slowly it falls, if it explains the data, or is near the best so
    far, or does on the full record no worse than twice as on the last rung (`score`): then the model is imperfect, not the
    candidate.
    """
    acceptable = max(GATE, 2.0 * score) * ledger.reference(ledger.full)
    if np.isfinite(ledger.cost):
        acceptable = max(acceptable, SIMILAR * ledger.cost)
    return refine(ledger, z, ledger.full, FULL, ledger.cost, acceptable, optimum)


def passes(ledger: Ledger, cost: float, rung: int, least: FloatArray) -> bool:
    """Whether a cost on a rung is good enough to go on."""
    if not np.isfinite(cost):
        return False
    similar = bool(np.isfinite(least[rung])) and cost <= SIMILAR * float(least[rung])
    return similar or explains(ledger, cost, rung)


def explains(ledger: Ledger, cost: float, rung: int) -> bool:
    """Whether a cost leaves little of what the trivial model cannot explain."""
    return relative(ledger, cost, rung) <= GATE


def relative(ledger: Ledger, cost: float, rung: int) -> float:
    """Return a cost over the trivial model's: 0 where that is infinite (no gate), inf where it is zero."""
    reference = ledger.reference(rung)
    return cost / reference if reference > 0.0 else np.inf


@dataclass(frozen=True)
class Optima:
    """Where m refinements on the full record ended; refinements of one lineage (one population) may depend on each other."""

    X: FloatArray  #: (m, D)
    costs: FloatArray
    lineages: IntArray
    converged: BoolArray  #: to an optimum of their own
    agreed: BoolArray  #: stopped as good as an optimum known before
    unfinished: BoolArray  #: still falling when the iterations were used up

    @classmethod
    def none(cls, dimension: int) -> Optima:
        """Return the optima before the first refinement."""
        no = np.empty(0, dtype=np.bool_)
        return cls(np.empty((0, dimension)), np.empty(0), np.empty(0, dtype=np.intp), no, no, no)

    def add(self, end: Refinement, lineage: int) -> Optima:
        """Return the optima with one more."""
        return Optima(
            np.concatenate([self.X, end.z[None, : self.X.shape[1]]]),
            np.append(self.costs, end.cost),
            np.append(self.lineages, lineage),
            np.append(self.converged, end.converged),
            np.append(self.agreed, end.ending == "agreed"),
            np.append(self.unfinished, end.ending == "limit"),
        )

    def best(self) -> int:
        """Return the index of the lowest."""
        return int(self.costs.argmin())

    def least_converged(self) -> float:
        """Return the least cost that a refinement converged to; inf before there is one."""
        return float(self.costs[self.converged].min(initial=np.inf))

    def confirmed(self, best: float, reference: float) -> bool:
        """Whether the last end is at the best cost known, with enough of other lineages; reference: the trivial model's cost."""
        if not np.isfinite(best):
            return False
        scale = 1e-12 * reference if np.isfinite(reference) else 0.0  # two exact fits agree
        level = np.abs(self.costs - best) <= AGREE * abs(best) + scale
        there = level & (self.converged | self.agreed)
        needed = 2 if best <= 0.1 * reference else 3
        enough = len(np.unique(self.lineages[there])) >= needed
        return bool(there[-1] and enough and (there & self.converged).any())
