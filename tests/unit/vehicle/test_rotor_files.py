"""Files with rotors that say something impossible: one line that names the key and the remedy."""

from __future__ import annotations

import contextlib
import math
from importlib.resources import files

import pytest
from unit.vehicle.test_load import WHERE, complaint, replaced

from stoop.checks.vehicle import inertia_notices
from stoop.errors import VehicleError
from stoop.report.sheet import mathml
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.notation import symbols
from stoop.vehicle.symbolic.latex import equations

QUAD = (files("stoop") / "data" / "quad_x.toml").read_text()
REFERENCE = "[reference]\narea = 0.5\nchord = 0.3\nspan = 2.0\nairspeed = 18.0\n"
FIRST = 'channel = "motor_1"\nposition = [0.177, 0.177, -0.03]\nspin = "ccw"'

CHANGES = [
    # what stands there, what stands there instead, key that is named, what is said
    ("lag = 0.05", "lag = -0.1", "rotors.lag", "nothing moves before its command"),
    ("lag = 0.05", "gain = -1.0", "rotors.gain", "not positive"),
    ("lag = 0.05", "nominal_voltage = 0.0", "rotors.nominal_voltage", "not positive"),
    ("lag = 0.05", "idle = 1.0", "rotors.idle", "not below full command of motor_1 (1)"),
    ("lag = 0.05", "inertia = 1e-5", "rotors", 'write drive = "speed"'),
    ("lag = 0.05", "Q2 = 0.1", "rotors", "Q2 and torque_ratio both give the torque; remove one"),
    ("T1 = 2.5\nT2 = 6.0", "", "rotors", "there is no thrust; write T2"),
    ("T1 = 2.5\nT2 = 6.0", "T2 = 0.0", "rotors.T2", "thrust does not rise with the command"),
    ("T1 = 2.5\nT2 = 6.0", "T2 = -6.0", "rotors.T2", "write a first guess, e.g. T2 = 15"),
    ("T1 = 2.5\nT2 = 6.0", "T2 = 0.6", "rotors.T2", "the rotors lift 2.4 N, and the vehicle weighs 14.7 N"),
    ("mass = 1.5", "mass = 1500.0", "rotors.T2", "correct T0, T1, T2, gain, idle or mass"),
    ("torque_ratio = 0.016", "torque_ratio = -0.016", "rotors.torque_ratio", "spin gives the sign"),
    (FIRST, FIRST.replace('"ccw"', '"left"'), "rotor.m1.spin", "it must be 'ccw' or 'cw'"),
    (FIRST, FIRST + "\naxis = [0.0, 0.0, 0.0]", "rotor.m1.axis", "has no length"),
    (FIRST, FIRST + "\nfactor = -0.5", "rotor.m1.factor", "negative"),
    (FIRST, FIRST.replace("0.177, 0.177", "177.0, 177.0"), "rotor.m1.position", "looks like millimeters"),
    (FIRST, FIRST.removesuffix('\nspin = "ccw"'), "rotor.m1.spin", "missing; add it"),
    ("[body_drag]", '[model]\nreduce = "longitudinal"\n[body_drag]', "model.reduce", 'write reduce = "full"'),
    ("[body_drag]", "[aerodynamics]\n[body_drag]", "reference", "aerodynamics needs it"),
    ("[body_drag]", "[controls.m1]\n[body_drag]", "rotor.m1", "taken by a control"),
    ("[body_drag]", "[turbulence]\n[body_drag]", "turbulence.airspeed", "write the speed at which the gusts pass"),
    ("[body_drag]", "[turbulence]\nairspeed = 0.0\n[body_drag]", "turbulence.airspeed", "not positive"),
]  # fmt: skip


def test_impossible() -> None:
    several = "".join(f"[rotor.x{i}]\n{FIRST}\n" for i in range(13))
    rotors, first = QUAD.index("[rotors]"), QUAD.index("[rotor.m1]")
    edits = [(replaced(QUAD, old, new), f"{key}: ", says) for old, new, key, says in CHANGES]
    edits += [
        (QUAD.replace("0.177", "0.0"), "", "all 4 rotors are on one spot"),
        (QUAD.replace('"cw"', '"ccw"'), "", "all 4 rotors turn ccw, so nothing holds the yaw"),
        (QUAD[:rotors] + QUAD[first:], "rotors: ", "missing; add it with T2"),
        (QUAD[:first] + REFERENCE, "rotor: ", "missing; add a table for each"),
        (QUAD[:rotors], "reference: ", "missing; add it"),
        (QUAD + several, "rotor: ", ""),
        (QUAD + '[loadings.brick]\n"mass.mass" = 40.0\n', "loadings.brick: ", "rotors.T2: at full command"),
    ]
    for text, key, says in edits:
        said = complaint(text)
        assert said.startswith(f"{WHERE}: {key}"), said
        assert says in said


def test_a_delay_is_shared_with_a_control_of_the_channel() -> None:
    late = QUAD.replace("lag = 0.05", "delay = 0.02") + REFERENCE + "[aerodynamics]\n[controls.elevator]\n"
    said = complaint(late + "mix = { motor_1 = 0.1 }\n")
    assert "rotors.delay: channel motor_1 also moves elevator" in said
    assert parse_vehicle(late + 'mix = { motor_1 = 0.1 }\ndelay = "=rotors.delay"\n', "tied").rotors


def test_commands_and_speeds_may_be_recorded_late() -> None:
    """Full speed is not known where the speed is measured: a poor guess of thrust is no fault."""
    early = QUAD.replace("lag = 0.05", "lag = 0.005\ndelay = -0.005")
    speeds = early.replace('"command"', '"speed"').replace("motor_", "rotor_")
    for text in (early, speeds.replace("T1 = 2.5\nT2 = 6.0", "T2 = 1e-9")):
        assert parse_vehicle(text, "early").value("rotors.delay") == -0.005


@pytest.mark.parametrize("name", ["quad-x", "quadplane"])
def test_report_has_equations_and_symbols(name: str) -> None:
    vehicle = builtin_vehicle(name)
    lines = equations(vehicle)
    assert any(line.startswith("T_{i} =") for line in lines)
    assert any("C_{L}" in line for line in lines) == (vehicle.file.reference is not None)
    known, tables = symbols(vehicle), ("rotors.", "rotor.", "body_drag.")
    assert {p.name for p in vehicle.parameters if p.name.startswith(tables)} <= set(known)
    for latex in (*lines, *known.values()):
        assert "<code>" not in mathml(latex), latex


def test_inertia_of_another_size_is_doubted() -> None:
    quad = builtin_vehicle("quad-x")
    assert not inertia_notices(quad)
    (found,) = inertia_notices(quad, {"mass.inertia.xx": 0.5})
    assert (found.code, found.subject) == ("inertia-large", "mass.inertia.xx")
    assert found.values["unit"] == "of the largest distance between rotors"


def test_numbers_of_any_size_are_taken_or_refused() -> None:
    """Sizes of boxes and checks of thrust do not overflow on the way (warnings are errors here)."""
    for line in ("mass = 1.5", "T1 = 2.5", "T2 = 6.0", "lag = 0.05", "inflow = 0.25", "drag = 0.08"):
        for value in ("1e308", "-1e308", "1e-320", "0.0", "{ value = 1e308, free = true }"):
            text = QUAD.replace(line, f"{line.partition('=')[0]}= {value}")
            with contextlib.suppress(VehicleError):
                found = parse_vehicle(text, "extreme").parameters
                assert all(math.isfinite(p.upper - p.lower) for p in found if p.free), (line, value)


def test_published_moments_that_miss_the_triangle_inequality_by_rounding_are_a_warning() -> None:
    before = next(line for line in QUAD.splitlines() if line.startswith("inertia = { xx"))

    def with_moments(zz: float) -> Vehicle:
        return parse_vehicle(QUAD.replace(before, f"inertia = {{ xx = 0.01, yy = 0.01, zz = {zz} }}"), "quad")

    assert "inertia-of-no-body" not in {one.code for one in inertia_notices(with_moments(0.02))}
    (found,) = (one for one in inertia_notices(with_moments(0.02006)) if one.code == "inertia-of-no-body")
    assert found.values["excess"] == pytest.approx(0.003)
    with pytest.raises(VehicleError, match="which no body can have"):
        with_moments(0.0205)
