from __future__ import annotations

import tomllib
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.units import FACTORS
from stoop.errors import StoopError
from stoop.flight import from_columns, load
from stoop.results.result import Covariance
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.checks import is_body
from stoop.vehicle_draft.draft import draft
from stoop.vehicle_draft.request import Request
from stoop_studies.verify import instruments, lines, outside, outside_aircraft, outside_rotors, recorders
from stoop_studies.verify.outside_aircraft import Airframe, OutsideFlight, State

RATE = 100.0
QUIET = recorders.Recorder(
    "flight_test", dict.fromkeys((*recorders.SENSORS, "commands"), 50.0), {"gps": 0.2, "commands": 0.1}, True, 0.0, False, 0, ()
)  # fmt: skip


def tumbling(count: int = 1500) -> OutsideFlight:
    """Return a flight of smooth columns, no two alike."""
    time = np.arange(count) / RATE
    names = [n for one in recorders.SENSORS.values() for n in one if n not in ("pn", "pe", "pd")]
    names += ["elevator", "aileron", "rudder", "control_pitch", "control_throttle", "motor_1", "rotor_1"]
    columns = {n: 0.5 + 0.3 * np.sin((0.7 + 0.11 * k) * time + k) for k, n in enumerate(names)}
    return OutsideFlight(RATE, columns, {"mass": 1.0, "span": 1.0, "chord": 0.2}, lambda file: file, {})


def naive_sample(x: FloatArray, when: float) -> float:
    """Return the last sample at a time, or the first."""
    last = x[0]
    for k, value in enumerate(x):
        if k / RATE <= when + 1e-9:
            last = value
    return float(last)


@pytest.mark.parametrize("held", [True, False])
def test_rows_hold_or_interpolate_the_readings_of_each_sensor(held: bool) -> None:
    rates = {"imu": 50.0, "attitude": 25.0, "gps": 5.0, "air": 10.0, "commands": 20.0}
    recorder = replace(QUIET, rates=rates, held=held)
    columns = tumbling(400).columns
    time, rows = recorders.sampled(columns, RATE, recorder)
    assert np.allclose(np.diff(time), 0.02)
    sensors = {
        "p": ("imu", 0.0),
        "phi": ("attitude", 0.0),
        "vn": ("gps", 0.2),
        "V": ("air", 0.0),
        "elevator": ("commands", -0.1),
    }
    for name, (sensor, late) in sensors.items():
        for k in range(0, len(time) - 12, 7):
            reading = int(time[k] * rates[sensor] + 1e-9)
            before, after = (
                naive_sample(columns[name], m / rates[sensor] - late) for m in (reading, reading + 1)
            )
            share = 0.0 if held else time[k] * rates[sensor] - reading
            assert rows[name][k] == pytest.approx(before + share * (after - before), abs=1e-12)


@pytest.mark.parametrize("dialect", recorders.DIALECTS)
def test_a_right_mapping_reads_what_was_measured(dialect: str, tmp_path: Path) -> None:
    recorder = replace(QUIET, dialect=dialect)
    log = recorders.write(tumbling(), recorder, np.zeros(3), tmp_path, np.random.default_rng(1))
    assert not lines.misread(log.path, log.mapping, log.shown, log.lines)
    (tmp_path / "m.toml").write_text(log.mapping)
    rows = tomllib.loads(log.mapping)["variables"]
    clock = tomllib.loads(log.mapping)["time"]
    assert FACTORS[clock["unit"]] > 0.0
    assert set(rows) == set(log.lines)
    assert load(log.path, tmp_path / "m.toml").time[0] == pytest.approx(log.start, abs=0.02)


def test_frames_and_units_are_those_of_the_catalogue() -> None:
    """Forward, left, up over east, north, up of ROS; feet per minute up; hundredths; pulses."""
    columns = {
        n: np.array([x, x])
        for n, x in {"q": 0.1, "az": -9.8, "vd": -1.0, "control_pitch": 0.25, "psi": 0.0}.items()
    }

    def written(dialect: str, name: str) -> float:
        _, unit, factor, offset = recorders.rows_of(replace(QUIET, dialect=dialect), columns)[name]
        return float((columns[name][0] - offset) / (factor * FACTORS[unit]))

    assert written("ros", "q") == -0.1
    assert written("ros", "az") == 9.8
    assert written("ros", "vd") == 1.0
    assert written("ros", "psi") == pytest.approx(np.pi / 2)  # north is a quarter to the left of east
    assert written("flight_test", "vd") == pytest.approx(60.0 / 0.3048)
    assert written("telemetry", "control_pitch") == pytest.approx(1600.0)
    assert written("nano_logger", "control_pitch") == pytest.approx(25.0)


def test_an_accelerometer_off_the_center_feels_turning() -> None:
    flight = tumbling()
    arm = np.array([0.4, -0.1, 0.2])
    read = recorders.measured(flight.columns, RATE, QUIET, arm, np.random.default_rng(0))
    k = 700
    omega = np.array([flight.columns[a][k] for a in "pqr"])
    faster = np.array([(flight.columns[a][k + 1] - flight.columns[a][k - 1]) * RATE / 2.0 for a in "pqr"])
    felt = np.cross(faster, arm) + np.cross(omega, np.cross(omega, arm))
    moved = np.array([read[f"a{a}"][k] - flight.columns[f"a{a}"][k] for a in "xyz"])
    still = recorders.measured(flight.columns, RATE, QUIET, 0.0 * arm, np.random.default_rng(0))
    own = np.array([still[f"a{a}"][k] - flight.columns[f"a{a}"][k] for a in "xyz"])
    assert np.allclose(moved - own, felt, atol=1e-4)


def test_noise_is_drawn_column_by_column() -> None:
    """Beside a twin that draws in the order of the columns: the same seed writes the same log in every process."""
    recorder, true = replace(QUIET, noise=1.0), tumbling(200).columns
    read = recorders.measured(true, RATE, recorder, np.zeros(3), np.random.default_rng(3))
    rng = np.random.default_rng(3)
    still = instruments.without_noise(true, RATE, np.zeros(3))
    for name, x in still.items():
        want = x
        if name in instruments.NOISE or name in instruments.DRIFT:
            if name in instruments.DRIFT:
                want = want + instruments.drifting(rng, len(x), RATE, *instruments.DRIFT[name])
            want = want + instruments.NOISE[name] * rng.standard_normal(len(x))
            want = want + instruments.BIASES.get(name, 0.0) * rng.standard_normal()
        assert np.allclose(read[name], want, rtol=0.0, atol=1e-12)


def test_vehicles_and_kinds_of_logs_of_the_last_run_are_not_flown_before() -> None:
    assert 0.25 < len(outside.KEPT) / len(outside.CASES) < 0.45
    assert outside.examine({"case": min(outside.KEPT), "seed": 0}, [None]) == [{"kept": True}]
    tape = {"mass": 1.0, "span": 1.0, "chord": 0.2}
    for seed in range(40):
        assert outside.drawn("J3Cub", seed, tape)[0].dialect not in outside.KEPT_DIALECTS
        assert outside.drawn("J3Cub", outside.ONCE + seed, tape)[0].dialect in outside.KEPT_DIALECTS


@pytest.fixture(scope="module")
def cub() -> OutsideFlight:
    pytest.importorskip("jsbsim")
    return outside_aircraft.fly(outside.AIRCRAFT["J3Cub"], 0)


def drafted(flight: OutsideFlight) -> Vehicle:
    """Return the vehicle that a person would draft of what flew."""
    size = (flight.tape["mass"], flight.tape["span"], flight.tape["chord"])
    return draft(Request("conventional", *size, engine=flight.asked["engine"])).vehicle


def test_truth_of_the_lift_slope_is_that_of_the_simulators_accelerations(cub: OutsideFlight) -> None:
    """Vertical acceleration over alpha at rest rates, in JSBSim's own units, without anything of the truth's code."""
    truth = cub.truth(drafted(cub), cub.columns, False)
    airframe = Airframe(outside.AIRCRAFT["J3Cub"])
    V, height, alpha = (float(cub.columns[n].mean()) for n in ("V", "altitude", "alpha"))
    step, lifts = 0.01, []
    for a in (alpha - step, alpha + step):
        airframe.put(State(V, height, alpha=a, theta=a), dict.fromkeys(outside_aircraft.SURFACES, 0.0))
        lifts.append(
            airframe["forces/fwz-aero-lbs"] / (airframe["aero/qbar-psf"] * airframe["metrics/Sw-sqft"])
        )
    slope = (lifts[1] - lifts[0]) / (2.0 * step)
    # the rate of alpha acts on the lift, and its change with alpha is part of the slope in both
    assert truth.value("CLalpha") == pytest.approx(slope, rel=0.05)


def test_truth_of_a_flight_in_gusts_is_that_in_calm_air(cub: OutsideFlight) -> None:
    blown, file = outside_aircraft.fly(outside.AIRCRAFT["J3Cub"], 0, "moderate"), drafted(cub)
    true = [flight.truth(file, cub.columns, False) for flight in (cub, blown)]
    terms = [p.name for p in file.parameters if p.name.startswith("C")]
    assert [true[1].value(n) for n in terms] == pytest.approx([true[0].value(n) for n in terms], rel=1e-6)


def test_engines_of_an_aircraft_that_is_put_into_a_state_run_as_in_flight() -> None:
    """A second later they still do."""
    pytest.importorskip("jsbsim")
    airframe, rpm = Airframe(outside.AIRCRAFT["J3Cub"]), "propulsion/engine[0]/propeller-rpm"
    airframe.put(State(35.0, 600.0, alpha=-0.03, theta=-0.03), dict.fromkeys(outside_aircraft.SURFACES, 0.0))
    begun = airframe[rpm]
    for _ in range(round(outside_aircraft.RATE)):
        airframe.fdm.run()
    assert airframe[rpm] == pytest.approx(begun, rel=0.02)


def test_truth_of_a_linear_model_is_what_its_file_says() -> None:
    """The F-4N of the package has constant derivatives, of body-axis moments about its reference point on the wing."""
    pytest.importorskip("jsbsim")
    flight = outside_aircraft.fly(outside.AIRCRAFT["F4N"], 0)
    truth = flight.truth(drafted(flight), flight.columns, False)
    own = {
        "CQbeta": -1.0,
        "Clp": -0.4,
        "Clr": 0.13,
        "Cnbeta": 0.12,
        "Cnr": -0.15,
        "Cnrudder": -0.08,
        "CLelevator": 0.25,
    }
    assert {n: truth.value(n) for n in own} == pytest.approx(own, rel=0.02)
    assert truth.value("mass.mass") == pytest.approx(flight.tape["mass"])


def test_a_damper_is_part_of_the_vehicle_to_a_log_of_sticks() -> None:
    """The F-4N's rudder answers the yaw rate; by the flight's own accelerations, over what the pedals ask for."""
    pytest.importorskip("jsbsim")
    flight = outside_aircraft.fly(outside.AIRCRAFT["F4N"], 0)
    columns, file = flight.columns, drafted(flight)
    truth = flight.truth(file, flight.by_sticks(), True)
    names = ("beta", "p", "r", "control_roll", "control_yaw")
    X = np.column_stack([np.ones(len(columns["r"])), *(columns[n] for n in names)])
    rates = np.gradient(columns["r"], 1.0 / outside_aircraft.RATE)
    _, by_beta, _, by_r, _, by_pedals = np.linalg.lstsq(X, rates, rcond=None)[0]
    span = flight.tape["span"] / (2.0 * columns["V"].mean())
    assert truth.value("Cnr") * span / truth.value("Cnbeta") == pytest.approx(by_r / by_beta, rel=0.05)
    pedals = truth.value("Cnrudder") * flight.stick_gain["rudder"]
    assert pedals / truth.value("Cnbeta") == pytest.approx(by_pedals / by_beta, rel=0.05)
    assert truth.value("Cnr") < 2.0 * flight.truth(file, columns, False).value("Cnr") < 0.0


def test_truth_of_what_bends_is_a_least_squares_fit_over_what_was_flown(cub: OutsideFlight) -> None:
    """The Cub's drag goes with the absolute sideslip, of which most of a flight has little."""
    some = {n: x[:: round(outside_aircraft.RATE)] for n, x in cub.columns.items()}
    truth, airframe = cub.truth(drafted(cub), some, False), Airframe(outside.AIRCRAFT["J3Cub"])
    V, height, alpha = (float(some[n].mean()) for n in ("V", "altitude", "alpha"))
    drags = []
    for beta in some["beta"].tolist():
        state = State(V, height, alpha=alpha, beta=beta, theta=alpha)
        airframe.put(state, dict.fromkeys(outside_aircraft.SURFACES, 0.0))
        drags.append(
            -airframe["forces/fwx-aero-lbs"] / (airframe["aero/qbar-psf"] * airframe["metrics/Sw-sqft"])
        )
    curvature = abs(np.polyfit(some["beta"], drags, 2)[0])
    assert truth.value("CDbeta2") == pytest.approx(curvature, rel=0.2)


def test_an_aircraft_whose_moments_are_those_of_no_body_has_true_derivatives() -> None:
    """The MD-11 of the package: its file, in slug ft2, breaks the triangle inequality by 8 %."""
    pytest.importorskip("jsbsim")
    flight = outside_aircraft.fly(outside.AIRCRAFT["MD11"], 0)
    truth = flight.truth(drafted(flight), flight.columns, False)
    moments = [truth.value(f"mass.inertia.{a}") for a in ("xx", "yy", "zz")]
    assert moments == pytest.approx([x * 1.3558179 for x in (1.3185e7, 3.83816e7, 5.56127e7)], rel=1e-4)
    assert moments[2] > sum(moments[:2])
    assert not is_body(truth)
    assert is_body(drafted(flight))
    assert truth.value("Cmalpha") < 0.0 < truth.value("CLalpha")


def test_the_same_seed_flies_the_same_flight(cub: OutsideFlight) -> None:
    again = outside_aircraft.fly(outside.AIRCRAFT["J3Cub"], 0)
    assert all(np.array_equal(x, again.columns[n]) for n, x in cub.columns.items())


@pytest.mark.parametrize(
    ("package", "made"),
    [
        (package, made)
        for package, made in (("rotorpy", outside_rotors.RotorPy), ("crazyflow", outside_rotors.MuJoCo))
        if package == "rotorpy" or find_spec(package)  # the other one is of the extra "outside"
    ],
)
def test_a_quadrotor_obeys_its_constants(package: str, made: type[outside_rotors.RotorPy]) -> None:
    """In a hover in calm air the accelerometer feels the thrusts alone; shaken, moments over inertia turn the body."""
    flying = made("hummingbird" if package == "rotorpy" else "cf2")
    craft, place = flying.craft, np.array([0.0, 0.0, outside_rotors.HEIGHT])
    shakes = [np.array([0.0, 0.0, 0.0])] * 60 + [np.array([2.0, 0.0, 0.0])] * 20
    rows = [flying.advance(place, shake, np.zeros(3)) for shake in shakes]
    columns = outside_rotors.columns_of({n: np.array([r[n] for r in rows]) for n in rows[0]}, craft)
    lifts = craft.numbers["rotors.T2"] * np.array([columns[f"rotor_{i}"] for i in range(1, 5)]) ** 2
    assert np.allclose(-craft.numbers["mass.mass"] * columns["az"], lifts.sum(axis=0), rtol=2e-3)
    arms = craft.positions[craft.order]
    assert np.sign(arms[:, :2]).tolist() == [list(side) for side in outside_rotors.PX4_ORDER]
    moment = -arms[:, 1] @ lifts  # thrust acts upward, to the right of the center it rolls to the left
    if package == "rotorpy":  # whose rotors change their speeds within a sample
        moment = 0.5 * (moment + np.roll(moment, -1))
    turned = np.roll(columns["p"], -1) - columns["p"]
    shaken = slice(61, 78)
    slope = np.polyfit(moment[shaken], turned[shaken] * outside_rotors.RATE, 1)[0]
    assert slope * craft.numbers["mass.inertia.xx"] == pytest.approx(1.0, rel=0.1)


def test_a_simulator_that_is_not_installed_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def lacking(name: str) -> None:
        raise ModuleNotFoundError("no", name="mujoco")

    monkeypatch.setitem(outside_rotors.SIMULATORS, "mujoco", lacking)
    with pytest.raises(
        StoopError, match="outside: mujoco_cf2 needs the package mujoco, which is not installed; pip install"
    ):
        outside.fly("mujoco_cf2", 0)


def test_a_wrong_line_is_judged_beside_the_flight(cub: OutsideFlight, tmp_path: Path) -> None:
    found = outside.planted("J3Cub", 1, cub, tmp_path)
    assert found["said"] in ("named", "ambiguous", "silent", "wrong")
    assert (found["said"] == "silent") == (not found["codes"])
    log = outside.logged("J3Cub", 1, cub, tmp_path)
    mapping, edits = outside.mapped(log, tmp_path)
    text = mapping.read_text()
    assert (text == log.mapping) == any(edits.values())
    assert not lines.misread(log.path, text, log.shown, log.lines, lines.CALIBRATED)


def test_exchanged_motors_are_asked_of_the_vehicle_file() -> None:
    """A mapping says nothing of places; what is named, and followed literally, is the exchange."""
    inputs = "".join(
        f'[[input]]\ncontrol = "{axis}"\nshape = "3-2-1-1"\nstart = {start}\nstep = 0.15\namplitude = {size}\n'
        for axis, start, size in (("roll", 1, 8), ("pitch", 4, 8), ("yaw", 7, 3))
    )
    vehicle, pair = builtin_vehicle("quad-x"), ("motor_2", "motor_4")
    flown = simulate_flight(
        vehicle, parse_maneuver("duration = 10.0\nrate = 100.0\n" + inputs, "m"), seed=1, name="sim"
    )
    columns = {str(n): flown.column(str(n)) for n in flown.data.data_vars}
    wrong = from_columns("sim", flown.time, lines.swap(*pair).apply(columns), ())
    told = outside.moments(vehicle, replace(wrong, sources=flown.sources))
    named, left = outside.exchanged(vehicle, told, pair)
    assert (lines.verdict(named, pair), left) == ("named", [])
    assert outside.moments(vehicle, flown) == []
    assert outside.exchanged(vehicle, [], pair) == ([], [*pair])


def test_one_flight_goes_from_log_to_record(tmp_path: Path) -> None:
    pytest.importorskip("jsbsim")
    found = outside.record("J3Cub", 2, tmp_path)
    assert not found["stopped"]
    assert {"CLalpha", "Cmq", "Claileron"} <= set(found["numbers"])
    shown = outside.show(outside.Setting(1), {"J3Cub": [found], "F4N": [{"kept": True}]})
    assert [row[0] for row in shown.rows] == ["J3Cub"]
    assert len(shown.claims) == 11


@pytest.mark.parametrize("lag", [0.0, 0.003, 0.05])
def test_speeds_of_rotors_bend_within_a_sample(lag: float) -> None:
    """The mean of a step that is held, after a lag, against straight lines: by how much they are early, over the step."""
    held, craft = 0.01, outside_rotors.Rotorcraft({"rotors.lag": lag}, np.zeros((4, 3)), held=0.01)
    time = np.linspace(0.0, held, 20001)
    bent = np.exp(-time / lag) if lag else (time == 0.0).astype(float)
    early = np.trapezoid(bent - np.interp(time, time[[0, -1]], bent[[0, -1]]), time) / (bent[0] - bent[-1])
    assert craft.late["motor"] == 0.5 * held
    if lag:
        assert craft.late["rotor"] == pytest.approx(early, abs=1e-6)


def test_a_lag_that_is_not_integrated_shows_as_a_delay() -> None:
    names, matrix = ("rotors.lag", "rotors.delay"), np.array([[4e-6, -3e-6], [-3e-6, 4e-6]])
    short = {"rotors.lag": [0.002, 2e-3, 0.005, 0.0, 1.0], "rotors.delay": [0.008, 2e-3, 0.005, 0.0, 1.0]}
    (row,) = outside_rotors.with_sum(short, Covariance(names, matrix)).values()
    assert row == pytest.approx([0.01, np.sqrt(2e-6), 0.01, 0.0, 1.0])
    slow = short | {"rotors.lag": [0.05, 2e-3, 0.05, 0.0, 1.0]}
    assert outside_rotors.with_sum(slow, Covariance(names, matrix)) == slow
