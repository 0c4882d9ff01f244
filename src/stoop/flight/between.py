"""An attitude that was logged slowly follows the gyros between its samples.

Some logs hold the attitude at 5 Hz and the body rates at 250: a spline through the former cuts the corners of every quick
maneuver. The rates are integrated instead, and what stands between that and the logged attitude, which changes slowly, is
interpolated. At its samples the attitude stays as logged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import conjugate, continuous, euler_angles, normalized, product, quaternions_about
from stoop.base.variables import EULER, QUATERNION
from stoop.flight.channels import Channels, SourceRate
from stoop.flight.grid import Grid, complete, resample
from stoop.flight.segments import runs

SLOW: Final = 20.0  #: Hz; an attitude that is faster is not touched
FASTER: Final = 5.0  #: times, that the rates must have been logged
RATES: Final = ("p", "q", "r")


def following_rates(
    grid: Grid,
    data: Mapping[str, FloatArray],
    sources: Mapping[str, SourceRate],
    channels: Sequence[Channels],
) -> tuple[dict[str, FloatArray], str]:
    """Return the columns with an attitude that follows the rates, and a note; as they are where that helps nothing.

    Parameters
    ----------
    grid : of the columns
    data : variable -> (n,)
    sources : how each was recorded
    channels : as recorded, each on its own clock; the attitude as quaternions or Euler angles
    """
    known = sources.get("q0")
    if known is None or not {*RATES, *QUATERNION} <= data.keys() or not 0.0 < known.rate < SLOW:
        return dict(data), ""
    if min(sources[name].rate for name in RATES) < FASTER * known.rate:
        return dict(data), ""
    logged = next((g for g in channels if set(QUATERNION) <= g.values.keys()), None)
    if logged is None:
        return dict(data), ""
    attitude = _followed(grid, data, logged)
    columns = dict(zip((*QUATERNION, *EULER), [*attitude.T, *euler_angles(attitude).T], strict=True))
    note = f"the attitude was logged at {known.rate:.3g} Hz; between its samples it follows the rates"
    return {name: columns.get(name, x) for name, x in data.items()}, note


def _followed(grid: Grid, data: Mapping[str, FloatArray], logged: Channels) -> FloatArray:
    """Return the attitude (n, 4) on the grid; where the rates are missing it stays as it was."""
    rates = np.column_stack([data[name] for name in RATES])
    out = np.column_stack([data[name] for name in QUATERNION])
    parts = normalized(np.column_stack([logged.values[name] for name in QUATERNION]))
    good = complete(parts)
    time, parts = logged.time[good], parts[good]
    for run in runs(complete(rates)):
        own = grid.time[run]
        inside = (time >= own[0]) & (time <= own[-1])
        if np.count_nonzero(inside) < 2:
            continue
        turned = integrated(rates[run], grid.rate)
        there = normalized(_at(own, turned, time[inside]))
        off = continuous(product(parts[inside], conjugate(there)))
        whole = Grid(grid.first + run.start, run.stop - run.start, grid.rate)
        rest = normalized(resample(whole, time[inside], off, smooth=False))
        found = product(rest, turned)
        known = complete(found) & complete(out[run])
        out[run] = np.where(known[:, None], found, out[run])
    held = complete(out)
    out[held] = continuous(out[held])
    return out


def _at(time: FloatArray, values: FloatArray, wanted: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(wanted, time, column) for column in values.T])


def integrated(rates: FloatArray, rate: float) -> FloatArray:
    """Return the attitude (n, 4) after turning at body rates (n, 3), rad/s, from no rotation.

    The rate of a step is the mean of its ends. Products of ever longer stretches are taken at once, so that a long
    flight takes as many passes as its length has binary digits.
    """
    angle = 0.5 * (rates[1:] + rates[:-1]) / rate
    out = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], quaternions_about(angle)])
    reach = 1
    while reach < len(out):
        out[reach:] = product(out[:-reach], out[reach:])
        reach *= 2
    return continuous(normalized(out))
