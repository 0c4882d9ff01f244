"""Greedy choice of disjoint windows by the information they add, and of one to be predicted.

D-optimality: each step takes the window that shrinks the uncertainty ellipsoid most for its length. For a sum of
information matrices log det is submodular, so that the greedy choice is within 1 - 1/e of the best of its size.

References
----------
V. V. Fedorov, *Theory of Optimal Experiments*, Academic Press, 1972. G. L. Nemhauser, L. A. Wolsey and M. L. Fisher,
"An analysis of approximations for maximizing submodular set functions", *Mathematical Programming* 14, 1978.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.design.windows.candidates import Candidate

LITTLE: Final = 0.05  #: gain per parameter below which a window is not worth fitting: error bars 5 % smaller
MOST: Final = 8  #: windows to fit; each has an initial state and biases of its own, and must be read
SETTLE: Final = 2.0  #: s that a window costs besides its length
FAVOR: Final = 1.5  #: of a whole maneuver, over a window that may cut one
REDUNDANT: Final = 0.25  #: loss per parameter at which a fitted window may be held out instead
WORTHY: Final = (
    0.5  #: of what fitted windows are worth; one that is left over and worth that much is held out
)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What each candidate tells, alone.

    Attributes
    ----------
    known : (D, D)
        Information before any flight.
    told : tuple of (D, D)
        Of each candidate.
    """

    known: FloatArray
    told: tuple[FloatArray, ...]

    def gain(self, base: FloatArray, index: int) -> float:
        """Return by how much the mean logarithm of the error bars falls when a candidate is added."""
        return (_logdet(base + self.told[index]) - _logdet(base)) / (2.0 * len(base))

    def with_all(self, chosen: Sequence[int]) -> FloatArray:
        """Return the information (D, D) with some candidates."""
        return np.asarray(self.known + sum((self.told[i] for i in chosen), np.zeros_like(self.known)))

    def worth(self, index: int) -> float:
        """Return the gain of a candidate alone."""
        return self.gain(self.known, index)


@dataclass(frozen=True)
class Choice:
    """Which candidates to fit, with what each added, and which to predict.

    Attributes
    ----------
    fitted : tuple of int, in the order in which they were chosen
    gains : tuple of float
    held_out : int or None
    """

    fitted: tuple[int, ...]
    gains: tuple[float, ...]
    held_out: int | None


def choose(found: Sequence[Candidate], evidence: Evidence) -> Choice:
    """Choose windows until one more adds little; hold one out."""
    fitted: list[int] = []
    gains: list[float] = []
    base = evidence.known
    while len(fitted) < MOST:
        free = [i for i in range(len(found)) if not any(found[i].meets(found[j]) for j in fitted)]
        rated = {i: evidence.gain(base, i) for i in free}
        rated = {i: g for i, g in rated.items() if g >= LITTLE}
        if not rated:
            break
        best = max(rated, key=lambda i: rated[i] * _favor(found[i]))
        fitted.append(best)
        gains.append(rated[best])
        base = base + evidence.told[best]
    held = _held_out(found, evidence, fitted)
    left = [(i, g) for i, g in zip(fitted, gains, strict=True) if i != held]
    return Choice(tuple(i for i, _ in left), tuple(g for _, g in left), held)


def _favor(one: Candidate) -> float:
    """Return the weight of a gain: by the time it takes, and by whether it is of a whole maneuver."""
    return (1.0 if one.maneuver is None else FAVOR) / (one.seconds + SETTLE)


def _held_out(found: Sequence[Candidate], evidence: Evidence, fitted: Sequence[int]) -> int | None:
    """Return what to predict: a maneuver left over, else one whose axis is fitted twice, else what costs least."""
    free = [i for i in range(len(found)) if not any(found[i].meets(found[j]) for j in fitted)]
    usual = float(np.median([evidence.worth(i) for i in fitted])) if fitted else np.inf
    worthy = [i for i in free if evidence.worth(i) >= WORTHY * usual]
    losses = {i: evidence.gain(evidence.with_all([j for j in fitted if j != i]), i) for i in fitted}
    spare = [i for i in fitted if losses[i] < REDUNDANT] if len(fitted) > 1 else []
    flown = [i for i in worthy if found[i].maneuver is not None]
    twice = [i for i in spare if _repeated(found, fitted, i)]
    for group in (flown, worthy if not twice else []):
        if group:
            return max(group, key=evidence.worth)
    for group in (twice, spare):
        if group:
            return min(group, key=lambda i: losses[i])
    best = max(free, key=evidence.worth, default=None)
    return best if best is not None and evidence.worth(best) > LITTLE else None


def _repeated(found: Sequence[Candidate], fitted: Sequence[int], index: int) -> bool:
    axes = [m.axis for i in fitted if (m := found[i].maneuver) is not None]
    own = found[index].maneuver
    return own is not None and axes.count(own.axis) > 1


def _logdet(matrix: FloatArray) -> float:
    return float(np.linalg.slogdet(matrix)[1])
