"""A vehicle file with one line wrong contradicts the flight of the right one; right files are not accused."""

import re
from dataclasses import replace
from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.flown import Input, maneuver

from stoop.base.notices import Notice
from stoop.checks.rotors import _limited
from stoop.flight import Flight, from_columns
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop_draft.checks.motors import check_motors

STEPS = "3-2-1-1"
INPUTS = (("roll", STEPS, 1, 0.15, 8), ("pitch", STEPS, 4, 0.15, 8), ("yaw", STEPS, 7, 0.4, 1.5))


def flown(vehicle: Vehicle, *inputs: Input) -> Flight:
    hover = maneuver(14.0, *inputs, rate=100.0, wind=[2.0, -1.0, 0.0])
    return simulate_flight(vehicle, hover, seed=1, name="sim")


@pytest.fixture(scope="module")
def hexa() -> Flight:
    return flown(load_vehicle("hexa-x"), *INPUTS)


def found(text: str, flight: Flight) -> list[Notice]:
    return check_motors(parse_vehicle(text, "my.toml"), flight, Window.whole({"sim": flight}))


def edited(rotor: str, pattern: str, new: str) -> str:
    head, name, rest = load_vehicle("hexa-x").text.partition(f"[rotor.{rotor}]")
    return head + name + re.sub(pattern, new, rest, count=1)


def test_a_right_file_is_not_accused(hexa: Flight) -> None:
    """Guesses of size are no contradiction; a hover, in which the motors answer to noise, against its slope, says nothing."""
    right = load_vehicle("hexa-x")
    assert found(right.text, hexa) == []
    wrong = {"rotors.T2": 2.0, "rotors.lag": 0.4, "mass.inertia.xx": 2.0, "rotors.torque_ratio": 0.5}
    guess = right.with_numbers({n: {"value": right.value(n) * f} for n, f in wrong.items()})
    assert check_motors(guess, hexa, Window.whole({"sim": hexa})) == []
    calm = flown(right)
    for text in (right.text, edited("m3", 'spin = "cw"', 'spin = "ccw"')):
        assert found(text, calm) == []


@pytest.mark.parametrize(("delay", "lag"), [(0.15, 0.01), (0.0, 0.12), (None, None)])
def test_exchanged_channels_are_named(delay: float | None, lag: float | None, hexa: Flight) -> None:
    """Whatever the delay of the file: commands below 5 Hz that come 0.1 s late explain nothing, or all the wrong way round."""
    right = load_vehicle("hexa-x")
    if delay is not None:
        late = {"rotors.delay": {"value": delay}, "rotors.lag": {"value": lag}}
        text = right.text.replace("[rotors]", "[rotors]\ndelay = 0.0")
        right = parse_vehicle(text, "my.toml").with_numbers(late)
        assert check_motors(right, hexa, Window.whole({"sim": hexa})) == []
    names = {"motor_1": "motor_2", "motor_2": "motor_1"}
    (one,) = found(re.sub("motor_[12]", lambda m: names[m[0]], right.text), hexa)
    assert (one.code, one.values["kind"], one.values["axis"]) == ("moments-contradicted", "exchange", "roll")
    fix = 'write channel = "motor_1" in [rotor.m1] and "motor_2" in [rotor.m2]'
    assert one.values["alternatives"] == (fix,)
    assert one.values["after"] > 0.85
    assert one.values["before"] < 0.4


def test_one_spin_and_one_arm_are_named(hexa: Flight) -> None:
    heave, quad = ("heave", "3-2-1-1", 10.0, 0.4, 3.0), load_vehicle("quad-x")
    turned = re.sub(r'spin = "c?cw"', 'spin = "cw"', quad.text, count=1)
    (one,) = found(turned, flown(quad, *INPUTS, heave))
    assert (one.values["kind"], one.values["lines"], one.values["axis"]) == ("spin", ("rotor.m1",), "yaw")
    (one,) = found(edited("m4", r"\[-0\.238, 0\.1375", "[0.238, 0.1375"), hexa)
    assert (one.values["kind"], one.values["lines"]) == ("position", ("rotor.m4", "x"))
    assert one.values["axis"] == "pitch"


def test_an_inverted_command_and_a_rate_with_its_sign_lost_are_named(hexa: Flight) -> None:
    text, columns = load_vehicle("hexa-x").text, {str(n): hexa.column(str(n)) for n in hexa.data.data_vars}
    inverted = from_columns("sim", hexa.time, {**columns, "motor_3": 1.0 - hexa.column("motor_3")}, ())
    (one,) = found(text, replace(inverted, sources=hexa.sources))
    assert (one.values["kind"], one.values["lines"]) == ("command", ("motor_3",))
    (one,) = found(text, from_columns("sim", hexa.time, {**columns, "q": -columns["q"]}, ()))
    assert (one.values["kind"], one.values["lines"]) == ("axis", ("x of position", "q"))


def test_without_rates_or_time_nothing_is_found(hexa: Flight) -> None:
    text, columns = load_vehicle("hexa-x").text, {str(n): hexa.column(str(n)) for n in hexa.data.data_vars}
    for time, recorded in (
        (hexa.time, {n: x for n, x in columns.items() if n != "p"}),
        (hexa.time, {**columns, "q": np.full(len(hexa.time), np.nan)}),
        (hexa.time[:100], {n: x[:100] for n, x in columns.items()}),
    ):
        assert found(text, from_columns("sim", time, recorded, ())) == []


@pytest.mark.parametrize("name", ["quad-x", "hexa-x"])
def test_commands_in_any_other_order_are_put_in_theirs_at_once(name: str) -> None:
    """The record is permuted, and the suggested file has the channel that holds the command of each rotor."""
    right, channel_of = load_vehicle(name), r'(?s)(\[rotor\.{}\].*?channel = ")(\w+)'
    flight, channels = flown(right, *INPUTS), sorted(rotor.channel for rotor in right.file.rotor.values())
    columns = {str(n): flight.column(str(n)) for n in flight.data.data_vars}
    rng, every = np.random.default_rng(0), [*permutations(channels)][1:]
    for order in every if name == "quad-x" else [rng.permutation(channels) for _ in range(12)]:
        taken = dict(zip(channels, map(str, order), strict=True))
        permuted = {**columns, **{channel: columns[held] for channel, held in taken.items()}}
        (one,) = found(
            right.text, replace(from_columns("sim", flight.time, permuted, ()), sources=flight.sources)
        )
        assert one.values["kind"] in ("exchange", "order")
        text = right.text
        for channel, rotor in re.findall(r'"(motor_\d)" in \[rotor\.(\w+)\]', str(one.values["suggestion"])):
            text = re.sub(channel_of.format(rotor), rf"\g<1>{channel}", text, count=1)
        for rotor, its in right.file.rotor.items():
            (written,) = (m[2] for m in re.finditer(channel_of.format(rotor), text))
            assert taken[written] == its.channel


def test_commands_at_an_end_of_their_range_are_named() -> None:
    vehicle = load_vehicle("hexa-x")
    area, rng = vehicle.rotor_range, np.random.default_rng(0)
    inputs = rng.uniform(0.3, 0.7, (1000, len(vehicle.inputs)))
    for column, end in ((area.columns[0], area.full[0]), (area.columns[1], area.idle[1])):
        inputs[:100, column] = end
    found = _limited(vehicle, [SimpleNamespace(inputs=inputs)])  # type: ignore[list-item]
    told = [(n.code, n.subject, n.values["end"], n.values["share"]) for n in found]
    assert told == [("command-saturated", area.names[i], end, 0.1) for i, end in ((0, "upper"), (1, "lower"))]


GUSTS = "\n[turbulence]\nairspeed = 5.0\n" + "".join(
    f"{axis} = {{ intensity = 2.0, length = 20.0 }}\n" for axis in "uvw"
)


@pytest.mark.parametrize(
    ("name", "gusts"), [("octo-x", ""), ("quadplane", ""), ("quad-x", GUSTS), ("hexa-x", GUSTS)]
)
def test_other_right_files_and_gusts_are_not_accused(name: str, gusts: str) -> None:
    text = load_vehicle(name).text
    for inputs in (INPUTS, ()):
        assert found(text, flown(parse_vehicle(text + gusts, name), *inputs)) == []
