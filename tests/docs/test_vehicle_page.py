"""The reference of the vehicle file: every key and default is the schema's."""

from __future__ import annotations

import json
from functools import cache
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from docs.pages import DOCS, blocks, table, tables
from stoop.errors import VehicleError
from stoop.vehicle import parse_vehicle, schema
from stoop.vehicle.defaults import EQUATION_1
from stoop.vehicle.schema import Quantity
from stoop.vehicle.terms import STATE_VARIABLES

PAGE = DOCS / "vehicle-file.md"
HEADINGS: dict[str, type[BaseModel]] = {
    "Top level": schema.VehicleFile,
    "[model]": schema.Model,
    "[mass]": schema.Mass,
    "[mass.inertia]": schema.Inertia,
    "[reference]": schema.Reference,
    "[environment]": schema.Environment,
    "[aerodynamics]": schema.Aerodynamics,
    "[rotors]": schema.Rotors,
    "[rotor.NAME]": schema.Rotor,
    "[body_drag]": schema.BodyDrag,
    "[ground_effect]": schema.GroundEffect,
    "[controls.NAME]": schema.Control,
    "[sensors]": schema.Sensors,
    "[sensors.CHANNEL]": schema.Sensor,
}
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
    """Return whether a field has a section of its own."""
    if isinstance(annotation, type) and issubclass(annotation, schema.Table):
        return True
    return any(is_table(a) for a in get_args(annotation) if a is not schema.Term)


def test_keys_and_defaults_are_those_of_the_schema() -> None:
    found = [(t, HEADINGS[t.heading]) for t in tables(PAGE) if t.heading in HEADINGS and "example" in t.head]
    thrust = [t for t in tables(PAGE) if t.heading == "[propulsion]"]
    reference = [*found, *zip(thrust, THRUST, strict=True)]
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
    shown = blocks(PAGE, "text")[0].strip().removeprefix("stoop: error: ")
    with pytest.raises(VehicleError) as caught:
        parse_vehicle(minimal().replace("mass = 8.5", "mass = 0"), "my.toml")
    assert str(caught.value) == shown
