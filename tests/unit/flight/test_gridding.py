"""The grid: filtered as theory says, exact where nothing is to be done, silent in gaps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from stoop.base.arrays import FloatArray
from stoop.errors import FlightError
from stoop.flight.gridding import (
    CUTOFF,
    GRID_RATES,
    ORDER,
    SAME_RATE,
    Channels,
    Grid,
    grid_channels,
    grid_rate,
    longest_allowed,
    low_pass,
    make_grid,
    resample,
    source_rate,
    stretches,
)

steps = st.lists(st.sampled_from([0.003, 0.01, 0.02, 0.049, 0.051, 0.3]), min_size=1, max_size=60)


def times(gaps: list[float]) -> FloatArray:
    return 1.0 + np.concatenate([[0.0], np.cumsum(gaps)])


def in_gap_naively(point: float, time: FloatArray, limit: float) -> bool:
    """Look at each pair of neighbors; also outside the record, and beside a lonely sample."""
    return not any(a - 1e-6 <= point <= b + 1e-6 and b - a <= limit for a, b in pairwise(time))


@settings(deadline=None)
@given(steps)
def test_no_value_in_a_gap_and_a_value_everywhere_else(gaps: list[float]) -> None:
    time = times(gaps)
    assume(time[-1] - time[0] > 0.02)  # else it has less than two points
    grid = make_grid(time[0], time[-1], 100.0, 1, "f")
    out = resample(grid, time, np.sin(time)[:, None], smooth=False)[:, 0]
    limit = max(0.05, 2.5 * float(np.median(np.diff(time))))
    assert limit == longest_allowed(time)
    assert np.array_equal(np.isnan(out), [in_gap_naively(t, time, limit) for t in grid.time])


@given(steps)
def test_stretches_hold_every_sample_that_has_a_near_neighbor(gaps: list[float]) -> None:
    time = times(gaps)
    parts = stretches(time)
    limit = longest_allowed(time)
    covered = np.zeros(time.size, dtype=bool)
    for part in parts:
        assert np.all(np.diff(time[part]) <= limit)
        covered[part] = True
    near = np.concatenate([np.diff(time) <= limit, [False]]) | np.concatenate(
        [[False], np.diff(time) <= limit]
    )
    assert np.array_equal(covered, near)
    described = source_rate("x", time)
    assert described.gaps == np.sum(np.diff(time) > limit)
    assert described.longest_gap == np.max(np.diff(time))


def amplitude(frequency: float, recorded: float, smooth: bool = True) -> tuple[float, float]:
    """Return in-phase and quadrature amplitude of a sine on the grid, at its own frequency."""
    time = np.arange(0.0, 12.0, 1.0 / recorded)
    grid = make_grid(0.0, time[-1], 100.0, 1, "f")
    out = resample(grid, time, np.sin(2 * np.pi * frequency * time)[:, None], smooth=smooth)[:, 0]
    inside = (grid.time > 2.0) & (grid.time < 10.0)
    t = grid.time[inside]
    design = np.column_stack([np.sin(2 * np.pi * frequency * t), np.cos(2 * np.pi * frequency * t)])
    fit = np.linalg.lstsq(design, out[inside], rcond=None)[0]
    return float(fit[0]), float(fit[1])


@pytest.mark.parametrize("frequency", [1.0, 5.0, 10.0, 20.0, 30.0, 41.0, 80.0, 95.0, 120.0])
def test_the_low_pass_weakens_as_a_butterworth_run_both_ways(frequency: float) -> None:
    fine = 800.0
    wave, phase = amplitude(frequency, fine)
    warped = np.tan(np.pi * frequency / fine) / np.tan(np.pi * CUTOFF * 100.0 / fine)
    theory = 1.0 / (1.0 + warped ** (2 * ORDER))
    assert abs(wave - theory) < 1e-5
    assert abs(phase) < 1e-3


def test_what_would_alias_onto_10_hz_is_gone() -> None:
    for frequency in (90.0, 110.0, 190.0):
        assert np.hypot(*amplitude(frequency, 800.0)) < 2e-4


@pytest.mark.parametrize("recorded", [125.0, 178.0, 200.0, 343.0, 400.0])
def test_10_hz_passes(recorded: float) -> None:
    wave, phase = amplitude(10.0, recorded)
    assert abs(wave - 1.0) < 1e-3
    assert abs(phase) < 1e-6


def test_slow_measurements_are_interpolated_smoothly() -> None:
    cubic, _ = amplitude(1.0, 9.0)
    linear, _ = amplitude(1.0, 9.0, smooth=False)
    assert abs(cubic - 1.0) < 2e-3
    assert linear < 0.97


def test_samples_on_the_grid_are_taken_as_they_are() -> None:
    rng = np.random.default_rng(3)
    time = 2.61 + 0.01 * np.arange(300)
    x = rng.normal(size=(300, 2))
    for smooth in (False, True):
        out = resample(make_grid(time[0], time[-1], 100.0, 2, "f"), time, x, smooth=smooth)
        np.testing.assert_allclose(out, x, atol=1e-9)


def test_the_grid_lies_on_whole_periods_of_the_log_s_clock() -> None:
    grid = make_grid(68.227, 252.083, 100.0, 1, "f")
    assert grid.time[0] == 68.23
    assert grid.time[-1] == 252.08
    assert {140.0, 145.0} <= set(grid.time.tolist())


def noisy_gyros(start: float, rate: float, clock: float) -> tuple[Grid, FloatArray, FloatArray]:
    """Grid white noise of gyros read at `clock` [Hz] from `start` [s], beside commands on the multiples of 20 ms."""
    time, commands = start + np.arange(800) / clock, np.arange(900) / 50.0
    noise = np.random.default_rng(7).standard_normal(len(time))
    groups = [
        Channels("gyro", time, {"p": noise}),
        Channels("servo", commands, {"elevator": np.sin(commands)}),
    ]
    grid, data, _ = grid_channels(groups, rate, "f")
    return grid, data["p"][np.isfinite(data["p"])], noise


@pytest.mark.parametrize("start", [0.003, 0.01, 2.0151])
def test_gyros_that_read_between_the_multiples_of_the_period_are_taken_as_they_are(start: float) -> None:
    grid, found, noise = noisy_gyros(start, 50.0, 50.0)
    np.testing.assert_allclose(found, noise, atol=1e-9)
    at = grid.position(np.array([start, start + 0.02]))
    np.testing.assert_allclose(at, np.rint(at), atol=1e-6)


def test_a_clock_of_another_rate_leaves_the_grid_on_the_multiples_of_its_period() -> None:
    grid, _, _ = noisy_gyros(0.01, 50.0, 47.0)
    assert grid.phase == 0.0
    np.testing.assert_allclose(grid.time * 50.0, np.rint(grid.time * 50.0), atol=1e-9)


def test_a_step_stays_where_it_is() -> None:
    time = np.arange(0.0, 4.0, 1.0 / 400.0)
    out = resample(
        make_grid(0.0, 4.0, 100.0, 1, "f"), time, (time >= 2.0).astype(float)[:, None], smooth=False
    )[:, 0]
    assert 0.3 < out[200] < 0.7
    assert np.max(np.abs(out[:190])) < 0.02
    assert np.nanmax(np.abs(out[211:] - 1.0)) < 0.02


@given(st.integers(1, 60))
def test_any_short_stretch_can_be_filtered(samples: int) -> None:
    out = low_pass(np.ones((samples, 2)), 400.0, 100.0)
    np.testing.assert_allclose(out, 1.0, atol=1e-9)


def test_clumped_samples_do_not_make_splines_swing() -> None:
    time = np.array([0.0, 0.02, 0.020001, 0.04, 0.06, 0.08])
    x = np.array([0.0, 0.1, -0.1, 0.0, 0.1, 0.0])[:, None]
    out = resample(Grid(0, 9, 100.0), time, x, smooth=True)
    assert np.nanmax(np.abs(out)) <= 0.1 + 1e-12


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), 1e6])
def test_an_impossible_rate(rate: float) -> None:
    with pytest.raises(FlightError, match="choose a rate between"):
        make_grid(0.0, 1.0, rate, 1, "f")


def test_a_record_of_years() -> None:
    with pytest.raises(FlightError, match="too long for a grid"):
        make_grid(0.0, 1e9, 100.0, 1, "f")


@pytest.mark.parametrize("start", [-1e15, 1e15])
def test_a_clock_too_coarse_for_the_grid(start: float) -> None:
    with pytest.raises(FlightError, match="check the unit of the time"):
        make_grid(start, start + 1.0, 100.0, 1, "f")


@pytest.mark.parametrize("step", [5e-324, 1e-300, 1e-12, 1e-8])
def test_a_clock_that_no_sensor_has(step: float) -> None:
    """Its median period says billions of samples a second, which neither memory nor filters can hold."""
    time = np.cumsum(np.concatenate([np.full(30, step), [0.04, 0.04]]))
    out = resample(make_grid(0.0, 0.08, 100.0, 1, "here"), time, np.ones((time.size, 1)), smooth=True)
    np.testing.assert_array_equal(out[1:], 1.0)


def test_bursts_are_not_filled_with_samples_that_are_not_there() -> None:
    time = np.concatenate([k * 0.04 + 2e-5 * np.arange(20) for k in range(50)])
    out = resample(make_grid(0.0, 1.9, 100.0, 1, "here"), time, np.full((time.size, 1), 2.0), smooth=True)
    np.testing.assert_array_equal(out, 2.0)


def test_a_record_shorter_than_two_points_is_refused() -> None:
    with pytest.raises(FlightError, match="less than two samples of 100 Hz"):
        make_grid(0.012, 0.016, 100.0, 1, "f")


@given(st.lists(st.floats(0.0, 1e4), max_size=5))
def test_a_grid_is_as_fast_as_the_fastest_channel_within_its_limits(rates: list[float]) -> None:
    """So that nothing up to 100 Hz is decimated, and no lower grid would do."""
    fastest, found = max(rates, default=0.0), grid_rate(rates)
    assert found in GRID_RATES
    assert fastest <= SAME_RATE * found or found == max(GRID_RATES)
    lower = [rate for rate in GRID_RATES if rate < found]
    assert not lower or fastest > SAME_RATE * max(lower)


@pytest.mark.parametrize(
    ("rate", "grid"),
    [(1.0, 50.0), (10.2, 50.0), (49.9, 50.0), (50.9, 50.0), (62.5, 70.0), (99.4, 100.0), (250.0, 100.0)],
)
def test_the_rate_of_a_grid(rate: float, grid: float) -> None:
    """A channel is as fast as its own samples are, not as the clock of its group, and an explicit rate wins."""
    fast, slow = np.arange(0.0, 8.0, 1.0 / rate), np.arange(0.0, 8.0, 0.001)
    sparse = np.full(slow.size, np.nan)
    sparse[::1000] = 1.0
    channels = [Channels("gyro", fast, {"p": np.sin(fast)}), Channels("table", slow, {"q": sparse})]
    assert grid_channels(channels, None, "f")[0].rate == grid
    assert grid_channels(channels, 37.0, "f")[0].rate == 37.0


def test_channels_of_the_grids_own_rate_are_left_as_they_are() -> None:
    time = np.arange(0.0, 6.0, 0.02)
    values = np.random.default_rng(0).standard_normal(time.size)
    grid, data, _ = grid_channels([Channels("gyro", time, {"p": values})], None, "f")
    assert grid.rate == 50.0
    np.testing.assert_allclose(data["p"], values, rtol=0.0, atol=1e-9)
