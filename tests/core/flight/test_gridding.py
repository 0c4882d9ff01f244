"""The grid: filtered as theory says, exact where nothing is to be done, silent in gaps; attitudes follow Slerp and rates."""

from itertools import pairwise

import numpy as np
import pytest
from helpers.made_logs import body_rates
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.rotations import continuous, quaternions_of, wrap
from stoop.base.variables import EULER, QUATERNION, RATES
from stoop.errors import FlightError
from stoop.flight import gridding
from stoop.flight.gridding import Channels, Grid, grid_channels, longest_allowed, make_grid, resample

steps = st.lists(st.sampled_from([0.003, 0.01, 0.02, 0.049, 0.051, 0.3]), min_size=1, max_size=60)


def times(gaps: list[float]) -> FloatArray:
    return 1.0 + np.concatenate([[0.0], np.cumsum(gaps)])


@given(steps)
def test_no_value_in_a_gap_and_a_value_everywhere_else(gaps: list[float]) -> None:
    time = times(gaps)
    assume(time[-1] - time[0] > 0.02)  # else it has less than two points
    grid = make_grid(time[0], time[-1], 100.0, 1, "f")
    out = resample(grid, time, np.sin(time)[:, None], smooth=False)[:, 0]
    limit = max(0.05, 2.5 * float(np.median(np.diff(time))))
    assert limit == longest_allowed(time)
    near = [(a - 1e-6, b + 1e-6) for a, b in pairwise(time) if b - a <= limit]  # pairs of neighbors
    assert np.array_equal(np.isfinite(out), [any(a <= t <= b for a, b in near) for t in grid.time])


@given(steps)
def test_stretches_hold_every_sample_that_has_a_near_neighbor(gaps: list[float]) -> None:
    time = times(gaps)
    limit, covered = longest_allowed(time), np.zeros(time.size, dtype=bool)
    for part in gridding.stretches(time):
        assert np.all(np.diff(time[part]) <= limit)
        covered[part] = True
    near = np.append(np.diff(time) <= limit, False) | np.append(False, np.diff(time) <= limit)
    assert np.array_equal(covered, near)
    described = gridding.source_rate("x", time)
    assert described.gaps == np.sum(np.diff(time) > limit)
    assert described.longest_gap == np.max(np.diff(time))


def amplitude(frequency: float, recorded: float, smooth: bool = True) -> tuple[float, float]:
    time = np.arange(0.0, 12.0, 1.0 / recorded)
    grid = make_grid(0.0, time[-1], 100.0, 1, "f")
    out = resample(grid, time, np.sin(2 * np.pi * frequency * time)[:, None], smooth=smooth)[:, 0]
    inside = (grid.time > 2.0) & (grid.time < 10.0)
    t = grid.time[inside]
    design = np.column_stack([np.sin(2 * np.pi * frequency * t), np.cos(2 * np.pi * frequency * t)])
    fit = np.linalg.lstsq(design, out[inside], rcond=None)[0]
    return float(fit[0]), float(fit[1])


def test_the_low_pass_weakens_as_a_butterworth_run_both_ways() -> None:
    """So that 10 Hz pass, and what would alias onto 10 Hz is gone."""
    fine = 800.0
    for frequency in (1.0, 5.0, 10.0, 20.0, 30.0, 41.0, 80.0, 95.0, 120.0):
        wave, phase = amplitude(frequency, fine)
        warped = np.tan(np.pi * frequency / fine) / np.tan(np.pi * gridding.CUTOFF * 100.0 / fine)
        assert wave == pytest.approx(1.0 / (1.0 + warped ** (2 * gridding.ORDER)), abs=1e-5)
        assert abs(phase) < 1e-3
    for frequency in (90.0, 110.0, 190.0):
        assert np.hypot(*amplitude(frequency, fine)) < 2e-4
    for recorded in (125.0, 178.0, 343.0):
        wave, phase = amplitude(10.0, recorded)
        assert abs(wave - 1.0) < 1e-3
        assert abs(phase) < 1e-6
    cubic, _ = amplitude(1.0, 9.0)
    linear, _ = amplitude(1.0, 9.0, smooth=False)
    assert abs(cubic - 1.0) < 2e-3
    assert linear < 0.97


def test_the_grid_lies_on_whole_periods_and_samples_on_it_are_taken_as_they_are() -> None:
    grid = make_grid(68.227, 252.083, 100.0, 1, "f")
    assert grid.time[0] == 68.23
    assert grid.time[-1] == 252.08
    assert {140.0, 145.0} <= set(grid.time.tolist())
    for start, stop, rate, words in (
        *((0.0, 1.0, rate, "choose a rate between") for rate in (0.0, -1.0, float("nan"), 1e6)),
        (0.0, 1e9, 100.0, "too long for a grid"),
        *((start, start + 1.0, 100.0, "check the unit of the time") for start in (-1e15, 1e15)),
        (0.012, 0.016, 100.0, "less than two samples of 100 Hz"),
    ):
        with pytest.raises(FlightError, match=words):
            make_grid(start, stop, rate, 1, "f")
    rng = np.random.default_rng(3)
    time, x = 2.61 + 0.01 * np.arange(300), rng.normal(size=(300, 2))
    for smooth in (False, True):
        out = resample(make_grid(time[0], time[-1], 100.0, 2, "f"), time, x, smooth=smooth)
        np.testing.assert_allclose(out, x, atol=1e-9)
    slow = np.arange(0.0, 6.0, 0.02)
    grid, data, _ = grid_channels([Channels("gyro", slow, {"p": x[:, 0]})], None, "f")
    assert grid.rate == 50.0
    np.testing.assert_allclose(data["p"], x[:, 0], rtol=0.0, atol=1e-9)


def noisy_gyros(start: float, rate: float, clock: float) -> tuple[Grid, FloatArray, FloatArray]:
    time, commands = start + np.arange(800) / clock, np.arange(900) / 50.0
    noise = np.random.default_rng(7).standard_normal(len(time))
    gyro, servo = ("gyro", time, {"p": noise}), ("servo", commands, {"elevator": np.sin(commands)})
    grid, data, _ = grid_channels([Channels(*gyro), Channels(*servo)], rate, "f")
    return grid, data["p"][np.isfinite(data["p"])], noise


def test_gyros_that_read_between_the_multiples_of_the_period_are_taken_as_they_are() -> None:
    for start in (0.003, 0.01, 2.0151):
        grid, found, noise = noisy_gyros(start, 50.0, 50.0)
        np.testing.assert_allclose(found, noise, atol=1e-9)
        at = grid.position(np.array([start, start + 0.02]))
        np.testing.assert_allclose(at, np.rint(at), atol=1e-6)
    grid, _, _ = noisy_gyros(0.01, 50.0, 47.0)  # a clock of another rate leaves the grid where it is
    assert grid.phase == 0.0
    np.testing.assert_allclose(grid.time * 50.0, np.rint(grid.time * 50.0), atol=1e-9)


def test_short_stretches_and_clocks_that_no_sensor_has_are_filtered() -> None:
    for samples in range(1, 61):
        np.testing.assert_allclose(gridding.low_pass(np.ones((samples, 2)), 400.0, 100.0), 1.0, atol=1e-9)
    for step in (5e-324, 1e-300, 1e-12, 1e-8):
        time = np.cumsum(np.concatenate([np.full(30, step), [0.04, 0.04]]))
        out = resample(make_grid(0.0, 0.08, 100.0, 1, "here"), time, np.ones((time.size, 1)), smooth=True)
        np.testing.assert_array_equal(out[1:], 1.0)
    time = np.concatenate([k * 0.04 + 2e-5 * np.arange(20) for k in range(50)])
    out = resample(make_grid(0.0, 1.9, 100.0, 1, "here"), time, np.full((time.size, 1), 2.0), smooth=True)
    np.testing.assert_array_equal(out, 2.0)
    time = np.array([0.0, 0.02, 0.020001, 0.04, 0.06, 0.08])
    out = resample(Grid(0, 9, 100.0), time, np.array([[0.0, 0.1, -0.1, 0.0, 0.1, 0.0]]).T, smooth=True)
    assert np.nanmax(np.abs(out)) <= 0.1 + 1e-12  # a spline swings no further


@given(st.lists(st.floats(0.0, 1e4), max_size=5))
def test_a_grid_is_as_fast_as_the_fastest_channel_within_its_limits(rates: list[float]) -> None:
    fastest, found = max(rates, default=0.0), gridding.grid_rate(rates)
    assert found in gridding.GRID_RATES
    assert fastest <= gridding.SAME_RATE * found or found == max(gridding.GRID_RATES)
    lower = [rate for rate in gridding.GRID_RATES if rate < found]
    assert not lower or fastest > gridding.SAME_RATE * max(lower)


def test_the_rate_of_a_grid() -> None:
    """A channel is as fast as its own samples are, not as the clock of its group, and an explicit rate wins."""
    slow = np.arange(0.0, 8.0, 0.001)
    sparse = np.where(np.arange(slow.size) % 1000, np.nan, 1.0)
    for rate, grid in ((1.0, 50.0), (49.9, 50.0), (50.9, 50.0), (62.5, 70.0), (99.4, 100.0), (250.0, 100.0)):
        fast = np.arange(0.0, 8.0, 1.0 / rate)
        channels = [Channels("gyro", fast, {"p": np.sin(fast)}), Channels("table", slow, {"q": sparse})]
        assert grid_channels(channels, None, "f")[0].rate == grid
        assert grid_channels(channels, 37.0, "f")[0].rate == 37.0


@pytest.mark.parametrize("recorded_rate", [10.0, 100.0, 178.0])
def test_the_gridded_attitude_follows_slerp_through_any_sign(recorded_rate: float) -> None:
    rng = np.random.default_rng(7)
    time = np.arange(0.0, 6.0, 1.0 / recorded_rate)
    begun = Rotation.from_euler("ZYX", [3.0, 0.4, -0.5])
    turning = Rotation.from_rotvec(np.outer(time, [1.2, -0.7, 2.0])) * begun
    parts = np.roll(turning.as_quat(), 1, axis=1) * rng.choice([-1.0, 1.0], time.size)[:, None]
    channels = [Channels("att", time, dict(zip(QUATERNION, parts.T, strict=True)))]
    grid, data, _ = grid_channels(channels, 100.0, "f")
    ours = np.column_stack([data[name] for name in QUATERNION])
    inside = slice(20, -20)  # the low-pass distorts the ends
    truth = Slerp(time, turning)(grid.time[inside])
    assert np.max((Rotation.from_quat(np.roll(ours[inside], -1, axis=1)) * truth.inv()).magnitude()) < 2e-4
    np.testing.assert_allclose(np.linalg.norm(ours, axis=1), 1.0, atol=1e-12)
    assert np.min(np.sum(ours[1:] * ours[:-1], axis=1)) > 0.99
    angles = np.column_stack([data[name] for name in EULER])[inside]
    np.testing.assert_allclose(np.sin(angles - truth.as_euler("ZYX")[:, ::-1]), 0.0, atol=1e-2)


def test_recorded_euler_angles_are_not_interpolated_through_the_turn_of_heading() -> None:
    time = np.arange(0.0, 4.0, 0.03)
    heading, level = wrap(2.5 + 0.8 * time), np.zeros_like(time)
    for angles in ({"phi": level, "theta": level, "psi": heading}, {"psi": heading}):
        grid, data, sources = grid_channels([Channels("att", time, angles)], 100.0, "f")
        np.testing.assert_allclose(np.exp(1j * data["psi"]), np.exp(1j * (2.5 + 0.8 * grid.time)), atol=1e-4)
        assert np.all((data["psi"] > -np.pi) & (data["psi"] <= np.pi))
        assert np.max(np.abs(data.get("phi", level))) < 1e-9
        assert sources["psi"].source == "att"


def wobbling(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    phi, theta, psi = 0.4 * np.sin(9.0 * t), 0.3 * np.cos(7.0 * t), 0.8 * t
    rates = body_rates(phi, theta, 3.6 * np.cos(9.0 * t), -2.1 * np.sin(7.0 * t), np.full(t.size, 0.8))
    return np.column_stack([phi, theta, psi]), np.column_stack(rates)


def recorded(slow: np.ndarray, fast: np.ndarray, bias: float = 0.0) -> list[Channels]:
    angles, rates = wobbling(slow)[0], wobbling(fast)[1] + bias
    parts = continuous(quaternions_of(angles))
    gyro = Channels("gyro", fast, dict(zip(RATES, rates.T, strict=True)))
    return [Channels("estimator", slow, dict(zip(QUATERNION, parts.T, strict=True))), gyro]


def off(channels: list[Channels], follow: bool) -> tuple[float, list[Notice]]:
    grid, data, sources = grid_channels(channels, 100.0, "test")
    notices: list[Notice] = []
    if follow:
        data, notices = gridding.interpolate_by_rates(grid, data, sources, channels)
    truth = wobbling(grid.time)[0]
    there = np.isfinite(data["q0"]) & np.isfinite(data["p"])
    found = np.column_stack([data["phi"], data["theta"]])
    return float(np.max(np.abs(found - truth[:, :2])[there])), notices


def test_quick_motion_between_slow_samples() -> None:
    channels = recorded(np.arange(0.0, 20.0, 0.2), np.arange(0.0, 20.0, 0.004), bias=0.01)
    before, after = off(channels, False)[0], off(channels, True)
    assert before > 0.1
    assert after[0] < 0.03, "the ends of filtered rates are the worst"
    assert [(n.code, n.values["rate"]) for n in after[1]] == [("attitude-follows-rates", pytest.approx(5.0))]


def test_holes_fast_attitudes_and_slow_rates_stay() -> None:
    slow, fast = np.arange(0.0, 20.0, 0.2), np.arange(0.0, 20.0, 0.004)
    slow = slow[(slow < 6.0) | (slow > 7.5)]
    fast = fast[(fast < 12.0) | (fast > 13.0)]
    channels = recorded(slow, fast)
    grid, data, sources = grid_channels(channels, 100.0, "test")
    after, _ = gridding.interpolate_by_rates(grid, data, sources, channels)
    for name in ("q0", "phi"):
        np.testing.assert_array_equal(np.isnan(after[name]), np.isnan(data[name]))
    assert off(channels, True)[0] < 0.03
    fast = recorded(np.arange(0.0, 5.0, 0.02), np.arange(0.0, 5.0, 0.004))
    slow = recorded(np.arange(0.0, 5.0, 0.1), np.arange(0.0, 5.0, 0.1))
    for channels in (fast, slow, slow[:1], slow[1:]):
        grid, data, sources = grid_channels(channels, 100.0, "test")
        after, notices = gridding.interpolate_by_rates(grid, data, sources, channels)
        assert notices == []
        assert all(after[name] is data[name] for name in data)
