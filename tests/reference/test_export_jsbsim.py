"""JSBSim as the independent truth: what is exported accelerates and flies there as our equations say.

JSBSim 1.3.3 has its own equations of motion, atmosphere and integrators (github.com/JSBSim-Team/jsbsim).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from stoop.errors import SimulationError
from stoop.exporters import jsbsim_aircraft
from stoop.exporters.jsbsim_flight import (
    Record,
    every_control,
    file_name,
    fly,
    jsbsim_readings,
    maneuver_record,
    own_readings,
    relative_differences,
    steady_record,
)  # fmt: skip
from stoop.simulation import initial_states, parameter_rows, trim
from stoop.vehicle import Vehicle, parse_vehicle
from stoop_studies.verify.export import INPUTS, load

VEHICLES = ["twin-boom", "v-tail", "flying-wing", "crooked"]
SCATTERED = ("alpha", "beta", "p", "q", "r", "phi", "theta", "psi")
DENSER = 1e-5  #: JSBSim's standard atmosphere, relative; measured 8.1e-6 at sea level


def exported(root: Path, vehicle: Vehicle) -> str:
    """Write JSBSim's root folder; return the name of the aircraft."""
    for place, text in jsbsim_aircraft.folder(vehicle, None).items():
        path = root / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return file_name(vehicle.name)


@pytest.mark.parametrize("variant", ["", "stated inertia", "heavy propeller"])
@pytest.mark.parametrize("name", VEHICLES)
def test_accelerations_at_random_states(name: str, variant: str, tmp_path: Path) -> None:
    """No time passes: forces, moments, the full inertia tensor and its inverse, arms, units, signs."""
    vehicle = load(name)
    if variant == "heavy propeller":
        vehicle = parse_vehicle(vehicle.text.replace("\nspeed_gain", "\ninertia = -0.01\nspeed_gain"), name)
    if variant == "stated inertia":
        shares = {"xx": 0.9, "yy": 1.2, "zz": 0.8}
        inertia = [share * vehicle.value(f"mass.inertia.{axes}") for axes, share in shares.items()]
        text = vehicle.text.replace("[reference]\n", f"[reference]\ninertia = {inertia}\n")
        vehicle = parse_vehicle(text, name)
    aircraft = exported(tmp_path, vehicle)
    random = np.random.default_rng(11)
    rows = parameter_rows(vehicle)
    point = trim(vehicle, None, 200.0)
    tolerance = DENSER if vehicle.file.environment.density == "standard" else 1e-9
    for _ in range(5):
        scatter = {c: point.start.get(c, 0.0) + 0.2 * random.standard_normal() for c in SCATTERED}
        start = scatter | {
            "V": point.start["V"] * random.uniform(0.7, 1.3),
            "h": random.uniform(100.0, 2000.0),
        }
        inputs = point.inputs * (1.0 + 0.1 * random.standard_normal(len(point.inputs)))
        record = Record(vehicle, start, np.array([0.0, 0.01]), np.stack([inputs, inputs]))
        flown = fly(tmp_path, aircraft, record, tmp_path / jsbsim_aircraft.PLANET)
        states = initial_states(vehicle, start, rows, inputs)
        rates, readings = vehicle.kernel().evaluate(rows, states, inputs[:, None])
        turning = np.array([flown[k][0] for k in ("pdot", "qdot", "rdot")])
        ours = rates[[vehicle.states.index(c) for c in "pqr"], 0]
        assert turning == pytest.approx(ours, rel=tolerance, abs=tolerance * np.abs(ours).max())
        if "sensors.accelerometer_position.x" not in vehicle.rows:
            felt = np.array([flown[axis][0] / flown["mass"][0] for axis in "XYZ"])
            ours = readings[[vehicle.outputs.index(c) for c in ("ax", "ay", "az")], 0]
            ours = ours - [vehicle.value(f"sensors.{c}.bias") for c in ("ax", "ay", "az")]
            assert felt == pytest.approx(ours, rel=tolerance, abs=tolerance * np.abs(ours).max())


def apart(root: Path, record: Record, steps: int = 1) -> float:
    """Return the largest difference of any channel, as a fraction of its maximum."""
    name = exported(root, record.vehicle)
    flown = jsbsim_readings(root, name, record, root / jsbsim_aircraft.PLANET)
    return max(relative_differences(record.vehicle.outputs, own_readings(record, steps), flown).values())


@pytest.mark.parametrize(("name", "most"), [("twin-boom", 1e-4), ("v-tail", 1e-4), ("flying-wing", 3e-4)])
def test_thirty_seconds_open_loop(name: str, most: float, tmp_path: Path) -> None:
    vehicle = load(name)
    point = trim(vehicle, None, 200.0)
    record = maneuver_record(vehicle, point, INPUTS["3-2-1-1, doublets"](vehicle, point))
    assert record.time[-1] == 30.0
    assert apart(tmp_path, record) < most


@pytest.mark.parametrize("delays", [(0.0237, 0.0004), (0.02, 0.01)])
def test_delays_of_any_length(delays: tuple[float, float], tmp_path: Path) -> None:
    """Less than a frame, whole frames, whole samples, none of these: on JSBSim's frames all fly alike."""
    names = ("controls.elevator.delay", "controls.aileron.delay")
    vehicle = load("crooked").with_numbers({n: {"value": d} for n, d in zip(names, delays, strict=True)})
    point = trim(vehicle, None, 200.0)
    record = maneuver_record(vehicle, point, every_control(vehicle, point, 10.0))
    assert apart(tmp_path, record, 10) < 1e-4


def test_servos_with_play_and_a_rate_limit(tmp_path: Path) -> None:
    plain = load("crooked")
    servos = {"elevator": {"rate_limit": 0.15, "dead_zone": 0.01}, "aileron": {"dead_zone": 0.02}}
    document = tomlkit.parse(plain.text)
    for control, numbers in servos.items():
        document["controls"][control] |= numbers
    vehicle = parse_vehicle(tomlkit.dumps(document), "servos")
    point = trim(vehicle, None, 200.0)
    record = maneuver_record(vehicle, point, every_control(vehicle, point, 10.0))
    free = replace(record, vehicle=plain.with_numbers({n: {"value": v} for n, v in point.changes.items()}))
    shown = relative_differences(plain.outputs, own_readings(free), own_readings(record))
    assert max(shown.values()) > 0.05, "it shows"
    assert apart(tmp_path, record, 10) < 2e-4


def test_a_surface_that_begins_away_from_its_command(tmp_path: Path) -> None:
    vehicle = load("v-tail")
    point = trim(vehicle, None, 200.0)
    steady = steady_record(vehicle, point, 5.0)
    begun = {**steady.start, "elevator.lag": 0.05, "aileron.lag": -0.03, "q": 0.1, "phi": 0.2}
    record = Record(steady.vehicle, begun, steady.time, steady.inputs)
    assert np.ptp(own_readings(record)[:, vehicle.outputs.index("q")]) > 0.1, "it shows"
    assert apart(tmp_path, record) < 1e-4


def test_an_aircraft_that_jsbsim_does_not_know(tmp_path: Path) -> None:
    vehicle = load("twin-boom")
    record = steady_record(vehicle, trim(vehicle, 35.0, 200.0), 1.0)
    exported(tmp_path, vehicle)
    with pytest.raises(SimulationError, match="JSBSim does not take"):
        jsbsim_readings(tmp_path, "another", record, None)
