"""Greedy selection of disjoint windows by the information that they add, and of one for validation.

D-optimality: each step takes the window that shrinks the uncertainty ellipsoid most for its length. For a sum of
information matrices log det is submodular, so the greedy selection is within 1 - 1/e of the best of its size.

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
from stoop.input_design.windows.candidates import Candidate

MIN_GAIN: Final = 0.05  #: per parameter, below which a window is not worth fitting: error bars 5 % smaller
MAX_WINDOWS: Final = 8  #: to fit; each has an initial state and biases of its own
WINDOW_COST: Final = 2.0  #: s that a window costs besides its length
MANEUVER_WEIGHT: Final = 1.5  #: of a whole maneuver, over a window that may cut one
REDUNDANT: Final = 0.25  #: loss per parameter at which a fitted window may be held out instead
VALIDATION_WORTH: Final = 0.5  #: of the fitted windows' gain, at which a window that is left is held out


@dataclass(frozen=True, eq=False)
class CandidateInformation:
    """Fisher information of each candidate alone.

    Attributes
    ----------
    prior : (D, D)
        Information before any flight.
    matrices : tuple of (D, D)
        Of each candidate.
    """

    prior: FloatArray
    matrices: tuple[FloatArray, ...]

    def gain(self, base: FloatArray, index: int) -> float:
        """Return by how much the mean logarithm of the error bars falls when a candidate is added."""
        return (_logdet(base + self.matrices[index]) - _logdet(base)) / (2.0 * len(base))

    def total(self, chosen: Sequence[int]) -> FloatArray:
        """Return the information (D, D) with some candidates."""
        return np.asarray(self.prior + sum((self.matrices[i] for i in chosen), np.zeros_like(self.prior)))

    def gain_alone(self, index: int) -> float:
        """Return the gain of a candidate alone."""
        return self.gain(self.prior, index)


@dataclass(frozen=True)
class Selection:
    """Candidates to fit, with the gain of each, and the one to validate with.

    Attributes
    ----------
    fitted : tuple of int, in the order of selection
    gains : tuple of float
    held_out : int or None
    """

    fitted: tuple[int, ...]
    gains: tuple[float, ...]
    held_out: int | None


def select(found: Sequence[Candidate], information: CandidateInformation) -> Selection:
    """Select windows until one more adds little; hold one out."""
    fitted: list[int] = []
    gains: list[float] = []
    base = information.prior
    while len(fitted) < MAX_WINDOWS:
        free = [i for i in range(len(found)) if not any(found[i].meets(found[j]) for j in fitted)]
        rated = {i: information.gain(base, i) for i in free}
        rated = {i: g for i, g in rated.items() if g >= MIN_GAIN}
        if not rated:
            break
        best = max(rated, key=lambda i: rated[i] * _weight(found[i]))
        fitted.append(best)
        gains.append(rated[best])
        base = base + information.matrices[best]
    held = _held_out(found, information, fitted)
    left = [(i, g) for i, g in zip(fitted, gains, strict=True) if i != held]
    return Selection(tuple(i for i, _ in left), tuple(g for _, g in left), held)


def _weight(one: Candidate) -> float:
    """Return the weight of a gain: per second, and larger for a whole maneuver."""
    return (1.0 if one.maneuver is None else MANEUVER_WEIGHT) / (one.seconds + WINDOW_COST)


def _held_out(
    found: Sequence[Candidate], information: CandidateInformation, fitted: Sequence[int]
) -> int | None:
    """Return the window to validate with: a maneuver that is left, else one whose axis is fitted twice, else the cheapest."""
    free = [i for i in range(len(found)) if not any(found[i].meets(found[j]) for j in fitted)]
    usual = float(np.median([information.gain_alone(i) for i in fitted])) if fitted else np.inf
    eligible = [i for i in free if information.gain_alone(i) >= VALIDATION_WORTH * usual]
    losses = {i: information.gain(information.total([j for j in fitted if j != i]), i) for i in fitted}
    spare = [i for i in fitted if losses[i] < REDUNDANT] if len(fitted) > 1 else []
    flown = [i for i in eligible if found[i].maneuver is not None]
    twice = [i for i in spare if _repeated(found, fitted, i)]
    for group in (flown, eligible if not twice else []):
        if group:
            return max(group, key=information.gain_alone)
    for group in (twice, spare):
        if group:
            return min(group, key=lambda i: losses[i])
    best = max(free, key=information.gain_alone, default=None)
    return best if best is not None and information.gain_alone(best) > MIN_GAIN else None


def _repeated(found: Sequence[Candidate], fitted: Sequence[int], index: int) -> bool:
    axes = [m.axis for i in fitted if (m := found[i].maneuver) is not None]
    own = found[index].maneuver
    return own is not None and axes.count(own.axis) > 1


def _logdet(matrix: FloatArray) -> float:
    return float(np.linalg.slogdet(matrix)[1])
