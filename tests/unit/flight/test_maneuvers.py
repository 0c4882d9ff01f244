"""Candidate maneuvers: found where they were flown, named by their axis."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.flight import Flight, describe, find_maneuvers, from_columns
from stoop.flight.airborne import airborne, motors_ran
from stoop.flight.maneuvers import LIMITS, _running_means, _running_sums

TIME = 60.0 + np.arange(12000) / 100.0
STEPS = {"3211": ((3, 1), (2, -1), (1, 1), (1, -1)), "doublet": ((1, 1), (1, -1))}


def signal(*at: tuple[float, str, float]) -> FloatArray:
    out = 0.02 * np.random.default_rng(5).normal(size=TIME.size).cumsum() / 30.0
    for start, kind, size in at:
        for seconds, sign in STEPS[kind]:
            out[(start <= TIME) & (start + seconds > TIME)] += sign * size
            start += seconds
    return out


def flight(**columns: FloatArray) -> Flight:
    speed = np.where((TIME > 80.0) & (TIME < 170.0), 20.0, 0.0)
    return from_columns("f", TIME, {"vn": speed, "ve": 0 * speed, "vd": 0 * speed, **columns})


def test_each_maneuver_is_found_once_under_its_axis() -> None:
    roll, pitch = signal((100.0, "doublet", 0.5)), signal((120.0, "3211", 0.4), (100.0, "doublet", 0.05))
    yaw = signal((140.0, "doublet", 0.2))
    found = find_maneuvers(flight(control_roll=roll, control_pitch=pitch, rudder=yaw))
    assert [(m.axis, m.variable) for m in found] == [
        ("roll", "control_roll"), ("pitch", "control_pitch"), ("yaw", "rudder"),
    ]  # fmt: skip
    for maneuver, start, stop in zip(found, (100.0, 120.0, 140.0), (102.0, 127.0, 142.0), strict=True):
        assert start - 1.5 < maneuver.start <= start
        assert stop + 0.75 * LIMITS.tail <= maneuver.stop < stop + 2.5
        assert maneuver.whole == 1.0
    assert [m.swings for m in found] == [2, 4, 2]
    assert found[1].amplitude == pytest.approx(0.4, rel=0.3)


def test_what_is_no_maneuver() -> None:
    checks = signal((65.0, "doublet", 0.5), (175.0, "3211", 0.5))
    for u in (checks, np.where(TIME > 120.0, 0.3, 0.0), np.zeros(TIME.size), np.full(TIME.size, np.nan)):
        assert find_maneuvers(flight(elevator=u)) == []
    assert airborne(flight()).sum() == pytest.approx((170.0 - 80.0 - 6.0) * 100.0, abs=5)


def test_holes_inside_are_counted() -> None:
    u = signal((100.0, "3211", 0.5))
    u[4300:4400] = np.nan
    (maneuver,) = find_maneuvers(flight(elevator=u))
    assert 0.8 < maneuver.whole < 0.95


def test_without_a_speed_everything_may_be_flight() -> None:
    flown = from_columns("f", TIME, {"elevator": signal((65.0, "doublet", 0.5))})
    assert airborne(flown).all()
    assert len(find_maneuvers(flown)) == 1


def test_description() -> None:
    u = signal((100.0, "doublet", 0.5))
    u[:1200] = np.nan
    summary = describe(flight(elevator=u, rudder=np.full(TIME.size, np.nan)))
    assert [row.variable for row in summary.rows] == ["vn", "ve", "vd", "elevator", "rudder"]
    row, empty = summary.rows[-2:]
    assert (row.unit, row.source, row.missing) == ("rad", "simulation", pytest.approx(0.1))
    assert row.minimum < -0.4 < 0.4 < row.maximum
    assert (np.isnan(empty.median), empty.missing) == (True, 1.0)


@pytest.mark.parametrize("command", [0.0, 0.6])
def test_an_aeroplane_with_one_motor_flies_whether_it_runs_or_not(command: float) -> None:
    glider = flight(elevator=signal((100.0, "3211", 0.2)), motor_1=np.full(TIME.size, command))
    assert motors_ran(glider)
    assert "motors-never-ran" not in [n.code for n in describe(glider).notices]
    assert [m.axis for m in find_maneuvers(glider)] == ["pitch"]
    still = flight(**{f"motor_{n}": np.zeros(TIME.size) for n in range(1, 5)})
    assert not motors_ran(still)


def test_what_an_autopilot_answers_to_a_gust_is_no_maneuver() -> None:
    """The elevator, down for nose down, opposes a rate that it answers, and has the rate follow to the other side."""
    burst, calm = signal((120.0, "3211", 0.4)), 0.02 * np.random.default_rng(1).normal(size=TIME.size)
    rate = 0.02 * np.sin(TIME) + calm
    assert len(find_maneuvers(flight(elevator=burst, q=rate))) == 1
    assert find_maneuvers(flight(elevator=burst, q=2.0 * burst + 0.1 * calm)) == []
    assert len(find_maneuvers(flight(elevator=burst, q=-2.0 * burst + 0.1 * calm))) == 1


def test_running_means_are_those_of_each_window() -> None:
    for width in (1, 2, 5, 6, 29, 30, 99):
        rng = np.random.default_rng(width)
        x = rng.standard_normal((30, 2))
        x[rng.random(x.shape) < 0.3] = np.nan
        found, used = _running_means(_running_sums(x), width, 0.5), min(width, 30)
        for k in range(30):
            first = max(k - used // 2, 0)
            for column, mean in zip(x[first : first + used].T, found[k], strict=True):
                known = column[np.isfinite(column)]
                expected = known.mean() if known.size and known.size >= 0.5 * column.size else np.nan
                np.testing.assert_allclose(mean, expected, atol=1e-12)
