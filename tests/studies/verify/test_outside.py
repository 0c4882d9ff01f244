import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.units import FACTORS
from stoop.flight import load_flight
from stoop_draft.vehicle_draft.draft import draft
from stoop_draft.vehicle_draft.request import Request
from stoop_studies.verify import lines, outside, outside_aircraft, outside_rotors, recorders
from stoop_studies.verify.outside_aircraft import Airframe, OutsideFlight, State

RATE = 100.0
QUIET = recorders.Recorder(
    "flight_test", dict.fromkeys((*recorders.SENSORS, "commands"), 50.0), {"gps": 0.2, "commands": 0.1}, True, 0.0, False, 0, ()
)  # fmt: skip


def tumbling(count: int = 1500) -> OutsideFlight:
    time = np.arange(count) / RATE
    names = [n for one in recorders.SENSORS.values() for n in one if n not in ("pn", "pe", "pd")]
    names += ["elevator", "aileron", "rudder", "control_pitch", "control_throttle", "motor_1", "rotor_1"]
    columns = {n: 0.5 + 0.3 * np.sin((0.7 + 0.11 * k) * time + k) for k, n in enumerate(names)}
    return OutsideFlight(RATE, columns, {"mass": 1.0, "span": 1.0, "chord": 0.2}, lambda file: file, {})


def naive_sample(x: FloatArray, when: float) -> float:
    return float([x[0], *(value for k, value in enumerate(x) if k / RATE <= when + 1e-9)][-1])


@pytest.mark.parametrize("held", [True, False])
def test_rows_hold_or_interpolate_the_readings_of_each_sensor(held: bool) -> None:
    rates = {"imu": 50.0, "attitude": 25.0, "gps": 5.0, "air": 10.0, "commands": 20.0}
    recorder = replace(QUIET, rates=rates, held=held)
    columns = tumbling(400).columns
    time, rows = recorders.sampled(columns, RATE, recorder)
    assert np.allclose(np.diff(time), 0.02)
    for name, sensor, late in (
        ("p", "imu", 0.0), ("phi", "attitude", 0.0), ("vn", "gps", 0.2), ("V", "air", 0.0), ("elevator", "commands", -0.1),
    ):  # fmt: skip
        for k in range(0, len(time) - 12, 7):
            reading = int(time[k] * rates[sensor] + 1e-9)
            moments = (m / rates[sensor] - late for m in (reading, reading + 1))
            before, after = (naive_sample(columns[name], m) for m in moments)
            share = 0.0 if held else time[k] * rates[sensor] - reading
            assert rows[name][k] == pytest.approx(before + share * (after - before), abs=1e-12)


@pytest.mark.parametrize("dialect", recorders.DIALECTS)
def test_a_right_mapping_reads_what_was_measured(dialect: str, tmp_path: Path) -> None:
    recorder = replace(QUIET, dialect=dialect)
    log = recorders.write(tumbling(), recorder, np.zeros(3), tmp_path, np.random.default_rng(1))
    assert not lines.misread(log.path, log.mapping, log.shown, log.lines)
    (tmp_path / "m.toml").write_text(log.mapping)
    assert set(tomllib.loads(log.mapping)["variables"]) == set(log.lines)
    assert load_flight(log.path, tmp_path / "m.toml").time[0] == pytest.approx(log.start, abs=0.02)


def test_frames_and_units_are_those_of_the_catalogue() -> None:
    """Forward, left, up over east, north, up of ROS; feet per minute up; hundredths; pulses."""
    known = {"q": 0.1, "az": -9.8, "vd": -1.0, "control_pitch": 0.25, "psi": 0.0}
    columns = {n: np.array([x, x]) for n, x in known.items()}
    for dialect, name, expected in (
        ("ros", "q", -0.1), ("ros", "az", 9.8), ("ros", "vd", 1.0), ("flight_test", "vd", 60.0 / 0.3048),
        ("ros", "psi", np.pi / 2),  # north is a quarter to the left of east
        ("telemetry", "control_pitch", 1600.0), ("nano_logger", "control_pitch", 25.0),
    ):  # fmt: skip
        _, unit, factor, offset = recorders.rows_of(replace(QUIET, dialect=dialect), columns)[name]
        assert (known[name] - offset) / (factor * FACTORS[unit]) == pytest.approx(expected), (dialect, name)


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


@pytest.fixture(scope="module")
def cub() -> OutsideFlight:
    pytest.importorskip("jsbsim")
    return outside_aircraft.fly(outside.AIRCRAFT["J3Cub"], 0)


def test_truth_of_the_lift_slope_is_that_of_the_simulators_accelerations(cub: OutsideFlight) -> None:
    """Vertical acceleration over alpha at rest rates, in JSBSim's own units, without anything of the truth's code."""
    size = (cub.tape["mass"], cub.tape["span"], cub.tape["chord"])
    drafted = draft(Request("conventional", *size, engine=cub.asked["engine"])).vehicle
    truth = cub.truth(drafted, cub.columns, False)
    airframe = Airframe(outside.AIRCRAFT["J3Cub"])
    V, height, alpha = (float(cub.columns[n].mean()) for n in ("V", "altitude", "alpha"))
    step, lifts = 0.01, []
    for a in (alpha - step, alpha + step):
        airframe.put(State(V, height, alpha=a, theta=a), dict.fromkeys(outside_aircraft.SURFACES, 0.0))
        pressure_area = airframe["aero/qbar-psf"] * airframe["metrics/Sw-sqft"]
        lifts.append(airframe["forces/fwz-aero-lbs"] / pressure_area)
    slope = (lifts[1] - lifts[0]) / (2.0 * step)
    # the rate of alpha acts on the lift, and its change with alpha is part of the slope in both
    assert truth.value("CLalpha") == pytest.approx(slope, rel=0.05)


@pytest.mark.parametrize("package", ["rotorpy", "crazyflow"])
def test_a_quadrotor_obeys_its_constants(package: str) -> None:
    """In a hover in calm air the accelerometer feels the thrusts alone; shaken, moments over inertia turn the body."""
    pytest.importorskip(package)  # crazyflow is of the extra "outside"
    flying = outside_rotors.RotorPy("hummingbird") if package == "rotorpy" else outside_rotors.MuJoCo("cf2")
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


def test_one_flight_goes_from_log_to_record(tmp_path: Path) -> None:
    pytest.importorskip("jsbsim")
    found = outside.record("J3Cub", 2, tmp_path)
    assert not found["stopped"]
    assert {"CLalpha", "Cmq", "Claileron"} <= set(found["numbers"])
    shown = outside.show(outside.Setting(1), {"J3Cub": [found], "F4N": [{"kept": True}]})
    assert [row[0] for row in shown.rows] == ["J3Cub"]
    assert len(shown.claims) == 11
