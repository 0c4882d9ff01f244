"""Recorded channels under their registry names, each on its own clock, not yet on a grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray

GAP: Final = 0.05  #: s; a longer hole in an input ends a segment
WILD: Final = 1e9  #: SI; no quantity of the registry is that large
ALONE: Final = 60.0  #: s; the least distance from the rest at which a few samples are strays
FAR: Final = 100.0  #: median periods; the same for channels logged slowly
FEW: Final = 3  #: samples
SLOW_GAP: Final = 2.5  #: median periods; for channels logged too slowly for `GAP`


@dataclass(frozen=True)
class Channels:
    """Variables that share one clock.

    Attributes
    ----------
    source : topic or file they come from
    time : (n,) s, strictly increasing
    values : variable -> (n,) SI, NaN where there is none
    """

    source: str
    time: FloatArray
    values: Mapping[str, FloatArray]

    @property
    def rate(self) -> float:
        """Nominal rate [Hz] from the median period; zero with fewer than two samples."""
        return 1.0 / float(np.median(np.diff(self.time))) if self.time.size > 1 else 0.0


@dataclass(frozen=True)
class SourceRate:
    """How a variable was recorded.

    Attributes
    ----------
    source : topic or file
    rate : Hz, from the median period
    longest_gap : s, the longest hole between two samples
    gaps : how many holes end a contiguous stretch
    start, stop : s, first and last sample on the log's own clock
    """

    source: str
    rate: float
    longest_gap: float
    gaps: int
    start: float
    stop: float


def tame(group: Channels) -> tuple[Channels, list[str]]:
    """Drop strays at both ends of the record, count impossibly large numbers as missing, and say so.

    Parameters
    ----------
    group : as recorded

    Returns
    -------
    group : the same, without the strays, and with NaN in place of what is too large
    notes : one for the strays, and one for each variable that had large numbers
    """
    group, told = _without_strays(group)
    wild = {name: int(np.sum(np.abs(x) > WILD)) for name, x in group.values.items()}
    if not any(wild.values()):
        return group, told
    values = {
        name: np.where(np.abs(x) <= WILD, x, np.nan) if wild[name] else x for name, x in group.values.items()
    }
    notes = [
        f"{group.source}: {n} samples of {name} are beyond any size and were dropped"
        for name, n in wild.items()
        if n
    ]
    return Channels(group.source, group.time, values), [*told, *notes]


def _without_strays(group: Channels) -> tuple[Channels, list[str]]:
    """Drop a few samples before or after all others: one damaged time stamp makes a flight of hours, all of it a gap."""
    time = group.time
    if time.size <= FEW:
        return group, []
    steps = np.diff(time)
    cuts = np.flatnonzero(steps > max(ALONE, FAR * float(np.median(steps)))) + 1
    pieces = [(a, b) for a, b in pairwise([0, *cuts.tolist(), time.size]) if b - a > FEW]
    if not cuts.size or not pieces:
        return group, []
    kept = slice(pieces[0][0], pieces[-1][1])
    lost = int(time.size - (kept.stop - kept.start))
    if not lost:
        return group, []
    note = f"{group.source}: {lost} samples more than {ALONE:g} s before or after all others were dropped"
    return Channels(group.source, time[kept], {name: x[kept] for name, x in group.values.items()}), [note]


def longest_allowed(time: FloatArray) -> float:
    """Return the longest distance between samples [s] that may be interpolated across."""
    return max(GAP, SLOW_GAP * float(np.median(np.diff(time)))) if time.size > 1 else GAP


def stretches(time: FloatArray, values: FloatArray) -> list[slice]:
    """Split samples where the hole between neighbors is too long to interpolate across.

    Parameters
    ----------
    time : (n,) s, increasing
    values : (n, k); not looked at, beyond its length

    Returns
    -------
    slices of two samples and more
    """
    cuts = np.flatnonzero(np.diff(time) > longest_allowed(time)) + 1
    edges = [0, *cuts.tolist(), len(values)]
    return [slice(a, b) for a, b in pairwise(edges) if b - a > 1]


def source_rate(source: str, time: FloatArray) -> SourceRate:
    """Describe the clock of one variable, from the samples that hold a value."""
    if time.size < 2:
        start = float(time[0]) if time.size else float("nan")
        return SourceRate(source, 0.0, 0.0, 0, start, start)
    steps = np.diff(time)
    gaps = int(np.sum(steps > longest_allowed(time)))
    return SourceRate(
        source, 1.0 / float(np.median(steps)), float(steps.max()), gaps, float(time[0]), float(time[-1])
    )
