"""Velocities that come late are told by the force and attitude that make them, whatever moves the vehicle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.velocity_delay import velocity_delay
from stoop.flight import Flight
from stoop.flight.flight import from_columns

BOUNDS = (-0.1, 0.5)
RATE, FINE, DURATION = 50.0, 1000.0, 80.0
GRAVITY = 9.80665


def wandering(seed: int, size: float, width: float) -> FloatArray:
    """Return a smooth random motion at the fine rate."""
    rng = np.random.default_rng(seed)
    slow = np.convolve(rng.standard_normal(round(DURATION * FINE)), np.hanning(round(width * FINE)), "same")
    return np.asarray(size * slow / np.std(slow))


def flown(late: float, seed: int = 0, noise: float = 0.05, every: int = 10, attitude: float = 0.0) -> Flight:
    """Return a flight in which velocities of a slow receiver are late; `attitude` is an error of its angles, rad.

    The force is what turns a velocity that nobody's model explains into itself, by another library's rotations.
    """
    rng = np.random.default_rng([1, seed])
    velocity = np.column_stack([wandering(10 * seed + k, 2.0, 3.0) for k in range(3)])
    angles = np.column_stack([wandering(10 * seed + 5 + k, 0.2, 2.0) for k in range(3)])
    over_ground = np.gradient(velocity, 1.0 / FINE, axis=0) - [0.0, 0.0, GRAVITY]
    force = Rotation.from_euler("ZYX", angles[:, ::-1]).apply(over_ground, inverse=True)
    rows = np.arange(0, len(force), round(FINE / RATE))
    shift = np.clip(rows - round(late * FINE), 0, len(force) - 1)
    read = velocity[shift] + noise * rng.standard_normal((len(rows), 3))
    time, step = rows / FINE, round(RATE / every)
    slow = np.column_stack([np.interp(time, time[::step], x) for x in read[::step].T])
    felt = force[rows] + 0.1 * rng.standard_normal(slow.shape)
    names = ("vn", "ve", "vd", "ax", "ay", "az", "phi", "theta", "psi")
    values = np.column_stack([slow, felt, angles[rows] + attitude])
    return from_columns("log", time, dict(zip(names, values.T, strict=True)))


@pytest.mark.parametrize(("late", "every"), [(0.0, 5), (0.29, 10), (-0.05, 10), (0.12, 50)])
def test_the_delay_is_found_with_its_error(late: float, every: int) -> None:
    found, error = velocity_delay([flown(late, every=every)], BOUNDS) or (np.nan, np.nan)
    assert error < 0.03
    assert abs(found - late) < 3.0 * error


def test_intervals_hold() -> None:
    each = [velocity_delay([flown(0.15, seed, noise=0.3, every=5)], BOUNDS) for seed in range(1, 21)]
    scores = [(one[0] - 0.15) / one[1] for one in each if one]
    assert len(scores) == 20
    assert sum(abs(z) < 1.96 for z in scores) >= 16  # half a row is in the errors, too


def test_errors_of_attitude_and_accelerometers_that_stay_shift_nothing() -> None:
    found = velocity_delay([flown(0.2, attitude=0.03)], BOUNDS)
    assert found is not None
    assert found[0] == pytest.approx(0.2, abs=0.02)


def test_what_does_not_show_is_not_said() -> None:
    flight = flown(0.2)
    columns = {n: flight.column(n) for n in flight.names}
    short = from_columns("log", flight.time[:500], {n: x[:500] for n, x in columns.items()})
    blind = from_columns("log", flight.time, {n: x for n, x in columns.items() if n != "ax"})
    gaps = {n: np.where(flight.time % 3.0 < 0.1, np.nan, x) for n, x in columns.items()}
    assert velocity_delay([flight], (-0.1, 0.1)) is None  # it is later than all that were tried
    for flights in ([], [short], [blind], [from_columns("log", flight.time, gaps)]):
        assert velocity_delay(flights, BOUNDS) is None
