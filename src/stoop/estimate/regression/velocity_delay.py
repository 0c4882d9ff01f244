"""Delay of velocities over ground: what they changed by against the specific force and attitude that were measured.

The specific force, turned by the attitude, and gravity make the acceleration over ground, whatever moves the vehicle: gusts,
which a model of its forces takes for delays, are in both. In each stretch of the record the integral of the acceleration, so
much earlier, is compared with the velocity; a constant and a slope, for the start and for errors of attitude and accelerometers,
are free. Delays are compared by their likelihoods, concentrated in the variance of each axis; the standard error is
that between stretches, by the jackknife.

References
----------
R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., AIAA, 2015, chapter 10 (flight path reconstruction).
B. Efron and C. Stein, "The jackknife estimate of variance", *Annals of Statistics* 9(3), 1981, pp. 586-596.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from scipy.integrate import cumulative_trapezoid

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of, to_ground
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import EULER, SPECIFIC_FORCE, VELOCITY
from stoop.flight import Flight
from stoop.vehicle.delays import delayed

STRETCH: Final = 4.0  #: s
STRETCHES: Final = 8  #: that are compared, at least
STEP: Final = 0.01  #: s, of the delays that are tried


def velocity_delay(flights: Iterable[Flight], bounds: tuple[float, float]) -> tuple[float, float] | None:
    """Return by how much velocities are later than inertial sensors, and its standard error, s; None where it does not show.

    `bounds` are the least and greatest delay that are tried; one that is likeliest does not show.
    """
    delays = np.arange(bounds[0], bounds[1] + 0.5 * STEP, STEP)
    flown = [one for one in flights if {*EULER, *SPECIFIC_FORCE, *VELOCITY} <= one.names]
    each = [squares for one in flown for squares in _stretches(one, delays)]
    if len(each) < STRETCHES:
        return None
    squares = np.array(each)
    best = _likeliest(delays, squares.sum(axis=0))
    without = [_likeliest(delays, squares.sum(axis=0) - one) for one in squares]
    count, spread = len(without), float(np.std(without))
    period = max(1.0 / one.rate for one in flown)  # in which a reading was taken
    error = float(np.hypot(np.sqrt(count - 1.0) * spread, 0.5 * period))
    return (best, error) if delays[0] < best < delays[-1] else None


def _stretches(flight: Flight, delays: FloatArray) -> Iterator[FloatArray]:
    """Yield the squared errors (m, 3) of velocities by m delays, stretch for stretch without a gap."""
    groups = (EULER, SPECIFIC_FORCE, VELOCITY)
    angles, force, velocity = (np.column_stack([flight.column(n) for n in names]) for names in groups)
    acceleration = to_ground(quaternions_of(angles), force) + np.array([0.0, 0.0, STANDARD_GRAVITY])
    felt = np.isfinite(acceleration).all(axis=1)
    moved = cumulative_trapezoid(np.nan_to_num(acceleration), dx=1.0 / flight.rate, axis=0, initial=0)
    size, reach = round(STRETCH * flight.rate), round(np.abs(delays).max() * flight.rate) + 2
    line = np.linalg.qr(np.vander(np.arange(size), 2).astype(np.float64))[0]
    for first in range(reach, len(felt) - size - reach, size):
        own = slice(first, first + size)
        around = slice(first - reach, own.stop + reach)
        if felt[around].all() and np.isfinite(velocity[own]).all():
            late = [delayed(moved[around], d * flight.rate)[reach : reach + size] for d in delays]
            left = velocity[own, None] - np.stack(late, axis=1)
            left = left - np.tensordot(line, np.tensordot(line, left, (0, 0)), (1, 0))
            yield np.sum(left**2, axis=0)


def _likeliest(delays: FloatArray, squares: FloatArray) -> float:
    """Return the likeliest delay, between those that were tried by a parabola."""
    cost = np.sum(np.log(np.maximum(squares, np.finfo(float).tiny)), axis=1)
    k = int(np.argmin(cost))
    if k in (0, len(delays) - 1):
        return float(delays[k])
    before, here, after = cost[k - 1 : k + 2].tolist()
    return float(delays[k] + 0.5 * STEP * (before - after) / (before - 2.0 * here + after))
