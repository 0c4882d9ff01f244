"""The references of vehicles, mappings, variables, units, maneuvers and geometries are the code's; their examples are read."""

import json
from functools import cache
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from docs.pages import DOCS, LOG_PAGES, blocks, fences, table, tables
from stoop.base.units import FACTORS
from stoop.base.variables import NUMBERED
from stoop.errors import VehicleError
from stoop.flight import OUTPUTS, VARIABLES
from stoop.flight.alignment import QUANTITIES
from stoop.flight.conversion import MIXERS
from stoop.flight.mapping import FlightMapping, GroupTable, SourceTable, TimeUnit, VariableTable
from stoop.simulation import maneuver
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import parse_vehicle, rotor_channels, schema
from stoop.vehicle.defaults import EQUATION_1
from stoop.vehicle.schema import Quantity
from stoop.vehicle.terms import STATE_VARIABLES
from stoop_draft.vehicle_draft import geometry
from stoop_draft.vehicle_draft.geometry import Geometry

INPUTS = [getattr(maneuver, n) for n in ("Steps", "Levels", "Pulse", "Multisine", "Harmonics", "Sweep")]
FLIGHTS, MANEUVERS, GEOMETRY = (DOCS / f"{n}.md" for n in ("flight-files", "maneuver-file", "geometry"))


def test_variables_and_units() -> None:
    """Variables that are numbered share one row, which tells how many there are."""
    numbered = {row[0].format(n=1): (size, row[0]) for size, row in NUMBERED}
    more = {name.format(n=n) for size, name in numbered.values() for n in range(2, size + 1)}
    code = []
    for v in VARIABLES.values():
        size, name = numbered.get(v.name, (0, ""))
        span, dots = (f"`{v.name}` to `{name.format(n=size)}`", " ...") if size else (v.name, "")
        code += [(span, v.unit, v.frame, v.sign, v.meaning + dots)] if v.name not in more else []
    assert list(table(FLIGHTS, "Variables", "variable").rows) == code
    text = FLIGHTS.read_text(encoding="utf-8")
    line = next(line for line in text.splitlines() if line.startswith("Units: "))
    assert line.removeprefix("Units: ").rstrip(".").replace("`", "").split(", ") == list(FACTORS)
    assert all(f"`{unit}`" in text for unit in get_args(TimeUnit))
    for page in (FLIGHTS, MANEUVERS):
        assert ", ".join(OUTPUTS) in page.read_text(encoding="utf-8").replace("\n", " ")


def test_mappings_of_all_pages_are_read(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    for page in (FLIGHTS, *(DOCS / f"{name}.md" for name in LOG_PAGES)):
        for kind, block in fences(page):
            if kind == "toml" and "duration" not in block and "[mass]" not in block:
                path.write_text(block, encoding="utf-8")
                assert FlightMapping.read(path).groups, page.name
    path.write_text(blocks(FLIGHTS, "toml")[0], encoding="utf-8")
    mapping = FlightMapping.read(path)
    assert mapping.clock is not None
    assert (mapping.clock.column, mapping.clock.factor) == ("t_ms", 1e-3)
    az = next(source for source in mapping.sources if source.variables == ("az",))
    assert (az.factors, az.offsets) == ((-9.80665,), (0.0,))


def test_keys_of_mappings() -> None:
    def keys(heading: str, first: str, column: str) -> set[str]:
        cells = table(FLIGHTS, heading, first).column(column)
        return {word for cell in cells for word in cell.replace("`", "").replace(" or ", ", ").split(", ")}

    assert keys("Mapping files", "table", "key") == set(VariableTable.model_fields)
    assert keys("Groups of sources", "key", "key") == {*SourceTable.model_fields, *GroupTable.model_fields}
    assert keys("Groups of sources", "ready mapping", "ready mapping") == set(FlightMapping.READY.values())
    told = table(FLIGHTS, "Streams with clocks of their own", "quantity").rows
    assert {row[0].strip("`"): row[1] for row in told} == QUANTITIES
    assert keys("Servo outputs and surfaces", "mixer", "mixer") == set(MIXERS)


def test_keys_and_shapes_of_maneuver_files() -> None:
    for heading, models in (
        ("Top level", [maneuver.Maneuver]), ("[[input]]", INPUTS), ("[battery]", [maneuver.Battery]),
    ):  # fmt: skip
        page = table(MANEUVERS, heading, "key")
        fields = {name: field for model in models for name, field in model.model_fields.items()}
        assert set(page.column("key")) == set(fields), heading
        for key, said in zip(page.column("key"), page.column("default"), strict=True):
            required = fields[key].is_required()
            default = None if required else fields[key].get_default(call_default_factory=True)
            if required and heading != "[battery]":
                assert said == "required", key
            elif isinstance(default, str | float | int):
                assert said.strip('"') == str(default), key
    written = next(row[2] for row in table(MANEUVERS, "[[input]]", "key").rows if row[0] == "shape")
    for model in INPUTS:
        assert all(f'`"{shape}"`' in written for shape in get_args(model.model_fields["shape"].annotation))


def test_inputs_on_rotors_have_a_row_and_its_unit_and_the_maneuver_of_the_page_flies() -> None:
    told = {
        name.strip("`"): row[2]
        for row in table(MANEUVERS, "On rotors", "control").rows
        for name in row[0].replace(" to ", ", ").split(", ")
    }
    known = rotor_channels.EXCITATIONS | rotor_channels.SETPOINTS
    assert {name: told[name] for name in known} == known
    flown = parse_maneuver(blocks(MANEUVERS, "toml")[0], "page")
    assert set(flown.deflections()) == {"rudder", "aileron"}
    assert "noise" in flown.model_fields_set


def test_geometry_files() -> None:
    smallest, complete = blocks(GEOMETRY, "toml")
    assert len(Geometry.parse(smallest, "my.toml").spread) > 30
    assert Geometry.parse(complete, "my.toml").spread == {}
    top, surface = (t for t in tables(GEOMETRY) if t.heading == "Keys")
    assert {k.strip("`") for k in top.column("key")} == set(Geometry.model_fields) - {"spread"}
    known = {n for m in (geometry.Wing, geometry.Tail, geometry.Fin) for n in m.model_fields}
    controls = {"aileron", "elevon", "elevator", "ruddervator", "rudder"}
    assert {k.strip("`") for k in surface.column("key of a surface")} == known - controls
    shown = blocks(GEOMETRY, "text")[0].splitlines()
    span = "span = 2.32"
    tail = f"{span}\n[tail]\nposition = [1.0, 0.0, 0.0]"
    for wrong in (f"{span}\nchord = 0.4", tail, f"{span}\ndihedral = 5.0", ""):
        with pytest.raises(VehicleError) as caught:
            Geometry.parse(smallest.replace(span, wrong), "my.toml")
        assert f"stoop: error: {caught.value}" in shown


PAGE = DOCS / "vehicle-file.md"
HEADINGS: dict[str, type[BaseModel]] = {
    "Top level": schema.VehicleFile, "[model]": schema.Model, "[mass]": schema.Mass, "[mass.inertia]": schema.Inertia,
    "[reference]": schema.Reference, "[environment]": schema.Environment, "[aerodynamics]": schema.Aerodynamics,
    "[rotors]": schema.Rotors, "[rotor.NAME]": schema.Rotor, "[body_drag]": schema.BodyDrag,
    "[ground_effect]": schema.GroundEffect, "[controls.NAME]": schema.Control, "[sensors]": schema.Sensors,
    "[sensors.CHANNEL]": schema.Sensor,
}  # fmt: skip
#: what a file with rotors needs
LIFTED = '\n[rotors]\nT2 = 30.0\n[rotor.m1]\nchannel = "motor_1"\nposition = [0.1, 0.1, 0.0]\nspin = "cw"\n'
THRUST = (schema.ConstantThrust, schema.ThrustChannel, schema.Propeller)
#: defaults that the page says in words
WORDS = {
    "none", "none of your own", "zero", "one", "origin", "center of gravity", "no lag", "no delay", "no limit", "up",
    "by channel", "the channel `NAME` itself, gain 1",
}  # fmt: skip


@cache
def minimal() -> str:
    return blocks(PAGE, "toml")[0]


def is_table(annotation: Any) -> bool:
    if isinstance(annotation, type) and issubclass(annotation, schema.Table):
        return True
    return any(is_table(a) for a in get_args(annotation) if a is not schema.Term)


def test_keys_and_defaults_are_those_of_the_schema() -> None:
    found = [(t, HEADINGS[t.heading]) for t in tables(PAGE) if t.heading in HEADINGS and "example" in t.head]
    reference = [*found, *zip([t for t in tables(PAGE) if t.heading == "[propulsion]"], THRUST, strict=True)]
    assert {m for _, m in reference} == {*HEADINGS.values(), *THRUST}
    for page, model in reference:
        fields = model.model_fields
        own = [n for n, f in fields.items() if not is_table(f.annotation) and n != "loadings"]
        assert page.column("key") == own, page.heading
        for key, said in zip(page.column("key"), page.column("default"), strict=True):
            if fields[key].is_required():
                assert said == "required", (page.heading, key)
            elif said not in WORDS:
                value = fields[key].get_default(call_default_factory=True)
                known = value.value if isinstance(value, Quantity) else value
                assert json.loads(said) == known, (page.heading, key)


def test_terms_of_equation_1_and_their_variables() -> None:
    rows = table(PAGE, "[aerodynamics]", "coefficient").rows
    code = [(c, n, t, low, high) for c, group in EQUATION_1.items() for n, (t, low, high) in group.items()]
    assert [(c, n, t, float(low), float(high)) for c, n, t, low, high in rows] == code
    assert table(PAGE, "[aerodynamics]", "variable").column("variable")[:-1] == list(STATE_VARIABLES)


@pytest.mark.parametrize(("first", "rotors"), [("channel", False), ("velocity", True)])
def test_noise_and_bias_of_sensors(first: str, rotors: bool) -> None:
    vehicle = parse_vehicle(minimal() + LIFTED * rotors, "file")
    biases = {p.name.split(".")[1]: p for p in vehicle.parameters if p.name.endswith(".bias")}
    rows = table(PAGE, "[sensors.CHANNEL]", first).rows
    assert {row[0] for row in rows} == (set(schema.WIND) if rotors else set(biases))
    for channel, sigma, prior, unit, free in rows:
        bias = biases[channel]
        assert getattr(vehicle.file.sensors, channel).sigma == float(sigma)
        assert (bias.prior, bias.unit, bias.free) == (float(prior), unit, free == "yes"), channel


def test_blocks_of_the_page_are_vehicles_and_the_error_is_the_one_shown() -> None:
    for block in blocks(PAGE, "toml"):
        whole = block if "format" in block else f"{minimal()}\n{block}"
        whole = whole.replace("[mass]\n", "[mass]\ncenter_of_gravity = [-0.3, 0.0, 0.0]\n")
        assert parse_vehicle(whole, "block").parameters
    with pytest.raises(VehicleError) as caught:
        parse_vehicle(minimal().replace("mass = 8.5", "mass = 0"), "my.toml")
    assert str(caught.value) == blocks(PAGE, "text")[0].strip().removeprefix("stoop: error: ")
