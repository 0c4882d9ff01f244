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


def test_numbers_read_back() -> None:
    for name in ("twin-boom", "v-tail", "flying-wing", "crooked", "quad-x", "quadplane"):
        vehicle = load(name) if name in VEHICLES else builtin_vehicle(name)
        difference = relative_errors(vehicle, aircraft(vehicle))
        written = {n for group in vehicle.terms.values() for n in group} | {"mass.mass", "mass.inertia.xx"}
        if vehicle.file.rotor:
            written = {"mass.mass", "rotors.T2", "rotors.torque_ratio", "body_drag.quadratic.x"}
            written |= {n for n in vehicle.rows if n.startswith("rotor.m1.position")}
        assert written <= set(difference), name
        assert max(difference.values()) < 4e-16, name


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


def test_names_of_files_and_functions() -> None:
    for name, file, function in (
        ("V-tail 8.5 kg (altlnt)", "v-tail-8-5-kg-altlnt", "v_tail_8_5_kg_altlnt"),
        ("", "vehicle", "vehicle"),
        ("747", "747", "vehicle_747"),
        ("../../etc", "etc", "etc"),
        ("Ä" * 99, "vehicle", "vehicle"),
    ):
        assert (file_name(name), identifier(name)) == (file, function)


def test_refusals(twin_boom: Vehicle) -> None:
    with pytest.raises(VehicleError, match=r"export to state-space, or set model\.reduce"):
        aircraft(twin_boom.reduced("lateral"))
    early = load("flying-wing").with_numbers({"controls.elevator.delay": {"value": -0.02}})
    with pytest.raises(VehicleError, match="acts before it is recorded"):
        aircraft(early)


def test_turbulence_is_left_out(twin_boom: Vehicle) -> None:
    assert without_turbulence(twin_boom) == (twin_boom, ())
    table = "\n[turbulence]\nu = { intensity = 1.0, length = 200.0 }\n"
    gusty = parse_vehicle(twin_boom.text + table, "gusty")
    vehicle, notices = without_turbulence(gusty)
    assert [n.code for n in notices] == ["turbulence-not-exported"]
    assert vehicle.states == twin_boom.states
    assert aircraft(vehicle) == aircraft(twin_boom)
