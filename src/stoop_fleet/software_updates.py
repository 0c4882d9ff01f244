"""Updates of the software that changed a figure of several vehicles alike.

The step of each vehicle with the update, between the updates before and after it, is combined with those of the others by a
random-effects mean, its error by how they differ ([1]_); Student's t tells whether it is none. A step of one vehicle alone
changes no mean beyond its error: that is a change of this vehicle.

References
----------
.. [1] J. Hartung, G. Knapp, "A refined method for the meta-analysis of controlled clinical trials with binary outcome",
   Statistics in Medicine 20 (2001) 3875.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import t

from stoop.extend.arrays import FloatArray
from stoop_fleet.causes import Stretch, updates
from stoop_fleet.changes import Readings, sizes
from stoop_fleet.table import FigureTable

FEWEST: Final = 3  #: vehicles
CHANCE: Final = 0.01  #: that of all updates and figures one is told which changed nothing


@dataclass(frozen=True)
class CommonStep:
    """What an update changed in a figure of the vehicles that had it.

    Attributes
    ----------
    before, after : versions
    size, error : mean step and its standard error, unit of the figure; NaN of fewer than `FEWEST` vehicles
    chance : probability of one as large where the update changes nothing
    began, found : s since 1970: when the first vehicle flew with it, and when the last one that was needed to tell
    """

    before: str
    after: str
    size: float
    error: float
    chance: float
    began: float
    found: float


def common_steps(sequences: Mapping[str, tuple[FigureTable, Readings]]) -> list[CommonStep]:
    """Return the mean step of every update of a figure, in the order in which they began."""
    steps: dict[tuple[str, str], list[FloatArray]] = defaultdict(list)
    for rows, readings in sequences.values():
        for versions, step in _steps(rows, readings):
            steps[versions].append(step)
    found = [_mean(*versions, np.array(own)) for versions, own in steps.items()]
    return sorted(found, key=lambda one: one.began)


def _steps(rows: FigureTable, readings: Readings) -> Iterator[tuple[tuple[str, str], FloatArray]]:
    """Yield the versions of each update of a vehicle, and time (s since 1970), size and variance when it first had it."""
    every = [*updates(rows)]
    limits = [-np.inf, *(float(rows.time[k]) for k, *_ in every), np.inf]
    told = set[tuple[str, str]]()
    for (k, before, after), begin, end in zip(every, limits, limits[2:], strict=False):
        pair, own = (before, after), Stretch(rows, readings).between(begin, end)
        if own is not None and pair not in told:
            told.add(pair)
            size, variance = sizes(own.readings, "step")
            place = k - 1 - int(np.searchsorted(rows.time, begin))
            yield pair, np.array([rows.time[k], size[place], variance[place]])


def _mean(before: str, after: str, steps: FloatArray) -> CommonStep:
    """Return the mean of steps (n, 3), see `_steps`."""
    times, size, variance = steps[np.isfinite(steps[:, 2])].T
    began, *_ = np.sort(steps[:, 0])
    if len(times) < FEWEST:
        return CommonStep(before, after, np.nan, np.nan, 1.0, float(began), float(began))
    weights = 1.0 / variance
    mean = float(weights @ size / weights.sum())
    free = len(times) - 1
    scatter = max(float(weights @ (size - mean) ** 2) / free, 1.0)  # no less than by the known errors
    error = float(np.sqrt(scatter / weights.sum()))
    chance = 2.0 * float(t.sf(abs(mean) / error, free))
    return CommonStep(before, after, mean, error, chance, float(began), float(np.sort(times)[FEWEST - 1]))


def significant(steps: Mapping[str, Sequence[CommonStep]]) -> dict[str, list[CommonStep]]:
    """Return the steps of each figure that are none by chance, by the number of all of them (Bonferroni)."""
    tests = max(sum(one.error > 0.0 for own in steps.values() for one in own), 1)
    return {figure: [one for one in own if one.chance * tests < CHANCE] for figure, own in steps.items()}


def version_levels(steps: Sequence[CommonStep], changed: Sequence[CommonStep]) -> dict[str, int]:
    """Return the level of each version: a further one where its update changed the figure, else that of the version before."""
    out: dict[str, int] = {}
    for one in steps:
        before = out.setdefault(one.before, 0)
        out.setdefault(one.after, max(out.values()) + 1 if one in changed else before)
    return out
