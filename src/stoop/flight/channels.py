"""Recorded channels under their registry names, each on its own clock, not yet on a grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice

MAX_GAP: Final = 0.05  #: s; a longer hole in an input ends a segment
MAX_GAP_PERIODS: Final = 2.5  #: median periods; for channels logged too slowly for `MAX_GAP`
MAX_VALUE: Final = 1e9  #: SI; no quantity of the registry is that large
STRAY_DISTANCE: Final = 60.0  #: s; the least distance from the rest at which a few samples are strays
STRAY_PERIODS: Final = 100.0  #: median periods; the same for channels logged slowly
MAX_STRAYS: Final = 3  #: samples


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


def drop_outliers(group: Channels) -> tuple[Channels, list[Notice]]:
    """Drop stray samples at both ends of the record and take impossibly large values as missing.

    One damaged time stamp would make a flight of hours, nearly all of it a gap.

    Parameters
    ----------
    group : as recorded

    Returns
    -------
    group : without the strays, NaN in place of values above `MAX_VALUE`
    notices : one for the strays, and one for each variable with large values
    """
    time, values, notices = group.time, dict(group.values), []
    steps = np.diff(time)
    if time.size > MAX_STRAYS:
        cuts = np.flatnonzero(steps > max(STRAY_DISTANCE, STRAY_PERIODS * float(np.median(steps)))) + 1
        pieces = [(a, b) for a, b in pairwise([0, *cuts.tolist(), time.size]) if b - a > MAX_STRAYS]
        kept = slice(pieces[0][0], pieces[-1][1]) if cuts.size and pieces else slice(0, time.size)
        lost = int(time.size - (kept.stop - kept.start))
        if lost:
            notices.append(notice("stray-samples", group.source, count=lost, distance=STRAY_DISTANCE))
            time, values = time[kept], {name: x[kept] for name, x in values.items()}
    for name, x in values.items():
        large = int(np.sum(np.abs(x) > MAX_VALUE))
        if large:
            values[name] = np.where(np.abs(x) <= MAX_VALUE, x, np.nan)
            notices.append(notice("impossible-values", group.source, variable=name, count=large))
    return (Channels(group.source, time, values) if notices else group), notices


def longest_allowed(time: FloatArray) -> float:
    """Return the longest distance between samples [s] that may be interpolated across."""
    return max(MAX_GAP, MAX_GAP_PERIODS * float(np.median(np.diff(time)))) if time.size > 1 else MAX_GAP


def stretches(time: FloatArray) -> list[slice]:
    """Split samples where the hole between neighbors is too long to interpolate across.

    Parameters
    ----------
    time : (n,) s, increasing

    Returns
    -------
    slices of two samples and more
    """
    cuts = np.flatnonzero(np.diff(time) > longest_allowed(time)) + 1
    return [slice(a, b) for a, b in pairwise([0, *cuts.tolist(), time.size]) if b - a > 1]


def finite(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return times and values (n,) of the samples whose value is finite."""
    good = np.isfinite(values)
    return time[good], values[good]
