"""The horizon ladder: a prey is followed on ever longer records, and shelved where it does not explain them.

On a short record a poor candidate has not yet run far from the measurements, so the cost has few wrong optima
and costs little. The gates know neither the noise nor whether the model is perfect: a rung is passed by
explaining most of what a constant does not, or by doing about as well as any earlier dive did there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.levenberg import FULL, RUNG, Dive, dive

GATE: Final = 0.25  #: share of the trivial model's cost that a passing prey may leave unexplained
CONSISTENT: Final = 2.0  #: times the score on the last rung that is still the same score on the full record
NEARLY: Final = 1e-4  #: share of the trivial model's cost that bars no prey: it may confirm an exact optimum
SIMILAR: Final = 1.2  #: or this many times the least cost that an earlier dive reached on the rung


@dataclass(frozen=True)
class Descent:
    """Where a prey came to on the ladder.

    Attributes
    ----------
    z : (D + E,)
    rung, cost : the last rung tried, and the cost there; inf where it diverged
    score : that cost over the trivial model's
    passed : whether it passed every shortened record
    seen : (rungs,), least cost that dives reached on each rung, this one included
    """

    z: FloatArray
    rung: int
    cost: float
    score: float
    passed: bool
    seen: FloatArray


def descend(ledger: Ledger, z: FloatArray, seen: FloatArray, bound: float = np.inf) -> Descent:
    """Dive from z on each shortened record in turn, as long as the gates let it through.

    Parameters
    ----------
    ledger : Ledger
    z : (D + E,)
    seen : (rungs,), least cost that earlier dives reached on each rung
    bound : float
        What an optimum that is trusted leaves on the full record: a prey that leaves more on a part of it
        is not better, so it must fall fast on the way there.
    """
    bound = max(bound, NEARLY * ledger.reference(ledger.full))
    seen = seen.copy()
    descent = Descent(z, 0, np.inf, 0.0, True, seen)
    for rung in range(ledger.full):
        end = dive(ledger, descent.z, rung, RUNG, incumbent=bound, worthy=-np.inf)
        through = end.cost <= bound and passes(ledger, end.cost, rung, seen)
        seen[rung] = min(seen[rung], end.cost)
        descent = Descent(end.z, rung, end.cost, relative(ledger, end.cost, rung), through, seen)
        if not through:
            break
    return descent


def finish(ledger: Ledger, z: FloatArray, optimum: float, score: float = 0.0) -> Dive:
    """Dive on the full record, measured against the best so far and the best optimum known.

    A dive is followed to its end, however slowly it falls, if it explains the data, or is near the best so
    far, or does on the full record about as well as on the last rung (`score`): then it is the model that is
    imperfect, not the prey.
    """
    worthy = max(GATE, CONSISTENT * score) * ledger.reference(ledger.full)
    if np.isfinite(ledger.cost):
        worthy = max(worthy, SIMILAR * ledger.cost)
    return dive(ledger, z, ledger.full, FULL, ledger.cost, worthy, optimum)


def passes(ledger: Ledger, cost: float, rung: int, seen: FloatArray) -> bool:
    """Whether a cost on a rung is good enough to go on."""
    if not np.isfinite(cost):
        return False
    similar = bool(np.isfinite(seen[rung])) and cost <= SIMILAR * float(seen[rung])
    return similar or explains(ledger, cost, rung)


def explains(ledger: Ledger, cost: float, rung: int) -> bool:
    """Whether a cost leaves little of what the trivial model cannot explain."""
    return relative(ledger, cost, rung) <= GATE


def relative(ledger: Ledger, cost: float, rung: int) -> float:
    """Return a cost over the trivial model's: 0 where that is infinite (no gate), inf where it is zero."""
    reference = ledger.reference(rung)
    return cost / reference if reference > 0.0 else np.inf
