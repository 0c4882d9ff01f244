"""JSBSim as the independent truth of exported rotors: forces at random states, and 30 s under the autopilot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop.base.files import write_files
from stoop.base.rotations import to_body
from stoop.exporters import jsbsim_aircraft
from stoop.exporters.jsbsim_comparison import compare
from stoop.exporters.jsbsim_flight import Record, begin, file_name, fly, own_readings
from stoop.exporters.reference_flight import reference_record
from stoop.simulation import initial_states, parameter_rows, trim
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text, builtin_vehicle, resolve_vehicle

EXAMPLES = Path(__file__).parents[2] / "examples"
SCATTER = {"u": 4.0, "v": 4.0, "w": 4.0, "p": 1.0, "q": 1.0, "r": 1.0, "phi": 0.4, "theta": 0.4, "psi": 1.0}
#: rotors by their speed, with inertia, a momentum disc, in-plane drag by inflow, and the ground
SPEEDS = {
    'drive = "command"': 'drive = "speed"\ngain = 900.0\ninertia = 6e-5\nradius = 0.12\ndrag_inflow = 0.001',
    "T1 = 2.5": "T1 = 0.0",
    "T2 = 6.0": "T2 = 1.05e-5",
    "inflow = 0.25": "inflow = 2e-4",
    "drag = 0.08": "drag = 8e-5",
}


def speeds(more: str = "") -> Vehicle:
    text = builtin_text("quad-x")
    for old, new in SPEEDS.items():
        text = text.replace(old, new)
    return parse_vehicle(text + '\n[ground_effect]\nchannel = "height"\nrotor = 1.0\n' + more, "speeds")


def vehicle_of(name: str) -> Vehicle:
    if name == "speeds":
        return speeds()
    if name == "lagless":
        return parse_vehicle(speeds().text.replace("lag = 0.05", ""), name)
    if name == "drag":  # a wing whose body drags, with a constant thrust
        table = "\n[body_drag]\nquadratic = [0.3, 0.2, 0.1]\n"
        return parse_vehicle(builtin_vehicle("twin-boom").text + table, name)
    return resolve_vehicle(EXAMPLES / name if name.endswith(".toml") else name)


def exported(root: Path, vehicle: Vehicle) -> str:
    write_files(root, jsbsim_aircraft.folder(vehicle, None))
    return file_name(vehicle.name)


@pytest.mark.parametrize("name", ["hexacopter.toml", "quadplane", "speeds", "octo-x", "crazyflie.toml"])
def test_accelerations_at_random_states(name: str, tmp_path: Path) -> None:
    vehicle = vehicle_of(name)
    tolerance = 1e-12 if name == "hexacopter.toml" else 2e-5  # JSBSim's standard atmosphere
    aircraft, rows, random = exported(tmp_path, vehicle), parameter_rows(vehicle), np.random.default_rng(5)
    point = trim(vehicle, None, 200.0)
    lags = [f"{r}.lag" for r in vehicle.file.rotor if f"{r}.lag" in vehicle.states]
    for _ in range(3):
        start = {n: point.start.get(n, 0.0) + s * random.standard_normal() for n, s in SCATTER.items()}
        start |= {lag: 0.02 * random.standard_normal() for lag in lags}
        inputs = point.inputs * (1.0 + 0.1 * random.standard_normal(len(point.inputs)))
        record = Record(vehicle, start | {"h": 150.0}, np.array([0.0, 0.01]), np.stack([inputs, inputs]))
        flown = fly(tmp_path, aircraft, record, tmp_path / jsbsim_aircraft.PLANET)
        states = initial_states(vehicle, record.start, rows, inputs)
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


@pytest.mark.parametrize(
    ("name", "airspeed", "most"),
    [
        ("quad-x", None, 3e-4), ("hexa-x", None, 3e-4), ("quadplane", None, 3e-4), ("quadplane", 18.0, 5e-4),
        ("speeds", None, 5e-4), ("drag", 35.0, 5e-4),
    ],
)  # fmt: skip
def test_thirty_seconds(name: str, airspeed: float | None, most: float, tmp_path: Path) -> None:
    vehicle = vehicle_of(name)
    record = reference_record(vehicle, trim(vehicle, airspeed, 200.0))
    assert record is not None
    assert record.time[-1] == 30.0
    assert len(record.restarts) == (29 if airspeed is None else 0)
    exported(tmp_path, record.vehicle)
    assert max(compare(tmp_path, record).relative.values()) < most


def test_delayed_rotors(tmp_path: Path) -> None:
    """On JSBSim's frames the line between samples is the one of our finer steps."""
    text = builtin_text("quad-x").replace("[rotors]", "[rotors]\ndelay = 0.0237")
    vehicle = parse_vehicle(text, "late")
    record = reference_record(vehicle, trim(vehicle, None, 200.0))
    assert record is not None
    exported(tmp_path, record.vehicle)
    flown = compare(tmp_path, record)
    assert np.abs(flown.fine - flown.flat).max() < 3e-4 * np.abs(flown.fine).max()
    early = replace(record, vehicle=record.vehicle.with_numbers({"rotors.delay": {"value": 0.0}}))
    assert np.abs(own_readings(early) - flown.own).max() > 0.01, "it shows"


def test_rotors_without_a_lag_are_a_step_late(tmp_path: Path) -> None:
    vehicle = vehicle_of("lagless")
    assert vehicle.sloped
    record = reference_record(vehicle, trim(vehicle, None, 200.0))
    assert record is not None
    exported(tmp_path, record.vehicle)
    found = compare(tmp_path, record).relative
    assert 1e-3 < found.pop("r") < 0.05
    found.pop("psi")
    assert max(found.values()) < 1e-3


def test_a_number_can_be_changed_in_flight(tmp_path: Path) -> None:
    vehicle = builtin_vehicle("quad-x")
    name, point = exported(tmp_path, vehicle), trim(vehicle, None, 200.0)
    record = Record(vehicle, point.start, np.array([0.0, 0.01]), np.stack([point.inputs] * 2))
    flown = begin(tmp_path, name, record, tmp_path / jsbsim_aircraft.PLANET)
    before = flown.read()["Z"]
    flown.fdm["stoop/number/rotors.T1"] = 0.0
    flown.advance(point.inputs, point.inputs)
    x = point.inputs[0]
    assert flown.read()["Z"] / before == pytest.approx(6.0 * x / (2.5 + 6.0 * x), rel=5e-3)
