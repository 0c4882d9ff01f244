"""The reference of the vehicle file: every key, default, unit and example is the schema's."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from docs.pages import DOCS, Table, blocks, table, tables
from stoop.vehicle import Vehicle, parse_vehicle, schema
from stoop.vehicle.defaults import EQUATION_1
from stoop.vehicle.schema import Quantity
from stoop.vehicle.terms import STATE_VARIABLES
from stoop.vehicle.vehicle import leaves

PAGE = DOCS / "vehicle-file.md"
MINIMAL = blocks(PAGE, "toml")[0]
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
LIFTED = """
[rotors]
T2 = 30.0
[rotor.m1]
channel = "motor_1"
position = [0.1, 0.1, 0.0]
spin = "cw"
"""  #: what a file with rotors needs
KINDS: dict[str, type[BaseModel]] = {
    "constant": schema.ConstantThrust,
    "channel": schema.ThrustChannel,
    "propeller": schema.Propeller,
}
WORDS = (
    "required",
    "none",
    "none of your own",
    "zero",
    "one",
    "origin",
    "center of gravity",
    "no lag",
    "no delay",
    "no limit",
    "up",
)
IN_WORDS = {"by channel", "the channel `NAME` itself, gain 1"}  #: defaults that other tests hold to the code


def reference() -> list[tuple[Table, type[BaseModel]]]:
    found = [(t, HEADINGS[t.heading]) for t in tables(PAGE) if t.heading in HEADINGS and "example" in t.head]
    thrust = [t for t in tables(PAGE) if t.heading == "[propulsion]"]
    return [*found, *zip(thrust, KINDS.values(), strict=True)]


def is_table(annotation: Any) -> bool:
    """Tell whether a field has a section of its own."""
    if isinstance(annotation, type) and issubclass(annotation, schema.Table):
        return True
    return any(is_table(a) for a in get_args(annotation) if a is not schema.Term)


def own_fields(model: type[BaseModel]) -> list[str]:
    """Return the keys that are not sections; sensors are one section for all channels."""
    elsewhere = {n for n, f in model.model_fields.items() if is_table(f.annotation)}
    return [n for n in model.model_fields if n not in elsewhere - {"loadings"} and n != "loadings"]


CASES = [pytest.param(t, m, id=f"{t.heading} {m.__name__}") for t, m in reference()]


@pytest.mark.parametrize(("page", "model"), CASES)
def test_every_key_and_no_other(page: Table, model: type[BaseModel]) -> None:
    assert page.column("key") == own_fields(model)


def test_every_section() -> None:
    assert {m for _, m in reference()} == {*HEADINGS.values(), *KINDS.values()}
    sections = {t.heading for t in tables(PAGE)} | {"[loadings.NAME]"}
    assert sections >= set(HEADINGS)


@pytest.mark.parametrize(("page", "model"), CASES)
def test_defaults(page: Table, model: type[BaseModel]) -> None:
    for key, said in zip(page.column("key"), page.column("default"), strict=True):
        if said in IN_WORDS:
            continue
        field = model.model_fields[key]
        if field.is_required():
            assert said == "required", key
            continue
        value = field.get_default(call_default_factory=True)
        if value is None or value in ({}, ()):
            assert said in WORDS[1:], key
        else:
            assert json.loads(said) == (value.value if isinstance(value, Quantity) else value), key


@pytest.mark.parametrize(("page", "model"), CASES)
def test_examples_are_accepted(page: Table, model: type[BaseModel]) -> None:
    for key, example in zip(page.column("key"), page.column("example"), strict=True):
        assert parse_vehicle(with_example(page, model, key, example), "example") is not None


@pytest.mark.parametrize(("page", "model"), CASES)
def test_units(page: Table, model: type[BaseModel]) -> None:
    for row in page.rows:
        key, unit, example = (row[page.head.index(n)] for n in ("key", "unit", "example"))
        vehicle = parse_vehicle(with_example(page, model, key, example), "example")
        for name in numbers(vehicle, page, key, example):
            known = next(p.unit for p in vehicle.parameters if p.name == name)
            assert unit == known or unit.startswith("as the"), name


def numbers(vehicle: Vehicle, page: Table, key: str, example: str) -> list[str]:
    """Return the numbers of the vehicle that an example has written."""
    section = place_of(page)
    section = "" if section == "Top level" else f"{section}."
    place = f"{section}{key}"
    return [n for n, q in leaves(vehicle.file) if (n == place or n.startswith(f"{place}.")) and q.tie is None]


def place_of(page: Table) -> str:
    """Return the section of a table with names for its placeholders."""
    name = "m1" if page.heading.startswith("[rotor.") else "elevator"
    return page.heading.strip("[]").replace("NAME", name).replace("CHANNEL", "V")


def with_example(page: Table, model: type[BaseModel], key: str, example: str) -> str:
    """Return the smallest file with one key written as the reference shows it."""
    file = tomllib.loads(MINIMAL)
    if page.heading.startswith("[rotor") or key == "rotor":
        file |= tomllib.loads(LIFTED)
    place: Any = file
    section = place_of(page)
    for name in () if section == "Top level" else section.split("."):
        place = place.setdefault(name, {})
    if page.heading == "[propulsion]":
        place |= {"kind": next(k for k, m in KINDS.items() if m is model)}
        place |= {"thrust": 1.0} if model is schema.ConstantThrust else {}
        place |= (
            {"channel": "throttle", "speed_gain": 1.0, "diameter": 1.0, "CT0": 1.0}
            if model is schema.Propeller
            else {}
        )
    if key == "inertia" and model is schema.Rotors:
        place["drive"] = "speed"
    if model is schema.GroundEffect:
        place |= {"radius": 0.1} if key == "rotor" else {"lift": 0.1}
    if key == "center":
        place["mix"] = {"pwm_3": 0.0007, "pwm_4": -0.0007}
    place |= tomllib.loads(example)
    return to_toml(file)


def to_toml(value: dict[str, Any]) -> str:
    return "\n".join(f"{k} = {inline(v)}" for k, v in value.items())


def inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {inline(v)}" for k, v in value.items()) + " }"
    return "[" + ", ".join(map(inline, value)) + "]" if isinstance(value, list) else json.dumps(value)


def test_keys_of_a_number() -> None:
    assert table(PAGE, "Numbers", "key").column("key") == ["value", "free", "bounds", "prior", "mean"]
    assert set(Quantity.model_fields) == {"value", "free", "bounds", "prior", "mean", "tie"}


def test_terms_of_equation_1() -> None:
    rows = table(PAGE, "[aerodynamics]", "coefficient").rows
    code = [(c, n, t, low, high) for c, group in EQUATION_1.items() for n, (t, low, high) in group.items()]
    assert [(c, n, t, float(low), float(high)) for c, n, t, low, high in rows] == code


def test_variables_of_terms() -> None:
    written = table(PAGE, "[aerodynamics]", "variable").column("variable")
    assert written[:-1] == list(STATE_VARIABLES)


def test_sensors_by_channel() -> None:
    vehicle = parse_vehicle(MINIMAL, "minimal")
    biases = {p.name.split(".")[1]: p for p in vehicle.parameters if p.name.endswith(".bias")}
    for channel, sigma, prior, unit, free in table(PAGE, "[sensors.CHANNEL]", "channel").rows:
        assert getattr(vehicle.file.sensors, channel).sigma == float(sigma)
        bias = biases.pop(channel)
        assert (bias.prior, bias.unit, bias.free) == (float(prior), unit, free == "yes")
    assert not biases


def test_velocities_over_ground() -> None:
    vehicle = parse_vehicle(MINIMAL + LIFTED, "lifted")
    numbers = {p.name: p for p in vehicle.parameters}
    rows = table(PAGE, "[sensors.CHANNEL]", "velocity").rows
    assert [row[0] for row in rows] == list(schema.WIND)
    for channel, sigma, prior, unit, free in rows:
        bias = numbers[f"sensors.{channel}.bias"]
        assert getattr(vehicle.file.sensors, channel).sigma == float(sigma)
        assert (bias.prior, bias.unit, bias.free) == (float(prior), unit, free == "yes")


def test_blocks_of_the_page() -> None:
    for block in blocks(PAGE, "toml"):
        whole = block if "format" in block else f"{MINIMAL}\n{block}"
        whole = whole.replace("[mass]\n", "[mass]\ncenter_of_gravity = [-0.3, 0.0, 0.0]\n")
        assert parse_vehicle(whole, "block").parameters


def test_minimal_file_frees_the_32_terms() -> None:
    free = [p for p in parse_vehicle(MINIMAL, "minimal").parameters if p.free and "." not in p.name]
    assert len(free) == 32
    assert not any(p.value for p in free)


def test_error_message(tmp_path: Path) -> None:
    said = blocks(PAGE, "text")[0].strip().removeprefix("stoop: error: ")
    with pytest.raises(Exception, match="is not positive") as caught:
        parse_vehicle(MINIMAL.replace("mass = 8.5", "mass = 0"), "my.toml")
    assert str(caught.value) == said
