"""Aircraft files: what is written reads back, whatever the vehicle is called."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import pytest

from stoop.errors import VehicleError
from stoop.exporters.jsbsim_aircraft import aircraft, folder, read_numbers, relative_errors
from stoop.exporters.jsbsim_flight import file_name, steady_record, without_turbulence
from stoop.exporters.matlab import identifier
from stoop.simulation import Trim
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop_studies.verify.export import VEHICLES, load


@pytest.mark.parametrize("name", VEHICLES)
def test_numbers_read_back(name: str) -> None:
    vehicle = load(name)
    difference = relative_errors(vehicle, aircraft(vehicle))
    written = {n for group in vehicle.terms.values() for n in group}
    assert written | {"mass.mass", "mass.inertia.xx", "reference.area"} <= set(difference)
    assert max(difference.values()) < 4e-16


def test_points_and_products_of_inertia_change_their_axes_and_come_back() -> None:
    read = read_numbers(aircraft(load("crooked")))
    assert read["mass.inertia.xy"] == pytest.approx(0.03, rel=1e-15)
    assert read["mass.inertia.xz"] == pytest.approx(0.2, rel=1e-15)
    assert read["mass.inertia.yz"] == pytest.approx(-0.02, rel=1e-15)
    assert [read[f"mass.center_of_gravity.{a}"] for a in "xyz"] == pytest.approx(
        [-0.31, 0.01, 0.02], rel=1e-15
    )


def test_any_name_is_well_formed(twin_boom: Vehicle, steady: Trim) -> None:
    name = '<b>"A & B\'s" ]]> \x07\u200b\U0001f600'
    odd = twin_boom.file.model_copy(update={"name": name, "notes": (name,)})
    vehicle = Vehicle(odd, twin_boom.text, twin_boom.where)
    for place, text in folder(vehicle, steady_record(vehicle, steady)).items():
        assert place.isascii()
        ET.fromstring(text)  # noqa: S314 - our own
    root = ET.fromstring(aircraft(vehicle))  # noqa: S314
    assert root.get("name", "").startswith('<b>"A & B\'s" ]]>')


@pytest.mark.parametrize(
    ("name", "file", "function"),
    [
        ("V-tail 8.5 kg (altlnt)", "v-tail-8-5-kg-altlnt", "v_tail_8_5_kg_altlnt"),
        ("", "vehicle", "vehicle"),
        ("747", "747", "vehicle_747"),
        ("../../etc", "etc", "etc"),
        ("Ä" * 99, "vehicle", "vehicle"),
    ],
)
def test_names(name: str, file: str, function: str) -> None:
    assert file_name(name) == file
    assert identifier(name) == function


def test_lateral_equations_are_refused(twin_boom: Vehicle) -> None:
    with pytest.raises(VehicleError, match=r"export to state-space, or set model\.reduce"):
        aircraft(twin_boom.reduced("lateral"))


@pytest.mark.parametrize("name", ["quad-x", "quadplane"])
def test_numbers_of_rotors_read_back(name: str) -> None:
    vehicle = builtin_vehicle(name)
    difference = relative_errors(vehicle, aircraft(vehicle))
    places = {n for n in vehicle.rows if n.startswith("rotor.m1.position")}
    assert places | {"mass.mass", "rotors.T2", "rotors.torque_ratio", "body_drag.quadratic.x"} <= set(
        difference
    )
    assert max(difference.values()) < 4e-16


def test_a_delay_that_looks_ahead_is_refused() -> None:
    vehicle = load("flying-wing").with_numbers({"controls.elevator.delay": {"value": -0.02}})
    with pytest.raises(VehicleError, match="acts before it is recorded"):
        aircraft(vehicle)


def test_turbulence_is_left_out(twin_boom: Vehicle) -> None:
    assert without_turbulence(twin_boom) == (twin_boom, ())
    table = "\n[turbulence]\nu = { intensity = 1.0, length = 200.0 }\n"
    gusty = parse_vehicle(twin_boom.text + table, "gusty")
    vehicle, notices = without_turbulence(gusty)
    assert [n.code for n in notices] == ["turbulence-not-exported"]
    assert vehicle.states == twin_boom.states
    assert aircraft(vehicle) == aircraft(twin_boom)
