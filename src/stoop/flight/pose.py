"""Motion of a vehicle whose position and attitude alone were recorded, by motion capture, in still air.

Local cubic polynomials give velocity, rates and accelerations. They serve to find maneuvers, to check frames and to begin a
search; a fit compares the pose itself, since the errors of derivatives depend on each other from sample to sample.

References
----------
.. [1] Savitzky, Golay, "Smoothing and differentiation of data by simplified least squares procedures", Analytical
   Chemistry 36 (1964) 1627.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter

from stoop.base.arrays import BoolArray, FloatArray, run_slices
from stoop.base.notices import Notice, notice
from stoop.base.rotations import conjugate, normalized, product, quaternions_of, to_body
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import EULER, POSITION, QUATERNION, RATES, SPECIFIC_FORCE, VARIABLES, VELOCITY
from stoop.flight.flight import Flight, Gridded
from stoop.flight.gridding import Channels, complete, longest_allowed

DIFFERENTIATED: Final = "pose, differentiated"  #: source of motion that follows from the pose
AIR: Final = ("V", "alpha", "beta")
JUMP: Final = 6.0  #: times the usual step
NEIGHBORS: Final = 11  #: steps of which the median is the usual one
SHORTEST_JUMP: Final = 0.02  #: m
SMALLEST_TURN: Final = 0.1  #: rad
LOST_TIME: Final = 0.25  #: s between two jumps, that is not believed
HALF_WINDOW: Final = 0.08  #: s on either side of a sample
DEGREE: Final = 3  #: of the polynomials


def with_motion(flight: Flight) -> Flight:
    """Return a flight of which nothing but the pose was recorded with velocity, flow angles, rates and specific force.

    Rates that a gyro measured stay; where there are accelerometers, or any velocity, the flight is returned as it is.
    """
    there = flight.names
    if not {*POSITION, *QUATERNION} <= there or not pose_alone(there):
        return flight
    position, attitude = (np.column_stack([flight.column(n) for n in own]) for own in (POSITION, QUATERNION))
    found = motion(position, attitude, flight.rate)
    added = {name: x for name, x in found.items() if name not in there}
    columns = {name: flight.column(name) for name in there} | added
    source = replace(flight.sources["pn"], source=DIFFERENTIATED, readings=(), derived=True)
    return replace(
        flight,
        data=Gridded(flight.time, {name: columns[name] for name in VARIABLES if name in columns}),
        sources={**flight.sources, **dict.fromkeys(added, source)},
        notices=(*flight.notices, notice("motion-of-pose", flight.sources["pn"].source)),
    )


def pose_alone(names: Set[str]) -> bool:
    """Tell whether channels hold no motion but pose and rates: neither a velocity nor a specific force."""
    return not names & {*VELOCITY, *AIR, *SPECIFIC_FORCE, "airspeed_pitot"}


def without_jumps(group: Channels) -> tuple[Channels, list[Notice]]:
    """Take a pose as lost about jumps: where tracking fails, it stays, or is that of other markers, until it is found again.

    A jump is a step many times as long as those about it. Between two of them, that are near each other, nothing is kept.
    """
    angles = next((names for names in (QUATERNION, EULER) if set(names) <= group.values.keys()), ())
    if not angles or not set(POSITION) <= group.values.keys() or group.time.size < 2 * NEIGHBORS:
        return group, []
    q = np.column_stack([group.values[name] for name in angles])
    q = normalized(q) if angles == QUATERNION else quaternions_of(q)
    turned = 2.0 * np.linalg.norm(product(conjugate(q[:-1]), q[1:])[:, 1:], axis=1)
    position = np.column_stack([group.values[name] for name in POSITION])
    moved = np.linalg.norm(np.diff(position, axis=0), axis=1)
    jumps = _isolated(moved, SHORTEST_JUMP) | _isolated(turned, SMALLEST_TURN)
    if not jumps.any():
        return group, []
    time, at = group.time, np.flatnonzero(jumps)
    # so wide that no sample of a grid is interpolated across
    wide = int(np.ceil(0.5 * longest_allowed(time) / float(np.median(np.diff(time))))) + 1
    at_samples = np.concatenate([jumps, [False]]).astype(np.int8)
    lost = maximum_filter1d(at_samples, 2 * wide + 1, mode="constant") > 0
    for a, b in pairwise(at):
        lost[a : b if time[b] - time[a] < LOST_TIME else a] = True
    kept = {n: np.where(lost, np.nan, x) if n in (*POSITION, *angles) else x for n, x in group.values.items()}
    found = notice("pose-jumps", group.source, count=int(jumps.sum()), first=float(time[1:][jumps][0]))
    return Channels(group.source, time, kept), [found]


def _isolated(steps: FloatArray, least: float) -> BoolArray:
    """Return which steps (n,) are longer than `least` and many times as long as the median of those about them.

    Where that is zero, readings are held from row to row, and steps tell nothing.
    """
    usual = median_filter(np.nan_to_num(steps), NEIGHBORS, mode="nearest")
    return np.asarray((usual > 0.0) & (steps > JUMP * usual + least))


def motion(position: FloatArray, attitude: FloatArray, rate: float) -> Mapping[str, FloatArray]:
    """Return velocity over ground, motion through still air, body rates and specific force of a pose.

    Parameters
    ----------
    position : (n, 3), north, east, down, m; NaN where it was lost
    attitude : (n, 4), continuous quaternions from body to Earth axes
    rate : Hz, of the samples

    Returns
    -------
    vn, ve, vd, V, alpha, beta, p, q, r, ax, ay, az : (n,), SI
    """
    velocity, acceleration = _slope(position, rate), _slope(position, rate, 2)
    turning = 2.0 * product(conjugate(attitude), _slope(attitude, rate))[:, 1:]
    force = to_body(attitude, acceleration - [0.0, 0.0, STANDARD_GRAVITY])
    u, v, w = to_body(attitude, velocity).T
    speed = np.sqrt(u**2 + v**2 + w**2)
    angles = np.arctan2(w, u), np.arctan2(v, np.hypot(u, w))
    columns = [*velocity.T, speed, *angles, *turning.T, *force.T]
    return dict(zip((*VELOCITY, *AIR, *RATES, *SPECIFIC_FORCE), columns, strict=True))


def _slope(values: FloatArray, rate: float, order: int = 1) -> FloatArray:
    """Return a derivative (n, k) of samples by local polynomials; NaN where too few are together."""
    from scipy.signal import savgol_filter

    out, half = np.full_like(values, np.nan), max(2, round(HALF_WINDOW * rate))
    for run in run_slices(complete(values)):
        size = min(2 * half + 1, run.stop - run.start - 1 + (run.stop - run.start) % 2)
        if size > DEGREE:
            out[run] = savgol_filter(values[run], size, DEGREE, deriv=order, delta=1.0 / rate, axis=0)
    return out
