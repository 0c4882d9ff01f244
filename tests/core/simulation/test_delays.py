"""What becomes of signals on their way: delays, exact by whole samples; dead zones and rate limits of servos."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stoop.simulation import trim
from stoop.simulation.fly import simulate, simulate_flight
from stoop.simulation.linearize import left_out
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.delays import actuator_rows, delayed, play, rate_limited

BASE = """
name = "late"
mass = { mass = 8.5, inertia = { xx = 1.38, yy = 0.84, zz = 2.0 } }
reference = { area = 0.66, chord = 0.285, span = 2.32, airspeed = 24.0 }
"""
LATE = f"""{BASE}
sensors = {{ q = {{ delay = 0.03 }}, psi = {{ delay = 0.015 }} }}
[controls]
elevator = {{ delay = 0.02 }}
aileron = {{}}
rudder = {{ mix = {{ pwm_3 = 0.001 }}, delay = 0.035 }}
"""


@pytest.fixture(scope="module")
def late() -> Vehicle:
    return parse_vehicle(LATE, "late.toml")


@given(st.integers(0, 40))
def test_whole_samples(samples: int) -> None:
    y = np.random.default_rng(0).standard_normal(30)
    out = delayed(y, float(samples))
    assert np.array_equal(out[samples:], y[: 30 - samples] if samples < 30 else [])
    assert (out[:samples] == y[0]).all(), "before the record it holds its first value"


@given(st.floats(0.0, 10.0), st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_cubics_are_exact(samples: float, coefficients: list[float]) -> None:
    t = np.arange(60.0)
    p = np.polynomial.Polynomial(coefficients, domain=[0, 59], window=[-1, 1])
    inside = slice(int(np.ceil(samples)) + 3, -2)
    assert delayed(p(t), samples)[inside] == pytest.approx(p(t - samples)[inside], abs=1e-11)


@given(st.floats(-50.0, 50.0), st.integers(1, 7))
def test_a_part_of_the_samples_is_the_same_and_delays_are_continuous(samples: float, every: int) -> None:
    y = np.random.default_rng(2).standard_normal((30, 2))
    whole = delayed(y, samples)
    assert np.array_equal(delayed(y, samples, every), whole[::every])
    assert np.abs(delayed(y, samples + 1e-9) - whole).max() < 1e-7


def test_inputs_are_late_by_their_controls_delays_per_lane_where_they_differ(late: Vehicle) -> None:
    u = np.random.default_rng(3).standard_normal((50, 3))
    held = u.copy()
    rows = late.parameter_rows({"controls.elevator.delay": np.array([0.02, 0.025, 0.02])}, 3)
    out, alone = late.late_inputs(u, rows, 0.01), late.late_inputs(u, late.parameter_rows(), 0.01)
    assert np.array_equal(u, held)
    assert late.inputs == ("elevator", "aileron", "pwm_3")
    assert (alone.shape, out.shape) == ((50, 3), (50, 3, 3))
    for one, samples in zip((*np.moveaxis(out, 2, 0), alone), (2.0, 2.5, 2.0, 2.0), strict=True):
        assert np.array_equal(one[:, 0], delayed(u[:, 0], samples))
        assert np.array_equal(one[:, 1], u[:, 1])
        assert one[:, 2] == pytest.approx(delayed(u[:, 2], 3.5), abs=1e-14)


def test_commands_of_before_arrive_late(late: Vehicle) -> None:
    u = np.random.default_rng(3).standard_normal((60, 3))
    for own in ({}, {"controls.elevator.delay": np.array([0.02, 0.025, 0.02])}):
        rows = late.parameter_rows(own, 3)
        for first in (0, 1, 3, 30):
            out = late.late_inputs(u[first:], rows, 0.01, u[:first])
            assert np.array_equal(out, late.late_inputs(u, rows, 0.01)[first:])


def test_readings_are_late_and_headings_do_not_jump(late: Vehicle) -> None:
    t = np.arange(0.0, 4.0, 0.01)
    y = np.zeros((1, len(t), 12))
    heading = 2.0 + 0.8 * t
    y[0, :, late.outputs.index("psi")] = np.angle(np.exp(1j * heading))
    y[0, :, late.outputs.index("q")] = np.sin(t)
    out = late.late_outputs(y.copy(), late.parameter_rows(), 0.01)[0]
    assert out[5:-2, late.outputs.index("q")] == pytest.approx(np.sin(t - 0.03)[5:-2], abs=1e-9)
    off = out[5:-2, late.outputs.index("psi")] - (heading - 0.8 * 0.015)[5:-2]
    assert np.angle(np.exp(1j * off)) == pytest.approx(np.zeros(len(off)), abs=1e-9)


@pytest.mark.filterwarnings("error")
def test_a_diverged_candidate_stays_as_it_is_and_warns_of_nothing(late: Vehicle) -> None:
    rows = late.parameter_rows({"sensors.q.delay": np.array([0.013, 0.013, 0.013])}, 3)
    y = np.random.default_rng(4).standard_normal((3, 50, 12))
    alone = late.late_outputs(y[:1].copy(), rows[:, :1], 0.01)
    y[1, 20:], y[1, 25:] = np.inf, np.nan
    y[2, ::2], y[2, 1::2] = 1.7e308, -1.7e308
    out = late.late_outputs(y.copy(), rows, 0.01)
    assert np.array_equal(out[:1], alone)
    assert np.array_equal(out[1], y[1], equal_nan=True)


SERVOS = f"""{BASE}
[controls]
elevator = {{ mix = {{ pwm_3 = 0.0005, pwm_4 = -0.001 }}, rate_limit = 2.0 }}
rudder = {{ mix = {{ pwm_3 = 0.0005, pwm_4 = 0.001 }}, rate_limit = 3.0, dead_zone = 0.02 }}
aileron = {{ dead_zone = 0.04, delay = 0.02 }}
"""
STEP = {"control": "elevator", "shape": "doublet", "start": 1.0, "step": 1.0, "amplitude": 0.05}
signals = arrays(np.float64, st.integers(2, 60), elements=st.floats(-1.0, 1.0))
DT = 0.01


@pytest.fixture(scope="module")
def servos() -> Vehicle:
    return parse_vehicle(SERVOS, "servos.toml")


def twin_boom(lines: str) -> Vehicle:
    plain = load_vehicle("twin-boom")
    return parse_vehicle(f"{plain.text}\n{lines}[controls.aileron]\n[controls.rudder]\n", plain.where)


def test_a_step_becomes_a_ramp_of_the_limit_and_a_faster_ramp_is_caught_up() -> None:
    t = np.arange(0.0, 3.0, DT)
    out = rate_limited(np.where(t < 0.5, 0.0, 0.3), 0.4 * DT)
    assert out == pytest.approx(np.clip(0.4 * (t - 0.5 + DT), 0.0, 0.3), abs=1e-12)
    out = rate_limited(np.minimum(t, 1.0), 0.5 * DT)
    assert out == pytest.approx(np.minimum(0.5 * t, 1.0), abs=1e-12)


def test_a_sine_through_play_has_flat_tops_and_lags_by_half_the_width() -> None:
    t = np.arange(0.0, 4.0, 1e-4)
    command, width = np.sin(2.0 * np.pi * t), 0.3
    out = play(command, width)
    late = t > 1.0
    assert out[late].max() == pytest.approx(1.0 - width / 2.0, abs=1e-6)
    assert out[late].min() == pytest.approx(-1.0 + width / 2.0, abs=1e-6)
    rising = late & (np.diff(out, prepend=0.0) > 0.0)
    assert (command - out)[rising] == pytest.approx(width / 2.0, abs=1e-6)
    # Energy lost in a cycle: area of the loop of a hysteresis, width times travel.
    cycle = (t >= 2.0) & (t < 3.0)
    area = abs(np.sum(out[cycle] * np.gradient(command, t)[cycle]) * 1e-4)
    assert area == pytest.approx(width * (2.0 - width), rel=1e-3)


@given(signals, st.floats(1e-3, 1.0), st.floats(1e-3, 1.0))
def test_bounds_of_play_and_rate(signal, width, step):
    assert np.array_equal(play(signal, 0.0), signal)
    assert np.array_equal(rate_limited(signal, np.inf), signal)
    assert np.array_equal(rate_limited(signal, float(np.abs(np.diff(signal)).max())), signal)
    held = play(signal, width)
    assert np.abs(held - signal).max() <= width / 2.0 + 1e-12
    assert (np.diff(held) * np.sign(signal - held)[1:] >= -1e-12).all(), "it is pushed, never pulled"
    limited = rate_limited(signal, step)
    assert np.abs(np.diff(limited)).max() <= step + 1e-12
    assert limited[0] == signal[0]
    assert (np.minimum.accumulate(signal) - 1e-12 <= limited).all()


def test_a_channel_has_the_tightest_servo_of_its_controls(servos: Vehicle) -> None:
    rng = np.random.default_rng(0)
    u = np.column_stack([100.0 * rng.standard_normal((80, 2)), 0.1 * rng.standard_normal(80)])
    assert servos.inputs == ("pwm_3", "pwm_4", "aileron")
    out = servos.late_inputs(u, servos.parameter_rows(), DT)
    assert np.array_equal(out[:, 0], rate_limited(play(u[:, 0], 0.02 / 0.0005), 2.0 / 0.0005 * DT))
    assert np.array_equal(out[:, 1], rate_limited(play(u[:, 1], 0.02 / 0.001), 2.0 / 0.001 * DT))
    assert np.array_equal(out[:, 2], delayed(play(u[:, 2], 0.04), 2.0))


def test_lanes_are_what_single_servos_are(servos: Vehicle) -> None:
    u = np.random.default_rng(1).standard_normal((80, 3))
    names = ("controls.elevator.rate_limit", "controls.aileron.dead_zone", "controls.rudder.mix.pwm_3")
    values = (np.array([2.0, 1e9, 2.0]), np.array([0.0, 0.1, 0.1]), np.array([5e-4, 5e-4, 1e-2]))
    rows = servos.parameter_rows(dict(zip(names, values, strict=True)), 3)
    out = servos.late_inputs(u, rows, DT)
    for b in range(3):
        alone = servos.late_inputs(u, np.ascontiguousarray(rows[:, b : b + 1]), DT)
        assert np.array_equal(out[:, :, b], alone)


def test_numbers_of_servos(servos: Vehicle) -> None:
    assert not actuator_rows(parse_vehicle(BASE, "plain"))
    deciding = {servos.parameters[row].name.removeprefix("controls.") for row in actuator_rows(servos)}
    assert deciding >= {"aileron.delay", "aileron.dead_zone", "elevator.rate_limit", "rudder.dead_zone",
                        "rudder.mix.pwm_3", "rudder.mix.pwm_4"}  # fmt: skip
    known = {p.name: (p.free, p.unit, p.lower, p.upper) for p in servos.parameters}
    assert known["controls.elevator.rate_limit"] == (False, "rad/s", 0.4, 10.0)
    assert known["controls.rudder.dead_zone"] == (False, "rad", 0.0, 0.1)


def test_steady_flight_is_that_without_servos() -> None:
    plain = load_vehicle("twin-boom")
    slow = twin_boom("[controls.elevator]\nrate_limit = 0.5\ndead_zone = 0.02\n")
    a, b = trim(plain), trim(slow)
    assert (a.start, a.deflections) == (b.start, b.deflections)
    assert not left_out(plain)
    (omitted,) = left_out(slow)
    assert omitted.code == "linear-model-without-limits"
    servos = ("controls.elevator.rate_limit = 0.5 rad/s", "controls.elevator.dead_zone = 0.02 rad")
    assert omitted.values["numbers"] == servos


def test_a_simulated_flight_follows_what_the_servo_makes_of_the_record() -> None:
    limit, zone = 0.2, 0.01
    slow = twin_boom(f"[controls.elevator]\nrate_limit = {limit}\ndead_zone = {zone}\n")
    maneuver = Maneuver.model_validate({"duration": 6.0, "rate": 50.0, "input": [STEP]})
    flight = simulate_flight(slow, maneuver, noise=False)
    command = flight.column("elevator")
    assert np.abs(np.diff(command)).max() > 0.04, "recorded as commanded"
    moved = rate_limited(play(command, zone), limit / maneuver.rate)
    changes = {n: {"value": v} for n, v in trim(slow).changes.items()}
    twin = simulate(load_vehicle("twin-boom").with_numbers(changes), {"elevator": moved}, maneuver.time)
    for channel in ("q", "alpha", "az"):
        assert flight.column(channel) == pytest.approx(twin.column(channel), abs=1e-12)
