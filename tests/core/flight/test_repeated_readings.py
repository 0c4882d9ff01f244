"""Slow readings in fast rows count where they were taken; what merely changes slowly was read in every row."""

from pathlib import Path

import numpy as np
import pytest
from helpers.made_logs import mapped_log
from hypothesis import example, given
from hypothesis import strategies as st

from stoop.base.arrays import FloatArray, IntArray
from stoop.flight import load_flight
from stoop.flight.gridding import Channels
from stoop.flight.repeated_readings import at_own_rates, regular

RATE = 50.0
TIME: FloatArray = np.arange(3000) / RATE
SEEDS, PERIODS = st.integers(0, 2**31), st.floats(2.0, 60.0)


def motion(seed: int, noise: float, period: float = 7.0) -> FloatArray:
    rng = np.random.default_rng(seed)
    swing = np.sin(2.0 * np.pi * TIME / period + rng.uniform(0.0, 2.0 * np.pi))
    return np.asarray(5.0 * swing + noise * rng.standard_normal(TIME.size))


def readings(every: float, phase: float) -> IntArray:
    """Return the rows with the first readings since the row before, of a sensor that is read every so many rows."""
    return np.unique(np.ceil(np.arange(phase, TIME.size, every)).astype(np.intp))[1:-1]


def hold(x: FloatArray, rows: IntArray) -> FloatArray:
    return np.asarray(x[np.r_[0, rows]][np.searchsorted(rows, np.arange(x.size), "right")])


def found(**columns: FloatArray) -> dict[str, Channels]:
    groups, notices = at_own_rates(Channels("log", TIME, columns))
    assert len(notices) == len(groups) - any(one.time is TIME for one in groups)
    return {name: one for one in groups for name in one.values}


def rounded(x: FloatArray, resolution: float) -> FloatArray:
    return np.round(x / resolution) * resolution if resolution else x


@given(SEEDS, st.sampled_from([2, 2.78, 5, 10, 50]), st.floats(0.0, 1.9), st.sampled_from([0.0, 1e-3, 1e-2]))
def test_a_held_column_is_its_readings(seed: int, every: float, phase: float, resolution: float) -> None:
    rows, x = readings(every, phase), rounded(motion(seed, 0.1), resolution)
    fast = motion(seed + 1, 0.01)
    groups = found(vn=hold(x, rows), p=fast)
    np.testing.assert_array_equal(groups["p"].values["p"], fast)
    own = groups["vn"]
    assert own.rate == pytest.approx(RATE / every, rel=0.2)
    new = np.isin(rows, np.searchsorted(TIME, own.time))
    assert new.mean() > 0.9  # all but what repeats the one before
    assert np.isin(np.searchsorted(TIME, own.time), rows).all()  # nothing that was not read
    np.testing.assert_array_equal(own.values["vn"], x[np.searchsorted(TIME, own.time)])


@example(0, 1e-3, 0.0, 6.0)  # its curvature is that of two steps
@given(SEEDS, st.sampled_from([1e-3, 0.05, 0.3, 1, 2]), st.sampled_from([0, 1e-3, 0.05, 0.5]), PERIODS)
def test_coarse_numbers_were_read_each_row(seed: int, resolution: float, noise: float, period: float) -> None:
    x = np.round(motion(seed, noise, period) / resolution) * resolution
    assert found(altitude=x)["altitude"].time is TIME


def test_a_steady_climb_in_steps_of_a_meter_was_read_in_every_row() -> None:
    """It changes as regularly as a receiver of 1 Hz, but by one step at a time."""
    assert regular(np.flatnonzero(np.diff(np.round(TIME))) + 1)
    assert found(altitude=np.round(TIME))["altitude"].time is TIME
    assert found(altitude=np.round(TIME) * 0.3048)["altitude"].time is TIME
    rows, coarse = readings(10.0, 0.0), np.round(motion(1, 0.0, 60.0) / 0.2) * 0.2
    alone = found(vn=hold(coarse, rows))
    assert alone["vn"].time is TIME
    groups = found(vn=hold(coarse, rows), vd=hold(motion(2, 0.1), rows), altitude=coarse)
    assert groups["vn"] is groups["vd"]
    assert groups["altitude"].time is TIME  # it changes between those readings
    at = np.searchsorted(TIME, groups["vn"].time)
    np.testing.assert_array_equal(groups["vn"].values["vn"], coarse[at])


@given(SEEDS, st.sampled_from([3, 5, 10, 25]), st.sampled_from([0.0, 1e-4]))
def test_an_interpolated_column_is_its_knots(seed: int, every: int, resolution: float) -> None:
    rows, x = np.arange(1, TIME.size - 1, every), motion(seed, 0.1)
    own = found(vn=rounded(np.interp(np.arange(TIME.size), rows, x[rows]), resolution))["vn"]
    assert own.rate == pytest.approx(RATE / every, rel=0.01)
    at = np.searchsorted(TIME, own.time)
    assert np.isin(at, rows).all()
    assert len(at) > 0.85 * len(rows)


def test_columns_that_were_read_together_share_their_readings() -> None:
    """One that repeats its last reading was read all the same, beside one that does not."""
    rows = readings(5.0, 0.0)
    coarse = np.round(motion(1, 0.3) / 0.25) * 0.25
    groups = found(vn=hold(motion(2, 0.1), rows), vd=hold(coarse, rows), V=hold(motion(3, 0.1), rows + 2))
    assert groups["vd"] is groups["vn"]
    assert groups["V"] is not groups["vn"]
    np.testing.assert_array_equal(np.searchsorted(TIME, groups["vd"].time), rows)
    slow = hold(motion(1, 0.1), rows)
    assert found(elevator=slow)["elevator"].time is TIME
    mixed = {"phi": slow / 9.0, "theta": motion(2, 0.1) / 9.0, "psi": slow / 8.0}
    assert all(one.time is TIME for one in found(**mixed).values())
    whole = found(**dict.fromkeys(mixed, slow / 9.0))
    assert all(one.time is not TIME for one in whole.values())


def test_a_table_with_a_held_receiver_is_laid_on_the_grid_of_its_fast_sensors(tmp_path: Path) -> None:
    """The reading lies between rows of the table no more: between its own it is interpolated smoothly."""
    truth = motion(4, 0.0)
    columns = {"p": motion(5, 0.01) / 10.0, "vn": hold(truth, readings(5.0, 0.0))}
    columns["V"] = motion(6, 0.05) + 20.0
    flight = load_flight(mapped_log(tmp_path / "log.csv", {"t": TIME, **columns}))
    assert flight.rate == RATE == pytest.approx(flight.sources["p"].rate)
    assert flight.sources["vn"].rate == pytest.approx(10.0)
    at, inside = np.searchsorted(TIME, flight.time), slice(10, -10)
    np.testing.assert_allclose(flight.column("vn")[inside], truth[at][inside], atol=5e-3)
    assert [n.code for n in flight.notices].count("readings-repeated") == 1
