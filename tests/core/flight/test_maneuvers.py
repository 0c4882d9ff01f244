"""Maneuvers are found where they were flown, named by their axis; where a vehicle flies, and which pulses are motors."""

import numpy as np
import pytest
from helpers.flown import maneuver
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.flight import Flight, describe, from_columns
from stoop.flight.airborne import motors_ran
from stoop.flight.maneuvers import LIMITS, _running_means, _running_sums
from stoop.simulation.fly import simulate_flight
from stoop.vehicle.builtin import load_vehicle

TIME = 60.0 + np.arange(12000) / 100.0
STEPS = {"3211": ((3, 1), (2, -1), (1, 1), (1, -1)), "doublet": ((1, 1), (1, -1))}
RATE = 100.0
HOVER = TIME[:9000]
MIX = np.array([[-1.0, 1.0, 1.0, 1.0], [1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0], [-1.0, -1.0, -1.0, 1.0]])
POWER = np.array([60.0, 40.0, 8.0, 20.0])  # rad/s2 and m/s2 per unit of roll, pitch, yaw, heave
AXES = ("roll", "pitch", "yaw", "heave")
FLOWN = maneuver(
    20.0, *((axis, "doublet", start, 0.2, size) for axis, start, size in (("roll", 3, 8), ("pitch", 9, 8), ("yaw", 15, 1))),
    rate=100.0, wind=[2.0, 1.0, 0.0],
)  # fmt: skip


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
    found = flight(control_roll=roll, control_pitch=pitch, rudder=yaw).find_maneuvers()
    assert [(m.axis, m.variable) for m in found] == [
        ("roll", "control_roll"), ("pitch", "control_pitch"), ("yaw", "rudder"),
    ]  # fmt: skip
    for one, start, stop in zip(found, (100.0, 120.0, 140.0), (102.0, 127.0, 142.0), strict=True):
        assert start - 1.5 < one.start <= start
        assert stop + 0.75 * LIMITS.tail <= one.stop < stop + 2.5
        assert one.whole == 1.0
    assert [m.swings for m in found] == [2, 4, 2]
    assert found[1].amplitude == pytest.approx(0.4, rel=0.3)


def test_what_is_no_maneuver_holes_inside_and_flights_without_a_speed() -> None:
    checks = signal((65.0, "doublet", 0.5), (175.0, "3211", 0.5))
    for u in (checks, np.where(TIME > 120.0, 0.3, 0.0), np.zeros(TIME.size), np.full(TIME.size, np.nan)):
        assert flight(elevator=u).find_maneuvers() == []
    assert flight().airborne().sum() == pytest.approx((170.0 - 80.0 - 6.0) * 100.0, abs=5)
    u = signal((100.0, "3211", 0.5))
    u[4300:4400] = np.nan
    (one,) = flight(elevator=u).find_maneuvers()
    assert 0.8 < one.whole < 0.95
    flown = from_columns("f", TIME, {"elevator": signal((65.0, "doublet", 0.5))})
    assert flown.airborne().all()
    assert len(flown.find_maneuvers()) == 1


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
    assert [m.axis for m in glider.find_maneuvers()] == ["pitch"]
    still = flight(**{f"motor_{n}": np.zeros(TIME.size) for n in range(1, 5)})
    assert not motors_ran(still)


def test_what_an_autopilot_answers_to_a_gust_is_no_maneuver() -> None:
    """The elevator, down for nose down, opposes a rate that it answers, and has the rate follow to the other side."""
    burst, calm = signal((120.0, "3211", 0.4)), 0.02 * np.random.default_rng(1).normal(size=TIME.size)
    rate = 0.02 * np.sin(TIME) + calm
    assert len(flight(elevator=burst, q=rate).find_maneuvers()) == 1
    assert flight(elevator=burst, q=2.0 * burst + 0.1 * calm).find_maneuvers() == []
    assert len(flight(elevator=burst, q=-2.0 * burst + 0.1 * calm).find_maneuvers()) == 1


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


def hover(seed: int = 0, **extra: FloatArray) -> Flight:
    """Return four motors at hover, each axis moved once; a rate decays with 0.3 s, as rotors damp it."""
    rng = np.random.default_rng(seed)
    calm = np.array([rng.normal(size=HOVER.size).cumsum() * 2e-4 for _ in AXES])
    since = HOVER - np.array([[75.0], [90.0], [105.0], [120.0]])  # doublets of 0.4 s
    moved = calm + 0.06 * (((since >= 0) & (since < 0.4)).astype(float) - ((since >= 0.4) & (since < 0.8)))
    motors = 0.5 + MIX @ moved
    pushed = (POWER[:3, None] * moved[:3]) / RATE
    rates = lfilter([0.0, 1.0], [1.0, -(1.0 - 1.0 / (0.3 * RATE))], pushed, axis=1)
    noise = rng.normal(size=(4, HOVER.size))
    columns = {f"motor_{i + 1}": m for i, m in enumerate(motors)}
    columns |= {n: r + 0.005 * e for n, r, e in zip("pqr", rates, noise[:3], strict=True)}
    columns["az"] = -9.8 - POWER[3] * moved[3] + 0.05 * noise[3]
    still = np.zeros(HOVER.size)
    return from_columns("hover", HOVER, {**columns, "vn": still, "ve": still, "vd": still, **extra})


@pytest.mark.parametrize("seed", range(2))
def test_the_axes_of_motors_are_found_by_what_they_turn(seed: int) -> None:
    flight = hover(seed)
    found = flight.find_maneuvers()
    assert [(m.axis, m.variable) for m in found] == [(axis, "motor_1..4") for axis in AXES]
    for begun, m in zip((75.0, 90.0, 105.0, 120.0), found, strict=True):
        assert m.stop - 4.0 < m.start <= begun <= m.stop - 0.8
    more = {"motor_5": np.full(HOVER.size, 0.1), "motor_6": flight.column("motor_1")}  # dead, and doubled
    assert [c.axis for c in hover(seed, **more).directions([f"motor_{n}" for n in range(1, 7)])] == [*AXES]
    silent = from_columns("f", HOVER, {n: flight.column(n) for n in ("motor_1", "motor_2", "motor_3", "vn")})
    assert silent.commands() == silent.find_maneuvers() == []


def test_a_direction_is_the_acceleration_that_it_gives() -> None:
    flight = hover()
    for command, power in zip(flight.commands(), POWER, strict=True):
        assert float(np.ptp(command.u)) == pytest.approx(0.12 * power, rel=0.35)
    assert flight.carried_by_rotors()  # a hover counts as flight though nothing moves
    assert flight.flying().all()
    assert not flight.airborne().any()


def test_take_off_landing_and_idling_are_no_flight() -> None:
    base = hover()
    up = (HOVER > 80.0) & (HOVER < 130.0)
    idle = {f"motor_{n}": np.where(up, base.column(f"motor_{n}"), 0.06) for n in range(1, 5)}
    flown = hover(**idle).flying()
    assert HOVER[flown][0] == pytest.approx(83.0, abs=0.1)
    assert HOVER[flown][-1] == pytest.approx(127.0, abs=0.1)


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_motors_off(value: float) -> None:
    off = {f"motor_{n}": np.full(HOVER.size, value) for n in range(1, 5)}
    flight = hover(**off, control_throttle=np.zeros(HOVER.size))
    told = flight.lift_command()
    assert told is None or not np.nan_to_num(told).any()
    assert flight.commands() == []
    assert not motors_ran(hover(**{f"motor_{n}": np.full(HOVER.size, 0.01) for n in range(1, 5)}))  # idling
    assert motors_ran(hover())


def test_pulses_are_read_above_idle() -> None:
    base = hover()
    pulses = {f"pwm_{n}": 1000.0 + 900.0 * base.column(f"motor_{n}") for n in range(1, 5)}
    columns = {n: base.column(n) for n in ("p", "q", "r", "az", "vn", "ve", "vd")}
    force = {"ax": 0 * HOVER, "ay": 0 * HOVER, "altitude": np.where(HOVER < 70.0, 0.0, 5.0)}
    flight = from_columns("f", HOVER, {**columns, **force, **pulses})
    assert flight.carried_by_rotors()
    assert np.median(flight.lift_command()) == pytest.approx(0.45, abs=0.02)  # type: ignore[arg-type]
    assert [m.variable for m in flight.find_maneuvers()] == ["pwm_1..4"] * 4


@pytest.fixture(scope="module", params=["quad-x", "hexa-x"])
def copter(request: pytest.FixtureRequest) -> Flight:
    """Return a flight in which nothing is left of motors but pulses in whole microseconds."""
    flight = simulate_flight(load_vehicle(request.param), FLOWN, seed=3, name="f")
    columns = {name: flight.column(name) for name in flight.channels}
    for name in [n for n in columns if "motor_" in n]:
        columns[name.replace("motor_", "pwm_")] = np.round(1e3 + 1e3 * columns.pop(name))
    return from_columns("pulsed", flight.time, columns)


def test_a_flight_shorter_than_a_block_shows_no_motors() -> None:
    for samples in (2, 3, 9, 10):
        ripple = np.sin(np.arange(samples) + np.arange(6)[:, None])
        pulses = {f"pwm_{n}": 1500.0 + 20.0 * ripple[n - 1] for n in range(1, 5)}
        brief = from_columns("brief", 0.01 * np.arange(samples), {**pulses, "p": ripple[4], "q": ripple[5]})
        assert brief.rotor_pulses() == [], samples
        assert not brief.carried_by_rotors(), samples


def test_pulses_that_turn_a_copter_are_motors(copter: Flight) -> None:
    """Also in gusts, where motors explain a few hundredths of the angular accelerations, filtered to 0.1 s."""
    motors = [str(name) for name in copter.data.data_vars if str(name).startswith("pwm_")]
    assert copter.rotor_pulses() == motors
    assert copter.carried_by_rotors()
    assert copter.flying().all()
    assert [m.axis for m in copter.find_maneuvers()] == ["roll", "pitch", "yaw"]
    rng, n = np.random.default_rng(1), copter.time.size
    columns = {str(name): copter.column(str(name)) for name in copter.data.data_vars}
    gusts = {rate: columns[rate] + 0.04 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n] for rate in "pq"}
    assert from_columns("g", copter.time, {**columns, **gusts}).rotor_pulses() == motors


def test_a_gimbal_and_a_dead_output_are_no_motors(copter: Flight) -> None:
    gimbal, dead = 1130.0 + 30.0 * np.sin(copter.time), np.full(copter.time.size, 1000.0)
    columns = {str(name): copter.column(str(name)) for name in copter.data.data_vars}
    more = from_columns("f", copter.time, {**columns, "pwm_9": 120.0 + gimbal, "pwm_10": dead})
    assert more.rotor_pulses() == copter.rotor_pulses()
    pulses = np.median([copter.column(x) for x in copter.rotor_pulses()])
    assert np.median(more.lift_command()) == pytest.approx(pulses / 1e3 - 1.0, rel=0.01)  # type: ignore[arg-type]


def test_surfaces_of_any_effect_are_no_motors() -> None:
    rng, t = np.random.default_rng(0), np.arange(6000) / 100.0
    tones = rng.random((2, 5, 3)) * [0.2, 4.0, 1.0]
    phi, theta = (sum(a * np.sin(w * t + 6.0 * b) for a, w, b in one) for one in tones)
    p, q = np.gradient(phi, t), np.gradient(theta, t)
    law = ((-1, phi, p), (-1, phi, p), (1, theta, q), (-1, theta, q))
    pulses = {f"pwm_{i}": np.round(1500.0 - s * 400.0 * (x + 0.2 * v)) for i, (s, x, v) in enumerate(law, 1)}
    noise = 0.01 * rng.normal(size=(2, t.size))
    motion = {"p": p + noise[0], "q": q + noise[1], "r": 0.0 * t, "az": 0.0 * t - 9.8}
    plane = from_columns("p", t, {**pulses, **motion})
    assert plane.rotor_pulses() == []
    assert not plane.carried_by_rotors()
    t = np.arange(4000) / 100.0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        waves = rng.normal(size=(rng.integers(4, 8), t.size))
        moved = np.array([np.convolve(x, np.full(15, 1 / 15), "same") for x in waves])
        effect = rng.normal(size=(2, len(moved))) * (rng.random((2, len(moved))) < 0.5)
        p, q = 5e-4 * np.cumsum(effect @ moved, axis=1) + 2e-3 * rng.normal(size=(2, t.size))
        pulses = {f"pwm_{i + 1}": np.round(1500.0 + 300.0 * x) for i, x in enumerate(moved)}
        assert from_columns("p", t, {**pulses, "p": p, "q": q}).rotor_pulses() == [], seed
