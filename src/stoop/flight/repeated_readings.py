"""Slow readings in fast rows: held until the next one, or interpolated to it, they count where they were taken.

A table has one row for every instant, whatever the rates of its sensors. Between two readings of a slow sensor recorders
repeat the last one or draw a straight line. Both are told from a sensor that was read in every row by what a row adds:

- a *held* column stands still and then jumps; a slowly changing quantity that is quantized stands still as well, but then moves
  by a single step of its resolution,
- an *interpolated* column has a second difference of zero, within its resolution, but at the readings,

and the rows that add something are never closer than the period of the sensor.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import EULER, QUATERNION, VARIABLES
from stoop.flight.gridding import Channels


class Limits:
    """When rows are told to repeat slower readings."""

    readings: Final = 20  #: at least
    #: of the intervals between readings, that are a period long at least, within a row
    regular: Final = 0.95
    #: steps of the resolution (bends that rounding may make), beyond which a change is none of a quantity that moved slowly
    step: Final = 1.5
    #: of the changes (bends), that must exceed it
    jumps: Final = 0.5
    #: steps of the resolution, by which rounding may bend a straight line
    rounding: Final = 2.5


Rows = Callable[[FloatArray, FloatArray], IntArray]


def _changes(x: FloatArray) -> IntArray:
    """Return the rows at which a column (n,) without gaps changes."""
    return np.flatnonzero(np.diff(x)) + 1


def held(_: FloatArray, x: FloatArray) -> IntArray:
    """Return the rows of readings (n,) at which a column jumps after it stood still; empty where it moves by single steps."""
    rows = _changes(x)
    sizes = np.abs(x[rows] - x[rows - 1])
    if not rows.size or np.mean(sizes > Limits.step * sizes.min()) < Limits.jumps:
        return rows[:0]
    return rows


def knots(time: FloatArray, x: FloatArray) -> IntArray:
    """Return the rows at which a column (n,) at times (n,) bends; empty where rounding alone bends it."""
    values = np.unique(x)
    if len(values) < Limits.readings:
        return np.empty(0, dtype=np.intp)
    resolution, steps = float(np.diff(values).min()), np.diff(time)
    bends = np.abs(np.diff(np.diff(x) / steps)) * np.minimum(steps[1:], steps[:-1])
    tolerance = Limits.rounding * max(resolution, 4.0 * float(np.spacing(np.abs(values).max())))
    rows = np.flatnonzero(bends > tolerance) + 1
    # a straight line takes two rows between its ends; a curve bends by little more than rounding wherever it does
    drawn = rows.size and np.mean(bends[rows - 1] > Limits.step * tolerance) >= Limits.jumps
    return rows if drawn and _period(rows) >= 3.0 else rows[:0]


def _period(rows: IntArray) -> float:
    """Return the usual interval of rows; 1 with fewer than two."""
    return float(np.median(np.diff(rows))) if len(rows) > 1 else 1.0


def regular(rows: IntArray) -> bool:
    """Tell whether rows are those of a sensor of a slower rate: hardly ever closer than its period."""
    if len(rows) < Limits.readings or (period := _period(rows)) < 2.0:
        return False
    return bool(np.mean(np.diff(rows) >= max(2.0, period - 1.0)) >= Limits.regular)


def at_own_rates(group: Channels) -> tuple[list[Channels], list[Notice]]:
    """Return channels that share the rows of a table, each at the rows in which it was read, and what was found.

    Columns that were read together are told together, so that a reading that happens to repeat the last one counts. Commands
    hold until the next one and stay as they are, and so does an attitude of which not every angle is slow.
    """
    slow: list[tuple[list[str], IntArray]] = []
    measured = {n: x for n, x in group.values.items() if VARIABLES[n].kind == "measurement"}
    for name, x in measured.items():
        rows = _readings(group.time, x)
        if rows is not None and not _joined(slow, name, rows, _period(rows)):
            slow.append(([name], rows))
    attitude = {*EULER, *QUATERNION} & group.values.keys()  # which is taken whole or not at all
    slow = [one for one in slow if not attitude & {*one[0]} or attitude <= {*one[0]}]
    taken = {name for names, _ in slow for name in names}
    for name in [n for n in measured if n not in {*taken, *EULER, *QUATERNION}]:
        # one that moved by single steps only, in the rows in which another of its sensor was read
        good = np.flatnonzero(np.isfinite(measured[name]))
        changed = good[_changes(measured[name][good])]
        if len(changed) >= Limits.readings and _joined(slow, name, changed):
            taken.add(name)
    left = {name: x for name, x in group.values.items() if name not in taken}
    found = [Channels(group.source, group.time, left)] if left else []
    found += [
        Channels(group.source, group.time[rows], {name: group.values[name][rows] for name in names})
        for names, rows in slow
    ]
    rates = [(tuple(names), 1.0 / float(np.median(np.diff(group.time[rows])))) for names, rows in slow]
    told = [notice("readings-repeated", group.source, variables=n, rate=r, rows=group.rate) for n, r in rates]
    return found, told


def _readings(time: FloatArray, x: FloatArray) -> IntArray | None:
    """Return the rows in which a column (n,) was read; None where that is every row."""
    good = np.flatnonzero(np.isfinite(x))
    for find in (held, knots):
        if len(good) > Limits.readings and regular(rows := find(time[good], x[good])):
            return np.asarray(good[rows])
    return None


def _joined(slow: list[tuple[list[str], IntArray]], name: str, rows: IntArray, period: float = 0.0) -> bool:
    """Add a column to the slowest sensor that was read in its rows, if there is one; tell whether there is."""
    for i in sorted(range(len(slow)), key=lambda i: len(slow[i][1])):
        names, own = slow[i]
        both = np.union1d(own, rows)
        # two sensors out of step would make one that is faster than either
        if regular(both) and _period(both) >= max(_period(own), period) - 0.5:
            slow[i] = ([*names, name], both)
            return True
    return False
