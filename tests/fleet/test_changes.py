"""Steps and drifts: a naive twin, the rate of false alarms, and what was flown."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.base.arrays import FloatArray
from stoop_fleet.changes import Change, Readings, changes, peaks, scan, threshold

SPREADS = [(np.inf,), (0.7,), (np.inf, 0.5, 0.8), (0.3, 0.5)]


def readings(rng: np.random.Generator, n: int, spread: tuple[float, ...]) -> Readings:
    """Return a sequence about a level and further effects, each of its own stretch of flights."""
    s, t = rng.uniform(0.5, 2.0, n), np.cumsum(rng.uniform(0.2, 3.0, n))
    part = rng.integers(1, len(spread), n) if len(spread) > 1 else np.zeros(n, dtype=int)
    effects = (part[:, None] == np.arange(len(spread))).astype(float)
    effects[:, 0] = 1.0
    one = Readings(np.zeros(n), s, t, effects, np.array(spread))
    return Readings(one.drawn(1, rng)[0], s, t, effects, one.spread)


def left(A: FloatArray, b: FloatArray, precisions: FloatArray) -> float:
    stacked = np.vstack([A, np.diag(np.sqrt(precisions))])
    target = np.concatenate([b, np.zeros(len(precisions))])
    return float(np.sum((target - stacked @ np.linalg.lstsq(stacked, target, rcond=1e-12)[0]) ** 2))


def naive(one: Readings, t: int) -> float:
    """Return the largest likelihood ratio of the flights up to t by weighted regression."""
    y, s, x = one.values[: t + 1], one.deviations[: t + 1], one.times[: t + 1]
    A, precisions, best = one.effects[: t + 1] / s[:, None], one.spread**-2.0, 0.0
    for k in range(1, t + 1):
        for which, column in enumerate((np.arange(t + 1) >= k, np.clip(x - x[k - 1], 0.0, None))):
            more = np.column_stack([A, column / s])
            if np.linalg.matrix_rank(np.vstack([more, np.diag(np.append(precisions, 0.0))])) == more.shape[1]:
                gain = left(A, y / s, precisions) - left(more, y / s, np.append(precisions, 0.0))
                best = max(best, gain + one.favor[which, k])
    return best


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10**6), st.integers(2, 12), st.sampled_from(SPREADS))
def test_ratios_are_those_of_regressions(seed: int, n: int, spread: tuple[float, ...]) -> None:
    rng = np.random.default_rng(seed)
    one = readings(rng, n, spread)
    if seed % 2:  # what favors a beginning is added
        one = replace(one, onsets=rng.uniform(0.0, 9.0, (2, n)))
    found = scan(one).statistic[0]
    for t in range(1, n):
        assert found[t] == pytest.approx(naive(one, t), rel=1e-6, abs=1e-8)


def test_ratios_with_a_trend_are_those_of_regressions() -> None:
    change = Change("drift", 5, 20, 3.0, 0.1, 50.0)
    after = readings(np.random.default_rng(7), 40, (np.inf, 0.5, 0.8)).since(change)
    assert after.effects.shape == (len(after.values), 4)
    found = scan(after).statistic[0]
    for t in range(1, len(after.values), 5):
        assert found[t] == pytest.approx(naive(after, t), rel=1e-5, abs=1e-7)


def test_the_rate_of_false_alarms_is_the_stated_one() -> None:
    rng, fleets = np.random.default_rng(4), 150
    sequences = [readings(rng, 60, (0.5, 0.4, 0.4)) for _ in range(40)]
    h = threshold(np.concatenate([peaks(one, 100, rng)[1:] for one in sequences]), 100.0)
    alarms = sum(np.sum(scan(one, one.drawn(fleets, rng)).statistic.max(axis=1) > h) for one in sequences)
    # Poisson, with the error of the threshold's own 100 draws
    assert abs(alarms / fleets - 1.0) < 3.0 * np.sqrt(1.0 / fleets + 1.0 / 100)


def flown(y: FloatArray) -> Readings:
    return Readings.about_a_level(y, np.ones(len(y)), np.arange(float(len(y))))


def test_a_step_is_found_where_it_began() -> None:
    rng, n, begun, errors = np.random.default_rng(5), 120, 60, []
    for _ in range(40):
        (only,) = changes(flown(rng.standard_normal(n) + 3.0 * (np.arange(n) >= begun)), 25.0)
        assert (only.found >= begun, only.kind) == (True, "step")
        errors.append(only.first - begun)
        assert abs(only.size - 3.0) < 5.0 * only.error
    assert np.mean(np.abs(errors) <= 1) > 0.8


def test_a_drift_is_one_change() -> None:
    rng, n, begun = np.random.default_rng(5), 120, 60
    (only,) = changes(flown(rng.standard_normal(n) + 0.3 * np.clip(np.arange(n) - begun, 0.0, None)), 25.0)
    assert (only.kind, only.first) == ("drift", pytest.approx(begun, abs=5))
    assert only.interval[0] < 0.3 < only.interval[1]
    times = np.array([0.0, 1.0, 3.0, 4.0])  # a drift begins right after the flight before its first
    for kind, course in (("drift", [0.0, 0.0, 1.0, 1.5]), ("step", [0.0, 0.0, 0.5, 0.5])):
        assert Change(kind, 2, 3, 0.5, 0.1, 9.0).course(times).tolist() == course


def test_a_return_is_a_second_change() -> None:
    t = np.arange(90.0)
    y = np.random.default_rng(6).standard_normal(90) + 5.0 * ((t >= 30) & (t < 60))
    found = list(changes(flown(y), 25.0))
    assert [c.first for c in found] == pytest.approx([30, 60], abs=1)
    assert found[0].size * found[1].size < 0.0


def test_another_part_is_no_change() -> None:
    """A part that differs as parts do explains the step; one that differs far more does not."""
    rng, after = np.random.default_rng(8), np.arange(n := 80) >= 40
    effects = np.column_stack([np.ones(n), ~after, after]).astype(float)
    for size, alarms in ((1.5, 0), (12.0, 1)):
        y = rng.standard_normal(n) + size * after
        one = Readings(y, np.ones(n), np.arange(float(n)), effects, np.array([np.inf, 1.0, 1.0]))
        assert [c.first for c in changes(one, 25.0)] == [40] * alarms


def test_the_rate_holds_with_flights_that_are_favored_and_an_exchange_is_found_sooner() -> None:
    """Parts that differ as parts do, and in the changed vehicle by six standard deviations of that."""
    rng, n, k = np.random.default_rng(11), 80, 40
    after = np.arange(n) >= k
    effects, onsets = np.column_stack([np.ones(n), ~after, after]).astype(float), np.zeros((2, n))
    onsets[:, k] = 10.0, 7.0
    plain = Readings(np.zeros(n), np.ones(n), np.arange(float(n)), effects, np.array([3.0, 0.8, 0.8]))
    found = []
    for one in (plain, replace(plain, onsets=onsets)):
        h = threshold(peaks(one, 4000, rng)[1:], 10.0)
        assert abs(np.sum(peaks(one, 4000, rng)[1:] > h) - 10) < 3.0 * np.sqrt(10.0 + 10.0)
        exchanged = one.drawn(200, rng) + 6.0 * np.sqrt(2.0) * 0.8 * after
        found.append(np.mean(scan(one, exchanged).statistic.max(axis=1) > h))
    assert found[1] > max(found[0], 0.95)


def test_an_alarm_is_withdrawn_where_its_likelihood_ratio_falls_to_less_than_a_tenth() -> None:
    for after, kept in ((1.4, True), (0.0, False)):
        values = np.concatenate([np.zeros(30), np.full(5, 3.0), np.full(8, after)])
        own = Readings.about_a_level(values, np.ones(values.size), np.arange(float(values.size)), 1.0)
        statistic = scan(own).statistic[0]
        limit = float(statistic.max()) - 0.5
        assert (statistic[-1] < limit, statistic[-1] > limit - 2.0 * np.log(10.0)) == (True, kept)
        assert bool(list(changes(own, limit))) == kept
