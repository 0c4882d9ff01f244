"""Interpolation of an attitude that was logged slowly, by the body rates between its samples.

Some logs hold the attitude at 5 Hz and the body rates at 250 Hz: a spline through the attitude cuts the corners of every
quick maneuver. The rates are integrated instead; the slowly changing rotation between the integral and the logged
attitude is interpolated linearly. At its samples the attitude stays as logged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, run_slices
from stoop.base.notices import Notice, notice
from stoop.base.rotations import conjugate, continuous, euler_angles, normalized, product, quaternions_about
from stoop.base.variables import EULER, QUATERNION, RATES
from stoop.flight.channels import Channels, SourceRate
from stoop.flight.gridding import Grid, complete, resample

MAX_ATTITUDE_RATE: Final = 20.0  #: Hz; an attitude that is faster is not touched
MIN_RATIO: Final = 5.0  #: of the rate of the gyros over that of the attitude


def interpolate_by_rates(
    grid: Grid,
    data: Mapping[str, FloatArray],
    sources: Mapping[str, SourceRate],
    channels: Sequence[Channels],
) -> tuple[dict[str, FloatArray], list[Notice]]:
    """Return the columns with an attitude that follows the rates, and a notice; as they are where that helps nothing.

    Parameters
    ----------
    grid : of the columns
    data : variable -> (n,)
    sources : how each was recorded
    channels : as recorded, each on its own clock; the attitude as a quaternion
    """
    known = sources.get("q0")
    logged = next((g for g in channels if set(QUATERNION) <= g.values.keys()), None)
    if (
        known is None
        or logged is None
        or not {*RATES, *QUATERNION} <= data.keys()
        or not 0.0 < known.rate < MAX_ATTITUDE_RATE
        or min(sources[name].rate for name in RATES) < MIN_RATIO * known.rate
    ):
        return dict(data), []
    rates = np.column_stack([data[name] for name in RATES])
    out = np.column_stack([data[name] for name in QUATERNION])
    parts = normalized(np.column_stack([logged.values[name] for name in QUATERNION]))
    good = complete(parts)
    time, parts = logged.time[good], parts[good]
    for run in run_slices(complete(rates)):
        own = grid.time[run]
        inside = (time >= own[0]) & (time <= own[-1])
        if np.count_nonzero(inside) < 2:
            continue
        turned = integrate_rates(rates[run], grid.rate)
        there = normalized(np.column_stack([np.interp(time[inside], own, column) for column in turned.T]))
        offset = continuous(product(parts[inside], conjugate(there)))
        part = Grid(grid.first + run.start, run.stop - run.start, grid.rate)
        found = product(normalized(resample(part, time[inside], offset, smooth=False)), turned)
        valid = complete(found) & complete(out[run])
        out[run] = np.where(valid[:, None], found, out[run])
    valid = complete(out)
    out[valid] = continuous(out[valid])
    columns = dict(zip((*QUATERNION, *EULER), [*out.T, *euler_angles(out).T], strict=True))
    return {name: columns.get(name, x) for name, x in data.items()}, [
        notice("attitude-follows-rates", logged.source, rate=known.rate)
    ]


def integrate_rates(rates: FloatArray, rate: float) -> FloatArray:
    """Return the attitude (n, 4) after turning at body rates (n, 3), rad/s, from no rotation.

    The rate of a step is the mean of its ends. Products of ever longer stretches are taken at once, so that a long
    flight takes as many passes as its length has binary digits.

    Parameters
    ----------
    rates : (n, 3) rad/s
    rate : Hz, of the samples
    """
    angle = 0.5 * (rates[1:] + rates[:-1]) / rate
    out = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], quaternions_about(angle)])
    reach = 1
    while reach < len(out):
        out[reach:] = product(out[:-reach], out[reach:])
        reach *= 2
    return continuous(normalized(out))
