"""Domains and the choice of terms against sums, brute force and known sets; velocities that come late are told."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive.regression import best_subset, double_sum, press, rss, transform
from scipy.spatial.transform import Rotation

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.least_squares import FrequencyDomain, TimeDomain, fourier_transform
from stoop.estimate.regression.velocity_delay import velocity_delay
from stoop.flight import Flight
from stoop.flight.flight import from_columns
from stoop.vehicle import terms
from stoop_analysis import structure
from stoop_analysis.structure import Model, Regression, orthogonal, stepwise


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


def rows(y: np.ndarray, X: np.ndarray) -> Regression:
    """Return a regression whose residuals count as white."""
    return Regression(y, X, (slice(0, len(y)),), 1.0, FrequencyDomain())


def drawn(seed: int, n: int = 120, k: int = 8) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((n, k)) @ (np.eye(k) + 0.3 * rng.standard_normal((k, k)))
    return rng.standard_normal(n), X


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_press_is_the_sum_of_squares_of_rows_left_out(seed: int) -> None:
    y, X = drawn(seed, 25, 4)
    assert Model(rows(y, X), (0, 1, 3)).press == pytest.approx(press(y, X[:, [0, 1, 3]]), rel=1e-9)


def test_the_partial_f_is_the_square_of_students_t() -> None:
    y, X = drawn(3)
    columns = (0, 1, 5)
    inverse = np.linalg.inv(X[:, columns].T @ X[:, columns])
    estimate = inverse @ X[:, columns].T @ y
    variance = rss(y, X[:, columns]) / (len(y) - 3) * np.diag(inverse)
    found = [Model(rows(y, X), columns).partial_f(c) for c in columns]
    np.testing.assert_allclose(found, estimate**2 / variance, rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_clear_set_is_found(seed: int) -> None:
    noise, X = drawn(seed)
    y = X[:, [1, 4, 6]] @ [3.0, -2.0, 4.0] + 0.1 * noise
    assert tuple(sorted(stepwise(rows(y, X)).model.columns)) == (1, 4, 6) == best_subset(y, X, 3)
    assert {1, 4, 6} <= set(orthogonal(rows(y, X)).model.columns)  # which takes nothing back


def test_terms_that_cancel_are_found_on_the_way_down() -> None:
    """Alone none of the three explains a thing; the way up from nothing stops at once."""
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((2, 150))
    small = 0.25 * rng.standard_normal(150)
    X = np.column_stack([a, b, -(a + b) + small, *rng.standard_normal((3, 150))])
    y = X[:, :3].sum(axis=1) + 0.01 * rng.standard_normal(150)
    assert sorted(stepwise(rows(y, X)).model.columns) == [0, 1, 2]


def test_chance_alone_brings_in_a_term_as_seldom_as_is_said() -> None:
    """A significance of 0.2 among six candidates: Bonferroni holds it to at most 0.2, and to little less."""
    rule = structure.PartialF(0.2)
    hits = sum(bool(stepwise(rows(*drawn(seed, 60, 6)), rule).model.columns) for seed in range(150))
    assert 0.08 * 150 < hits < 0.28 * 150


def test_products_and_powers_stand_on_their_variables() -> None:
    known = {"alpha", "beta", "q", "elevator", "rudder"}
    plain = ("alpha^3", "alpha", "elevator", "alpha*elevator", "beta^2", "abs(alpha)", "2*alpha")
    found = structure.parents([terms.parse(name, known, "test") for name in (*plain, "rudder*elevator")])
    assert found == ((1,), (), (), (1, 2), (), (), (), (2,))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_nothing_is_chosen_without_what_it_stands_on(seed: int) -> None:
    noise, X = drawn(seed, 60, 3)
    columns = np.column_stack([X, X[:, 0] ** 2, X[:, 1] ** 3, X[:, 0] * X[:, 2]])
    y = columns @ np.random.default_rng(seed).choice([0.0, 1.0], 6) + noise
    data = replace(rows(y, columns), parents=((), (), (), (0,), (1,), (0, 2)))
    for criterion in (stepwise, orthogonal, lambda r: stepwise(r, structure.Press())):
        model = criterion(data).model
        assert all(set(data.parents_of(c)) <= set(model.columns) for c in model.columns)


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
