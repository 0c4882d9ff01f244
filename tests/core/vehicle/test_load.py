"""Vehicle files that say something impossible: one line that names the file, the key and the remedy."""

import contextlib
import math
import re
from importlib.resources import files
from pathlib import Path

import pytest

from stoop.checks.vehicle import inertia_notices
from stoop.errors import VehicleError
from stoop.report.sheet import mathml
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.notation import symbols
from stoop.vehicle.symbolic.latex import equations

WHERE = "folder/bad.toml"


def complaint(text: str) -> str:
    with pytest.raises(VehicleError) as caught:
        parse_vehicle(text, WHERE)
    said = str(caught.value)
    assert said.startswith(f"{WHERE}: ")
    assert said.isprintable(), "one line"
    assert caught.value.__cause__ is None
    return said


def replaced(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, old
    return text.replace(old, new)


MASS = "mass = 189.40\n"
CL0 = "CL0 = 0.385\n"
INERTIA = "inertia = { xx = 100.0, yy = 120.0, zz = 200.0, xz = 5.0 }"
THRUST = 'kind = "constant"\nthrust = { value = 220.87, free = false }'

CHANGES = [
    # where, what stands there instead, key that is named, what is said
    (MASS, "mass = 0\n", "mass.mass", "not positive; write its true value"),
    (MASS, "mass = nan\n", "mass.mass", "finite number"),
    (MASS, "mass = true\n", "mass.mass", "not true or false"),
    (MASS, 'mass = "heavy"\n', "mass.mass", 'write a number, or "=name"'),
    (MASS, f"mass = 1{'0' * 400}\n", "mass.mass", "308 digits"),
    (MASS, "", "mass.mass", "missing; add it"),
    (MASS, f"{MASS}mess = 1\n", "mass.mess", "unknown key; remove it or correct its name (did you mean mass?)"),
    (MASS, 'mass = "=mass.heft"\n', "mass.mass", "tied to 'mass.heft', which is not a number of this file"),
    (MASS, 'mass = "=mass.mass"\n', "mass.mass", "itself tied"),
    (MASS, 'mass = { tie = "reference.area", value = 2.0 }\n', "mass.mass", "remove value"),
    (MASS, "mass = { value = 3.0, bounds = [5.0, 1.0] }\n", "mass.mass", "reversed or empty"),
    (MASS, "mass = { value = 3.0, bounds = [1.0, 2.0] }\n", "mass.mass", "lies outside its bounds"),
    (MASS, "mass = { value = 3.0, bounds = [1.0, 2.0, 5.0] }\n", "mass.mass.bounds", "too many"),
    (MASS, "mass = { value = 3.0, bounds = [1.0, inf] }\n", "mass.mass.bounds.1", "finite"),
    (MASS, "mass = { value = 3.0, prior = 0.0 }\n", "mass.mass.prior", "greater than 0"),
    (INERTIA, "inertia = { xx = 1.0, yy = 2.0, zz = 30.0 }", "mass.inertia", "exceeds the sum of the others"),
    (INERTIA, "inertia = { xx = 1.0, yy = 2.0, zz = 2.0, xz = 9.0 }", "mass.inertia", "principal moment"),
    ("area = 2.8667", "area = 0.0", "reference.area", "not positive"),
    ("alpha = 0.0", "alpha = { value = 0.0, free = true }", "reference.alpha", "free, but its bounds are [0, 0]; add bounds"),
    ("alpha = 0.0", "alpha = 5.88", "reference.alpha", "looks like degrees; write radians (0.1026)"),
    ("density = 1.20165", 'density = "thin"', "environment.density", '"standard" or "log"'),
    (THRUST, "thrust = 3.0", "propulsion", "'kind' is missing"),
    (THRUST, 'kind = "jet"', "propulsion", "choose one of 'constant', 'channel', 'propeller'"),
    (THRUST, 'kind = "propeller"', "propulsion.channel", "missing"),
    (THRUST, f'{THRUST}\nchannel = "x"', "propulsion.channel", "known here: kind, thrust, position, pitch"),
    (THRUST, f"{THRUST}\npitch = 10.0", "propulsion.pitch", "degrees"),
    (THRUST, f"{THRUST}\nposition = [1.0, 2.0]", "propulsion.position.2", "too few entries"),
    (THRUST, 'kind = "channel"\nchannel = "a b"', "propulsion.channel", "letters, digits"),
    (CL0, 'CL0 = "alpha"\n', "aerodynamics.CL.CL0", 'or "=name"'),
    (CL0, "CL0 = 1e308\n", "aerodynamics.CL.CL0.value", "out of range"),
    (CL0, "CLx = 1.0\n", "aerodynamics.CL.CLx", "write what it multiplies"),
    (CL0, '"C\\nL" = { term = "1" }\n', "aerodynamics.CL.C L", "rename it"),
    (CL0, 'Cmalpha = { term = "alpha" }\n', "aerodynamics.Cm.Cmalpha", "the name is used twice"),
    (CL0, 'CLx = { term = "flaps" }\n', "aerodynamics.CL.CLx", "unknown variable 'flaps'"),
    (CL0, "CLx = { term = \"__import__('os').system('x')\" }\n", "aerodynamics.CL.CLx", "not allowed"),
    (CL0, 'CLx = { term = "alpha^9999999" }\n', "aerodynamics.CL.CLx", "powers from 0 to 6"),
    ("[aerodynamics.CD]", "[aerodynamics.CX]\nx = 1\n[aerodynamics.CD]", "aerodynamics.CX", "unknown key"),
    ('format = "stoop-vehicle/1"', 'format = "stoop-vehicle/2"', "format", "'stoop-vehicle/1'"),
    ('name = "Twin', 'nickname = "a"\nname = "Twin', "nickname", "did you mean name?"),
]  # fmt: skip

OTHERS = "[controls.aileron]\n[controls.rudder]\n"
ADDITIONS = [
    ("[controls.alpha]", "controls.alpha", "taken by a flight variable"),
    (f"{OTHERS}[controls.elevator]\nlag = -0.1", "controls.elevator.lag", "nothing moves before its command"),
    (f"{OTHERS}[controls.elevator]\noffset = 5.0", "controls.elevator.offset", "degrees"),
    ("[controls.elevator]\nmix = { a = 1.0 }\ncenter = { b = 2.0 }", "controls.elevator", "center names b"),
    ("[controls.elevator]\nmix = { a = 1.0 }\ndelay = 0.1\n[controls.rudder]\nmix = { a = 1.0 }\n[controls.aileron]",
     "controls.rudder.delay", 'channel a also moves elevator, whose delay is another; tie them'),
    ("[controls.flap]", "aerodynamics", "needs its table [controls.NAME]"),
    ("[sensors]\nalpha = 3", "sensors.alpha", "must be a table"),
    ("[sensors.q]\nsigma = 0.0", "sensors.q.sigma", "greater than 0"),
    ("[model]\nreduce = 'sideways'", "model.reduce", "'full', 'longitudinal' or 'lateral'"),
    ('[loadings.full]\n"mass.heft" = 3.0', "loadings.full.mass.heft", "no number has this name"),
    ('[loadings.full]\n"mass.mass" = 0.0', "loadings.full: mass.mass", "not positive"),
    ('[loadings.full]\n"mass.inertia.zz" = 900.0', "loadings.full: mass.inertia", "exceeds the sum"),
    (f"{OTHERS}[controls.elevator]\nrate_limit = 0.0", "controls.elevator.rate_limit", "0 is not positive; remove it"),
    (f"{OTHERS}[controls.elevator]\ndead_zone = -0.1", "controls.elevator.dead_zone", "-0.1 is negative"),
    (f"{OTHERS}[controls.elevator]\ndead_zone = 2.0", "controls.elevator.dead_zone", "2 looks like degrees"),
    ("[sensors.vn]\nbias = 1.0", "sensors.vn", "only a vehicle with rotors is observed by it; remove it"),
    ("[turbulence]\nw = { intensity = 0.0, length = 10.0 }", "turbulence.w.intensity", "not positive"),
    ("[turbulence]\nw = { intensity = 1.0 }", "turbulence.w.length", "missing"),
    ("[surprise]\nx = 1", "surprise", "unknown key"),
]  # fmt: skip


def test_what_is_impossible_is_one_line_that_names_key_and_remedy(twin_boom: str) -> None:
    edits = [(replaced(twin_boom, old, new), key, says) for old, new, key, says in CHANGES]
    edits += [(f"{twin_boom}\n{more}\n", key, says) for more, key, says in ADDITIONS]
    edits += [(text, "", "missing; add it") for text in ("", "\n", "# only a comment", "name = 'x'")]
    for text, key, says in edits:
        said = complaint(text)
        assert said.startswith(f"{WHERE}: {key}"), said
        assert says in said


def test_any_table_may_be_of_the_wrong_type_and_any_text_no_toml() -> None:
    for place in ("aerodynamics", "aerodynamics.CL", "controls", "sensors", "mass", "reference", "environment",
                  "propulsion", "loadings", "model", "notes", "name"):  # fmt: skip
        head, _, last = place.rpartition(".")
        for value in ("3", "'text'", "[1]", "true", "nan", "{ x = { y = 1 } }"):
            complaint(f"[{head}]\n{last} = {value}" if head else f"{last} = {value}")
    for text in (
        "name", "[mass", "a = 1\na = 2", "x = 2020-13-45", "[" * 5000, "a=" + "[" * 5000, "\x00", "a." * 3000 + "b=1",
        "a=" + "{a=" * 3000, "\ufeff[mass]", "mass = 1\n[mass]", "a = 0x",
    ):  # fmt: skip
        complaint(text)


def test_files(twin_boom: str, tmp_path: Path) -> None:
    path = tmp_path / "v.toml"
    path.write_text(twin_boom)
    vehicle = load_vehicle(path)
    assert (vehicle.value("mass.mass"), vehicle.where) == (189.40, str(path))
    for name, content, says in (
        ("v.toml", bytes(range(256)), r"v\.toml: .*not UTF-8 text"),
        ("v.toml", b"#" * 1_000_001, r"larger than 1000000 bytes\); check the path"),
        ("none.toml", None, r"none\.toml: there is no such vehicle file; did you mean .*v\.toml\?"),
        ("a\x00b", None, ":"), ("x" * 5000, None, ":"), ("a\nb", None, ":"),
        ("", None, r"is a folder, no vehicle file; name v\.toml in it"),
    ):  # fmt: skip
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(VehicleError, match=says) as caught:
            load_vehicle(f"{tmp_path}/{name}")
        assert str(caught.value).isprintable()
    path.unlink()
    with pytest.raises(VehicleError, match="is a folder, no vehicle file; check the path"):
        load_vehicle(tmp_path)


def test_usual_size_of_what_is_missing() -> None:
    vtail = "[mass]\nmass = 8.5\ninertia = { xx = 1.38, yy = 0.84, zz = 2.17 }\n"
    vtail += "[reference]\narea = 0.66\nchord = 0.285\nspan = 2.32\nairspeed = 24.0\n"
    usual = r"mass \(0\.11\.\.0\.17 span\)\^2 = 0\.55 to 1\.3 kg m2 for this mass and span"
    for key, removed, said in (
        ("mass.inertia.xx", "xx = 1.38, ", usual),
        ("reference.chord", "chord = 0.285\n", r"0\.17 to 0\.46 m for this span"),
        ("reference.span", "span = 2.32\n", r"1\.8 to 4\.6 m for this mass"),
        ("mass.mass", "mass = 8.5\n", r"2\.2 to 13 kg for this span"),
        ("reference.airspeed", "airspeed = 24.0\n", r"15 to 26 m/s for this mass and area"),
    ):
        whole = rf"{re.escape(key)}: missing; add it \(usual: {said}; or run stoop vehicle new\)"
        assert re.search(whole, complaint(f'name = "v"\n{replaced(vtail, removed, "")}')), key


QUAD = (files("stoop") / "data" / "quad_x.toml").read_text()
REFERENCE = "[reference]\narea = 0.5\nchord = 0.3\nspan = 2.0\nairspeed = 18.0\n"
FIRST = 'channel = "motor_1"\nposition = [0.177, 0.177, -0.03]\nspin = "ccw"'

ROTOR_CHANGES = [
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
    edits = [(replaced(QUAD, old, new), f"{key}: ", says) for old, new, key, says in ROTOR_CHANGES]
    moved = "[aerodynamics]\n[controls.elevator]\nmix = { motor_1 = 0.1 }\n"
    late = QUAD.replace("lag = 0.05", "delay = 0.02") + REFERENCE + moved
    edits += [
        (late, "rotors.delay: ", "channel motor_1 also moves elevator"),
        (QUAD.replace("0.177", "0.0"), "", "all 4 rotors are on one spot"), (QUAD + several, "rotor: ", ""),
        (QUAD.replace('"cw"', '"ccw"'), "", "all 4 rotors turn ccw, so nothing holds the yaw"),
        (QUAD[:rotors] + QUAD[first:], "rotors: ", "missing; add it with T2"), (QUAD[:rotors], "reference: ", "missing; add it"),
        (QUAD[:first] + REFERENCE, "rotor: ", "missing; add a table for each"),
        (QUAD + '[loadings.brick]\n"mass.mass" = 40.0\n', "loadings.brick: ", "rotors.T2: at full command"),
    ]  # fmt: skip
    for text, key, says in edits:
        said = complaint(text)
        assert said.startswith(f"{WHERE}: {key}"), said
        assert says in said
    assert parse_vehicle(late + 'delay = "=rotors.delay"\n', "tied").rotors


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
