"""A vehicle file with one line wrong contradicts the flight of the right one; right files are not accused."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from stoop.base.notices import Notice
from stoop.checks.motors import check_motors
from stoop.flight import Flight, from_columns
from stoop.problem.windows import whole
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle

DOUBLETS = "".join(
    f'[[input]]\ncontrol = "{axis}"\nshape = "3-2-1-1"\nstart = {start}\nstep = {step}\namplitude = {size}\n'
    for axis, start, step, size in (("roll", 1, 0.15, 8), ("pitch", 4, 0.15, 8), ("yaw", 7, 0.4, 1.5))
)
HEAD = "duration = 14.0\nrate = 100.0\nwind = [2.0, -1.0, 0.0]\n"
GUSTS = "\n[turbulence]\nairspeed = 5.0\n" + "".join(
    f"{axis} = {{ intensity = 2.0, length = 20.0 }}\n" for axis in "uvw"
)
NAMES = ("quad-x", "hexa-x", "octo-x", "quadplane")


def flown(vehicle: Vehicle, inputs: str = DOUBLETS) -> Flight:
    return simulate_flight(vehicle, parse_maneuver(HEAD + inputs, "m"), seed=1, name="sim")


@pytest.fixture(scope="module")
def hexa() -> Flight:
    return flown(resolve_vehicle("hexa-x"))


def found(text: str, flight: Flight) -> list[Notice]:
    return check_motors(parse_vehicle(text, "my.toml"), flight, whole({"sim": flight}))


def edited(rotor: str, pattern: str, new: str) -> str:
    """Return the hexarotor's file with one line of one rotor changed."""
    head, name, rest = resolve_vehicle("hexa-x").text.partition(f"[rotor.{rotor}]")
    return head + name + re.sub(pattern, new, rest, count=1)


@pytest.mark.parametrize("inputs", [DOUBLETS, ""])
@pytest.mark.parametrize(
    ("name", "gusts"), [*((name, "") for name in NAMES), ("quad-x", GUSTS), ("hexa-x", GUSTS)]
)
def test_a_right_file_is_not_accused(name: str, gusts: str, inputs: str) -> None:
    text = resolve_vehicle(name).text
    assert found(text, flown(parse_vehicle(text + gusts, name), inputs)) == []


def test_guesses_of_size_are_no_contradiction(hexa: Flight) -> None:
    wrong = {"rotors.T2": 2.0, "rotors.lag": 0.4, "mass.inertia.xx": 2.0, "rotors.torque_ratio": 0.5}
    right = resolve_vehicle("hexa-x")
    guess = right.with_numbers({n: {"value": right.value(n) * f} for n, f in wrong.items()})
    assert check_motors(guess, hexa, whole({"sim": hexa})) == []


def test_exchanged_channels_are_named_with_the_lines_to_write(hexa: Flight) -> None:
    text = edited("m1", "motor_1", "motor_x").replace("motor_2", "motor_1").replace("motor_x", "motor_2")
    (one,) = found(text, hexa)
    assert (one.code, one.values["kind"], one.values["axis"]) == ("moments-contradicted", "exchange", "roll")
    fix = 'write channel = "motor_1" in [rotor.m1] and "motor_2" in [rotor.m2]'
    assert one.values["alternatives"] == (fix,)
    assert one.values["after"] > 0.85
    assert one.values["before"] < 0.3


@pytest.mark.parametrize(("delay", "lag"), [(0.15, 0.01), (0.0, 0.12)])
def test_the_delay_of_a_file_need_not_be_right(delay: float, lag: float, hexa: Flight) -> None:
    """Commands band-passed below 5 Hz that come a tenth of a second late explain nothing, or all the wrong way round."""
    right = resolve_vehicle("hexa-x")
    late = {"rotors.delay": {"value": delay}, "rotors.lag": {"value": lag}}
    text = right.text.replace("[rotors]", "[rotors]\ndelay = 0.0")
    guess = parse_vehicle(text, "my.toml").with_numbers(late)
    assert check_motors(guess, hexa, whole({"sim": hexa})) == []
    other = (
        guess.text.replace("motor_1", "motor_x").replace("motor_2", "motor_1").replace("motor_x", "motor_2")
    )
    (one,) = check_motors(parse_vehicle(other, "my.toml"), hexa, whole({"sim": hexa}))
    assert one.values["alternatives"] == (
        'write channel = "motor_1" in [rotor.m1] and "motor_2" in [rotor.m2]',
    )
    assert one.values["after"] > 0.85


def test_a_hovering_vehicle_that_answers_to_noise_only_says_nothing() -> None:
    """In a loop the motors follow the gyroscopes' noise, against its slope."""
    right = resolve_vehicle("hexa-x")
    calm = flown(right, "")
    assert check_motors(right, calm, whole({"sim": calm})) == []
    other = found(edited("m3", 'spin = "cw"', 'spin = "ccw"'), calm)
    assert other == []


def test_one_spin_and_one_arm_are_named(hexa: Flight) -> None:
    heave = '[[input]]\ncontrol = "heave"\nshape = "3-2-1-1"\nstart = 10.0\nstep = 0.4\namplitude = 3.0\n'
    quad = resolve_vehicle("quad-x")
    turned = re.sub(r'spin = "c?cw"', 'spin = "cw"', quad.text, count=1)
    (one,) = found(turned, flown(quad, DOUBLETS + heave))
    assert (one.values["kind"], one.values["lines"], one.values["axis"]) == ("spin", ("rotor.m1",), "yaw")
    (one,) = found(edited("m4", r"\[-0\.238, 0\.1375", "[0.238, 0.1375"), hexa)
    assert (one.values["kind"], one.values["lines"]) == ("position", ("rotor.m4", "x"))
    assert one.values["axis"] == "pitch"


def test_an_inverted_command_is_named(hexa: Flight) -> None:
    columns = {str(n): hexa.column(str(n)) for n in hexa.data.data_vars}
    inverted = from_columns("sim", hexa.time, {**columns, "motor_3": 1.0 - hexa.column("motor_3")}, ())
    (one,) = found(resolve_vehicle("hexa-x").text, replace(inverted, sources=hexa.sources))
    assert (one.values["kind"], one.values["lines"]) == ("command", ("motor_3",))


def test_a_rate_with_its_sign_lost_is_named(hexa: Flight) -> None:
    columns = {str(n): hexa.column(str(n)) for n in hexa.data.data_vars}
    turned = from_columns("sim", hexa.time, {**columns, "q": -columns["q"]}, ())
    (one,) = found(resolve_vehicle("hexa-x").text, turned)
    assert (one.values["kind"], one.values["lines"]) == ("axis", ("x of position", "q"))


def test_without_rates_or_time_nothing_is_found(hexa: Flight) -> None:
    text = resolve_vehicle("hexa-x").text
    columns = {str(n): hexa.column(str(n)) for n in hexa.data.data_vars}
    assert (
        found(text, from_columns("sim", hexa.time, {n: x for n, x in columns.items() if n != "p"}, ())) == []
    )
    blank = np.full(len(hexa.time), np.nan)
    assert found(text, from_columns("sim", hexa.time, {**columns, "q": blank}, ())) == []
    short = from_columns("sim", hexa.time[:100], {n: x[:100] for n, x in columns.items()}, ())
    assert found(text, short) == []


@pytest.mark.parametrize("name", ["quad-x", "hexa-x"])
def test_commands_in_any_other_order_are_put_in_theirs_at_once(name: str) -> None:
    right = resolve_vehicle(name)
    flight, channels = flown(right), sorted(rotor.channel for rotor in right.file.rotor.values())
    rng = np.random.default_rng(0)
    orders = (
        [*permutations(channels)][1:] if name == "quad-x" else [rng.permutation(channels) for _ in range(12)]
    )
    for order in orders:
        taken = dict(zip(channels, order, strict=True))
        text = re.sub(r'(?<=channel = ")motor_\d', lambda m, taken=taken: str(taken[m[0]]), right.text)
        (one,) = found(text, flight)
        assert one.values["kind"] in ("exchange", "order")
        for rotor, channel in re.findall(r'"(motor_\d)" in \[rotor\.(\w+)\]', str(one.values["suggestion"])):
            text = re.sub(rf'(?s)(\[rotor\.{channel}\].*?channel = ")\w+', rf"\g<1>{rotor}", text, count=1)
        assert text == right.text
