"""JSBSim as the independent truth: exports accelerate and fly there as our equations say."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.base.files import write_files
from stoop.base.rotations import to_body
from stoop.errors import SimulationError
from stoop.simulation import trim
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle, load_vehicle
from stoop.vehicle.document import with_entries
from stoop_export import jsbsim_aircraft
from stoop_export import jsbsim_flight as js
from stoop_export.jsbsim_comparison import compare
from stoop_export.reference_flight import reference_record
from stoop_studies.verify.export import INPUTS, load

SCATTERED = ("alpha", "beta", "p", "q", "r", "phi", "theta", "psi")


def exported(root: Path, vehicle: Vehicle) -> str:
    write_files(root, jsbsim_aircraft.folder(vehicle, None))
    return js.file_name(vehicle.name)


@pytest.mark.parametrize("variant", ["", "stated inertia", "heavy propeller"])
@pytest.mark.parametrize("name", ["twin-boom", "v-tail", "flying-wing", "crooked"])
def test_accelerations_at_random_states(name: str, variant: str, tmp_path: Path) -> None:
    """No time passes: forces, moments, the full inertia tensor and its inverse, arms, units, signs."""
    vehicle = load(name)
    if variant == "heavy propeller":
        vehicle = parse_vehicle(vehicle.text.replace("\nspeed_gain", "\ninertia = -0.01\nspeed_gain"), name)
    if variant == "stated inertia":
        shares = (("xx", 0.9), ("yy", 1.2), ("zz", 0.8))
        inertia = [share * vehicle.value(f"mass.inertia.{axes}") for axes, share in shares]
        vehicle = with_entries(vehicle, {("reference", "inertia"): inertia})
    aircraft, random = exported(tmp_path, vehicle), np.random.default_rng(11)
    rows, point = vehicle.parameter_rows(), trim(vehicle, None, 200.0)
    # JSBSim's atmosphere: 8.1e-6
    tolerance = 1e-5 if vehicle.file.environment.density == "standard" else 1e-9
    for _ in range(5):
        start = {c: point.start.get(c, 0.0) + 0.2 * random.standard_normal() for c in SCATTERED}
        start |= {"V": point.start["V"] * random.uniform(0.7, 1.3), "h": random.uniform(100.0, 2000.0)}
        inputs = point.inputs * (1.0 + 0.1 * random.standard_normal(len(point.inputs)))
        record = js.Record(vehicle, start, np.array([0.0, 0.01]), np.stack([inputs, inputs]))
        flown = js.fly(tmp_path, aircraft, record, tmp_path / jsbsim_aircraft.PLANET)
        states = vehicle.initial_states(start, rows, inputs)
        rates, readings = vehicle.kernel().evaluate(rows, states, inputs[:, None])
        turning = np.array([flown[k][0] for k in ("pdot", "qdot", "rdot")])
        ours = rates[[vehicle.states.index(c) for c in "pqr"], 0]
        assert turning == pytest.approx(ours, rel=tolerance, abs=tolerance * np.abs(ours).max())
        if "sensors.accelerometer_position.x" not in vehicle.rows:
            felt = np.array([flown[axis][0] / flown["mass"][0] for axis in "XYZ"])
            ours = readings[[vehicle.outputs.index(c) for c in ("ax", "ay", "az")], 0]
            ours = ours - [vehicle.value(f"sensors.{c}.bias") for c in ("ax", "ay", "az")]
            assert felt == pytest.approx(ours, rel=tolerance, abs=tolerance * np.abs(ours).max())


def apart(root: Path, record: js.Record, steps: int = 1) -> float:
    name = exported(root, record.vehicle)
    flown = js.jsbsim_readings(root, name, record, root / jsbsim_aircraft.PLANET)
    found = js.relative_differences(record.vehicle.outputs, js.own_readings(record, steps), flown)
    return max(found.values())


@pytest.mark.parametrize(("name", "most"), [("twin-boom", 1e-4), ("v-tail", 1e-4), ("flying-wing", 3e-4)])
def test_thirty_seconds_open_loop(name: str, most: float, tmp_path: Path) -> None:
    point = trim(vehicle := load(name), None, 200.0)
    record = js.maneuver_record(vehicle, point, INPUTS["3-2-1-1, doublets"](vehicle, point))
    assert record.time[-1] == 30.0
    assert apart(tmp_path, record) < most


@pytest.mark.parametrize("delays", [(0.0237, 0.0004), (0.02, 0.01)])
def test_delays_of_any_length(delays: tuple[float, float], tmp_path: Path) -> None:
    """Less than a frame, whole frames, whole samples, none of these: on JSBSim's frames all fly alike."""
    names = ("controls.elevator.delay", "controls.aileron.delay")
    vehicle = load("crooked").with_numbers({n: {"value": d} for n, d in zip(names, delays, strict=True)})
    point = trim(vehicle, None, 200.0)
    record = js.maneuver_record(vehicle, point, js.every_control(vehicle, point, 10.0))
    assert apart(tmp_path, record, 10) < 1e-4


def test_servos_with_play_and_a_rate_limit(tmp_path: Path) -> None:
    play = {("controls", c, "dead_zone"): x for c, x in (("elevator", 0.01), ("aileron", 0.02))}
    plain = load("crooked")
    vehicle = with_entries(plain, play | {("controls", "elevator", "rate_limit"): 0.15})
    point = trim(vehicle, None, 200.0)
    record = js.maneuver_record(vehicle, point, js.every_control(vehicle, point, 10.0))
    free = replace(record, vehicle=plain.with_numbers({n: {"value": v} for n, v in point.changes.items()}))
    shown = js.relative_differences(plain.outputs, js.own_readings(free), js.own_readings(record))
    assert max(shown.values()) > 0.05, "it shows"
    assert apart(tmp_path, record, 10) < 2e-4


def test_a_surface_that_begins_away_from_its_command(tmp_path: Path) -> None:
    vehicle = load("v-tail")
    steady = js.steady_record(vehicle, trim(vehicle, None, 200.0), 5.0)
    begun = {**steady.start, "elevator.lag": 0.05, "aileron.lag": -0.03, "q": 0.1, "phi": 0.2}
    record = js.Record(steady.vehicle, begun, steady.time, steady.inputs)
    assert np.ptp(js.own_readings(record)[:, vehicle.outputs.index("q")]) > 0.1, "it shows"
    assert apart(tmp_path, record) < 1e-4


EXAMPLES = Path(__file__).parents[2] / "examples"
SCATTER = {"u": 4.0, "v": 4.0, "w": 4.0, "p": 1.0, "q": 1.0, "r": 1.0, "phi": 0.4, "theta": 0.4, "psi": 1.0}
#: rotors by their speed, with inertia, a momentum disc, in-plane drag by inflow, and the ground
SPEEDS = {"drive": "speed", "gain": 900.0, "inertia": 6e-5, "radius": 0.12, "drag_inflow": 0.001, "T1": 0.0, "T2": 1.05e-5,
          "inflow": 2e-4, "drag": 8e-5}  # fmt: skip


def vehicle_of(name: str) -> Vehicle:
    if name in ("speeds", "lagless"):
        ground = {("ground_effect",): {"channel": "height", "rotor": 1.0}}
        numbers = {("rotors", n): x for n, x in SPEEDS.items()}
        vehicle = with_entries(builtin_vehicle("quad-x"), numbers | ground)
        return vehicle if name == "speeds" else parse_vehicle(vehicle.text.replace("lag = 0.05", ""), name)
    if name == "drag":  # a wing whose body drags, with a constant thrust
        return with_entries(builtin_vehicle("twin-boom"), {("body_drag", "quadratic"): [0.3, 0.2, 0.1]})
    return load_vehicle(EXAMPLES / name if name.endswith(".toml") else name)


@pytest.mark.parametrize("name", ["hexacopter.toml", "quadplane", "speeds"])
def test_accelerations_of_rotors_at_random_states(name: str, tmp_path: Path) -> None:
    vehicle = vehicle_of(name)
    tolerance = 1e-12 if name == "hexacopter.toml" else 2e-5  # JSBSim's standard atmosphere
    aircraft, rows, random = exported(tmp_path, vehicle), vehicle.parameter_rows(), np.random.default_rng(5)
    point = trim(vehicle, None, 200.0)
    lags = [f"{r}.lag" for r in vehicle.file.rotor if f"{r}.lag" in vehicle.states]
    for _ in range(3):
        start = {n: point.start.get(n, 0.0) + s * random.standard_normal() for n, s in SCATTER.items()}
        start |= {lag: 0.02 * random.standard_normal() for lag in lags}
        inputs = point.inputs * (1.0 + 0.1 * random.standard_normal(len(point.inputs)))
        record = js.Record(vehicle, start | {"h": 150.0}, np.array([0.0, 0.01]), np.stack([inputs, inputs]))
        flown = js.fly(tmp_path, aircraft, record, tmp_path / jsbsim_aircraft.PLANET)
        states = vehicle.initial_states(record.start, rows, inputs)
        found = vehicle.kernel().evaluate(rows, states, inputs[:, None])[0]
        rates, x = (dict(zip(vehicle.states, y[:, 0], strict=True)) for y in (found, states))
        turning = np.array([flown[k][0] for k in ("pdot", "qdot", "rdot")])
        ours = np.array([rates[a] for a in "pqr"])
        assert turning == pytest.approx(ours, rel=tolerance, abs=tolerance * np.abs(ours).max())
        weight = to_body(np.array([[x[f"e{i}"] for i in range(4)]]), np.array([0.0, 0.0, 9.80665]))[0]
        turned = np.cross([x[a] for a in "pqr"], [x[a] for a in "uvw"])
        ours = np.array([rates[a] for a in "uvw"]) + turned - weight
        felt = np.array([flown[axis][0] / flown["mass"][0] for axis in "XYZ"])
        assert felt == pytest.approx(ours, rel=tolerance, abs=tolerance * np.abs(ours).max())


def compared(root: Path, vehicle: Vehicle, airspeed: float | None = None) -> tuple[js.Record, Any]:
    record = reference_record(vehicle, trim(vehicle, airspeed, 200.0))
    exported(root, record.vehicle)
    return record, compare(root, record)


@pytest.mark.parametrize(("name", "airspeed", "most"), [
    ("quad-x", None, 3e-4), ("hexa-x", None, 3e-4), ("quadplane", None, 3e-4), ("quadplane", 18.0, 5e-4), ("speeds", None, 5e-4),
    ("drag", 35.0, 5e-4),
])  # fmt: skip
def test_thirty_seconds_under_the_autopilot(name: str, airspeed: Any, most: float, tmp_path: Path) -> None:
    record, flown = compared(tmp_path, vehicle_of(name), airspeed)
    assert (record.time[-1], len(record.restarts)) == (30.0, 29 if airspeed is None else 0)
    assert max(flown.relative.values()) < most


def test_delayed_rotors(tmp_path: Path) -> None:
    """On JSBSim's frames the line between samples is the one of our finer steps."""
    vehicle = with_entries(builtin_vehicle("quad-x"), {("rotors", "delay"): 0.0237})
    record, flown = compared(tmp_path, vehicle)
    assert np.abs(flown.fine - flown.flat).max() < 3e-4 * np.abs(flown.fine).max()
    early = replace(record, vehicle=record.vehicle.with_numbers({"rotors.delay": {"value": 0.0}}))
    assert np.abs(js.own_readings(early) - flown.own).max() > 0.01, "it shows"


def test_rotors_without_a_lag_are_a_step_late(tmp_path: Path) -> None:
    found = compared(tmp_path, vehicle_of("lagless"))[1].relative
    assert 1e-3 < found.pop("r") < 0.05
    found.pop("psi")
    assert max(found.values()) < 1e-3


def test_a_number_can_be_changed_in_flight(tmp_path: Path) -> None:
    vehicle = builtin_vehicle("quad-x")
    name, point = exported(tmp_path, vehicle), trim(vehicle, None, 200.0)
    record = js.Record(vehicle, point.start, np.array([0.0, 0.01]), np.stack([point.inputs] * 2))
    flown = js.begin(tmp_path, name, record, tmp_path / jsbsim_aircraft.PLANET)
    before = flown.read()["Z"]
    flown.fdm["stoop/number/rotors.T1"] = 0.0
    flown.advance(point.inputs, point.inputs)
    x = point.inputs[0]
    assert flown.read()["Z"] / before == pytest.approx(6.0 * x / (2.5 + 6.0 * x), rel=5e-3)


def test_an_aircraft_that_jsbsim_does_not_know(tmp_path: Path) -> None:
    record = js.steady_record(vehicle := load("twin-boom"), trim(vehicle, 35.0, 200.0), 1.0)
    exported(tmp_path, vehicle)
    with pytest.raises(SimulationError, match="JSBSim does not take"):
        js.jsbsim_readings(tmp_path, "another", record, None)
