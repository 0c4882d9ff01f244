"""Domains and the choice of terms against sums, brute force and known sets; velocities that come late are told."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive.regression import double_sum, transform
from scipy.spatial.transform import Rotation

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.least_squares import FrequencyDomain, TimeDomain, fourier_transform
from stoop.estimate.regression.velocity_delay import velocity_delay
from stoop.flight import Flight
from stoop.flight.flight import from_columns


def test_the_transform_is_the_sum() -> None:
    signals, frequencies = np.random.default_rng(2).standard_normal((80, 2)), np.array([0.3, 0.7, 1.1, 1.5])
    expected = [[transform(signal, f, 0.05) for signal in signals.T] for f in frequencies]
    np.testing.assert_allclose(fourier_transform(signals, frequencies, 0.05), expected, atol=1e-11)


@settings(max_examples=30, deadline=None)
@given(st.floats(-5.0, 5.0), st.floats(-2.0, 2.0))
def test_a_band_sees_neither_bias_nor_drift(bias: float, drift: float) -> None:
    t = 0.02 * np.arange(500)
    signal = np.sin(5.0 * t)
    plain, moved = (FrequencyDomain().rows(s[:, None], 0.02) for s in (signal, signal + bias + drift * t))
    np.testing.assert_allclose(moved, plain, atol=1e-9)


def test_noise_keeps_its_variance_in_a_band() -> None:
    v = np.random.default_rng(0).standard_normal((1000, 200))
    assert np.var(FrequencyDomain(0.1, 5.0).rows(v, 0.02)) == pytest.approx(1.0, rel=0.03)


def test_frequencies_lie_one_over_the_record_apart() -> None:
    f = FrequencyDomain(0.1, 2.0).frequencies(500, 0.02)
    assert np.diff(f) == pytest.approx(0.1)
    assert (f[0], FrequencyDomain(0.0, 2.0).frequencies(500, 0.02)[0]) == pytest.approx((0.1, 0.1))
    assert f[-1] <= 2.0 + 1e-9


def test_the_spread_is_the_double_sum_and_for_white_residuals_in_a_band_the_normal_matrix() -> None:
    rng = np.random.default_rng(1)
    v, X = np.convolve(rng.standard_normal(64), [1.0, 0.7, 0.3], "same"), rng.standard_normal((64, 3))
    summed = double_sum(X, v, 12)  # a fifth of the rows
    np.testing.assert_allclose(TimeDomain(span=0.01).scatter(X, v, 0.02), summed, rtol=1e-9)
    np.testing.assert_allclose(FrequencyDomain().scatter(X, v, 0.02), X.T @ X * np.mean(v**2))


BOUNDS = (-0.1, 0.5)
DELAYED = [(0.0, 5, 0.0), (0.29, 10, 0.0), (-0.05, 10, 0.0), (0.12, 50, 0.0), (0.2, 10, 0.03)]
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


@pytest.mark.parametrize(("late", "every", "attitude"), DELAYED)
def test_the_delay_is_found_with_its_error(late: float, every: int, attitude: float) -> None:
    """Errors of attitude and accelerometers that stay shift nothing."""
    found, error = velocity_delay([flown(late, every=every, attitude=attitude)], BOUNDS) or (np.nan, np.nan)
    assert error < 0.03
    assert abs(found - late) < min(3.0 * error, 0.02)


def test_intervals_hold() -> None:
    each = [velocity_delay([flown(0.15, seed, noise=0.3, every=5)], BOUNDS) for seed in range(1, 21)]
    scores = [(one[0] - 0.15) / one[1] for one in each if one]
    assert len(scores) == 20
    assert sum(abs(z) < 1.96 for z in scores) >= 16  # half a row is in the errors, too


def test_what_does_not_show_is_not_said() -> None:
    flight = flown(0.2)
    columns = {n: flight.column(n) for n in flight.names}
    short = from_columns("log", flight.time[:500], {n: x[:500] for n, x in columns.items()})
    blind = from_columns("log", flight.time, {n: x for n, x in columns.items() if n != "ax"})
    gaps = {n: np.where(flight.time % 3.0 < 0.1, np.nan, x) for n, x in columns.items()}
    assert velocity_delay([flight], (-0.1, 0.1)) is None  # it is later than all that were tried
    for flights in ([], [short], [blind], [from_columns("log", flight.time, gaps)]):
        assert velocity_delay(flights, BOUNDS) is None
