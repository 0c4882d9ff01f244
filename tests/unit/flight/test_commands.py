"""What was commanded about each axis, and where a vehicle flies, told from outputs alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.flight import Flight, find_maneuvers, from_columns
from stoop.flight.airborne import airborne, carried_by_rotors, flying, lift_command, motors_ran
from stoop.flight.maneuvers import commands, directions

RATE = 100.0
TIME = 60.0 + np.arange(9000) / RATE
MIX = np.array([[-1.0, 1.0, 1.0, 1.0], [1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0], [-1.0, -1.0, -1.0, 1.0]])
POWER = np.array([60.0, 40.0, 8.0, 20.0])  # rad/s2 and m/s2 per unit of roll, pitch, yaw, heave
AXES = ("roll", "pitch", "yaw", "heave")


def wave(start: float, step: float, size: float) -> FloatArray:
    """Return a doublet."""
    since = TIME - start
    return size * (((since >= 0) & (since < step)).astype(float) - ((since >= step) & (since < 2 * step)))


def hover(seed: int = 0, **extra: FloatArray) -> Flight:
    """Return four motors at hover, each axis moved once; a rate decays with 0.3 s, as rotors damp it."""
    rng = np.random.default_rng(seed)
    calm = np.array([rng.normal(size=TIME.size).cumsum() * 2e-4 for _ in AXES])
    moved = calm + np.array([wave(75.0 + 15.0 * i, 0.4, 0.06) for i in range(4)])
    motors = 0.5 + MIX @ moved
    pushed = (POWER[:3, None] * moved[:3]) / RATE
    rates = lfilter([0.0, 1.0], [1.0, -(1.0 - 1.0 / (0.3 * RATE))], pushed, axis=1)
    noise = rng.normal(size=(4, TIME.size))
    columns = {f"motor_{i + 1}": m for i, m in enumerate(motors)}
    columns |= {n: r + 0.005 * e for n, r, e in zip("pqr", rates, noise[:3], strict=True)}
    columns["az"] = -9.8 - POWER[3] * moved[3] + 0.05 * noise[3]
    still = np.zeros(TIME.size)
    return from_columns("hover", TIME, {**columns, "vn": still, "ve": still, "vd": still, **extra})


@pytest.mark.parametrize("seed", range(3))
def test_the_axes_of_motors_are_found_by_what_they_turn(seed: int) -> None:
    found = find_maneuvers(hover(seed))
    assert [(m.axis, m.variable) for m in found] == [(axis, "motor_1..4") for axis in AXES]
    for i, m in enumerate(found):
        assert m.start <= 75.0 + 15.0 * i
        assert m.stop >= 75.8 + 15.0 * i
        assert m.stop - m.start < 4.0


def test_a_direction_is_the_acceleration_that_it_gives() -> None:
    flight = hover()
    for command, power in zip(commands(flight), POWER, strict=True):
        assert float(np.ptp(command.u)) == pytest.approx(0.12 * power, rel=0.35)


def test_dead_and_doubled_outputs_drop_out() -> None:
    flight = hover()
    more = {"motor_5": np.full(TIME.size, 0.1), "motor_6": flight.column("motor_1")}
    found = directions(hover(**more), [f"motor_{n}" for n in range(1, 7)])
    assert [c.axis for c in found] == list(AXES)


def test_without_rates_no_direction_has_a_name() -> None:
    flight = hover()
    silent = from_columns("f", TIME, {n: flight.column(n) for n in ("motor_1", "motor_2", "motor_3", "vn")})
    assert commands(silent) == []
    assert find_maneuvers(silent) == []


def test_a_hover_counts_as_flight_though_nothing_moves() -> None:
    flight = hover()
    assert carried_by_rotors(flight)
    assert flying(flight).all()
    assert not airborne(flight).any()


def test_take_off_landing_and_idling_are_no_flight() -> None:
    base = hover()
    up = (TIME > 80.0) & (TIME < 130.0)
    idle = {f"motor_{n}": np.where(up, base.column(f"motor_{n}"), 0.06) for n in range(1, 5)}
    flown = flying(hover(**idle))
    assert TIME[flown][0] == pytest.approx(83.0, abs=0.1)
    assert TIME[flown][-1] == pytest.approx(127.0, abs=0.1)


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_motors_off(value: float) -> None:
    off = {f"motor_{n}": np.full(TIME.size, value) for n in range(1, 5)}
    flight = hover(**off, control_throttle=np.zeros(TIME.size))
    told = lift_command(flight)
    assert told is None or not np.nan_to_num(told).any()
    assert commands(flight) == []


def test_motors_that_only_idle_never_ran() -> None:
    crawl = {f"motor_{n}": np.full(TIME.size, 0.01) for n in range(1, 5)}
    assert not motors_ran(hover(**crawl))
    assert motors_ran(hover())


def test_pulses_are_read_above_idle() -> None:
    base = hover()
    pulses = {f"pwm_{n}": 1000.0 + 900.0 * base.column(f"motor_{n}") for n in range(1, 5)}
    columns = {n: base.column(n) for n in ("p", "q", "r", "az", "vn", "ve", "vd")}
    force = {"ax": 0 * TIME, "ay": 0 * TIME, "altitude": np.where(TIME < 70.0, 0.0, 5.0)}
    flight = from_columns("f", TIME, {**columns, **force, **pulses})
    assert carried_by_rotors(flight)
    told = lift_command(flight)
    assert told is not None
    assert float(np.median(told)) == pytest.approx(0.45, abs=0.02)
    assert [m.variable for m in find_maneuvers(flight)] == ["pwm_1..4"] * 4
