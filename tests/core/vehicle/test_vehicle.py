"""Numbers of a vehicle: which are there, which are free, and which of them decide the equations."""

import json
import subprocess
import sys
from importlib.resources import files

import pytest

from stoop.errors import VehicleError
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import BUILT_IN, builtin_text, builtin_vehicle, load_vehicle
from stoop.vehicle.defaults import EQUATION_1

CONTROLS = "\n[controls.elevator]\n[controls.aileron]\n[controls.rudder]\n"


@pytest.fixture(scope="module")
def vehicle(twin_boom: str) -> Vehicle:
    return parse_vehicle(twin_boom, "twin_boom.toml")


SAME = [
    ("CL0 = 0.385", "CL0 = { value = 0.5, free = false, bounds = [0.0, 1.0], prior = 0.1 }"),
    ("mass = 189.40", "mass = { value = 150.0, free = true }"),
    ('name = "Twin-boom', 'name = "Other'), ("# Printed there", "# No longer printed there"),
]  # fmt: skip
EXTRA_SAME = ["[sensors.q]\nsigma = 0.3", "[sensors]\nestimate_biases = false", "[loadings.heavy]\nCL0 = 0.4"]
EXTRA_OTHER = [
    "[sensors.q]\nscale = 1.0", "[sensors.q]\ndelay = 0.02", '[sensors.q]\nbias = "=sensors.p.bias"',
    "[model]\nreduce = 'lateral'", "[sensors]\nvane_position = [0.0, 0.0, 0.0]",
    f"{CONTROLS}lag = 0.1", f"{CONTROLS}delay = 0.1", f"{CONTROLS}mix = {{ a = 1.0 }}",
]  # fmt: skip
OTHER = [
    ('kind = "constant"\nthrust = { value = 220.87, free = false }', 'kind = "channel"'),
    ("density = 1.20165", 'density = "standard"'), ("xz = 5.0", "xz = 5.0, xy = 0.0"),
    ("CL0 = 0.385", "CL0 = false"), ("CL0 = 0.385", 'CL0 = 0.385\nCLx = { term = "alpha^2" }'),
    ("CL0 = 0.385\nCLalpha = 4.78", "CLalpha = 4.78\nCL0 = 0.385\nCLnew = { term = '1' }"),
    ('rate_normalization = "reference"', 'rate_normalization = "actual"'),
]  # fmt: skip
ROTORS = [
    ("T2 = 6.0", "T2 = { value = 9.0, free = false }"), ("T1 = 2.5\n", ""),
    ('spin = "ccw"', 'spin = "cw"'), ('spin = "cw"', 'spin = "cw"\naxis = [0.0, 0.0, -1.0]'),
]  # fmt: skip


def test_eq_1_has_32_parameters_and_reduced_models_estimate_their_own(vehicle: Vehicle) -> None:
    def free(v: Vehicle) -> set[str]:
        return {p.name for p in v.parameters if p.free and "." not in p.name}

    own = {c: set(EQUATION_1[c]) for c in EQUATION_1}
    assert (free(vehicle), len(free(vehicle))) == (set().union(*own.values()), 32)
    assert free(vehicle.reduced("longitudinal")) == own["CL"] | own["CD"] | own["Cm"]
    assert free(vehicle.reduced("lateral")) == own["CQ"] | own["Cl"] | own["Cn"]
    freed = vehicle.with_numbers({"CD0": {"free": True}, "CQ0": {"free": True}})
    assert "CD0" in free(freed.reduced("lateral")), "drag enters the side force: free when asked for"
    assert "CQ0" not in free(freed.reduced("longitudinal")), "no equation contains it"


def test_equations_decide_the_structure_and_numbers_do_not(twin_boom: str, vehicle: Vehicle) -> None:
    shapes = {vehicle.structure: (vehicle.rows, vehicle.inputs, vehicle.states, vehicle.outputs)}
    for changes, more, equal in ((SAME, EXTRA_SAME, True), (OTHER, EXTRA_OTHER, False)):
        assert all(twin_boom.count(old) == 1 for old, _ in changes)
        texts = [twin_boom.replace(old, new) for old, new in changes] + [f"{twin_boom}\n{x}" for x in more]
        for text, edit in zip(texts, (*changes, *more), strict=True):
            v = parse_vehicle(text, "x")
            assert (v.structure == vehicle.structure) == equal, edit
            shape = (v.rows, v.inputs, v.states, v.outputs)
            assert shapes.setdefault(v.structure, shape) == shape
    assert not {"rotors", "rotor", "body_drag", "turbulence"} & set(json.loads(vehicle.structure)[0])
    rotors = builtin_text("quad-x")
    turned = {old: parse_vehicle(rotors.replace(old, new, 1), "x").structure for old, new in ROTORS}
    quad = builtin_vehicle("quad-x").structure
    assert {old for old, found in turned.items() if found == quad} == {"T2 = 6.0"}


def test_changed_numbers_and_ties(twin_boom: str, vehicle: Vehicle) -> None:
    changes = {"CLalpha": {"value": 5.0}, "mass.mass": {"free": True}, "mass.inertia.xz": {"value": 7.0}}
    changed = vehicle.with_numbers(changes)
    assert {p.name for p in set(changed.parameters) - set(vehicle.parameters)} == set(changes)
    assert changed.kernel() is vehicle.kernel(), "a number compiles nothing"
    assert vehicle.value("CLalpha") == 4.78
    tied = CONTROLS.replace("aileron]", 'aileron]\nlag = "=controls.rudder.lag"')
    v = parse_vehicle(f'{twin_boom}{tied}lag = 0.05\n[sensors.q]\nbias = "=sensors.p.bias"\n', "x")
    assert v.rows["sensors.q.bias"] == v.rows["sensors.p.bias"]
    assert v.value("controls.aileron.lag") == 0.05
    assert v.with_numbers({"controls.rudder.lag": {"value": 0.2}}).value("controls.aileron.lag") == 0.2
    tie = r"sensors\.q\.bias: tied to 'sensors\.p\.bias'; change that one"
    for name, says in (
        ("CLalfa", "no number is called 'CLalfa'; did you mean CLalpha"),
        ("sensors.q.bias", tie),
    ):
        with pytest.raises(VehicleError, match=says):
            v.with_numbers({name: {"value": 5.0}})


UNITS = {
    "twin-boom": {"mass.mass": "kg", "mass.inertia.xz": "kg m2", "CLalpha": "1/rad", "CDalpha2": "1/rad2", "CLq": "1",
                  "sensors.ax.bias": "m/s2", "sensors.phi.bias": "rad", "propulsion.thrust": "N"},
    "quad-x": {"rotors.T2": "N", "rotor.m1.position.x": "m", "body_drag.quadratic.z": "N s2/m2", "sensors.vd.bias": "m/s"},
    "speed": {"rotors.T2": "N s2/rad2", "rotors.T1": "N s/rad", "rotors.drag": "N s2/(m rad)", "rotors.gain": "rad/s per unit"},
}  # fmt: skip


def test_units() -> None:
    speed = builtin_text("quad-x").replace('drive = "command"', 'drive = "speed"')
    for name, units in UNITS.items():
        vehicle = parse_vehicle(speed, "speed") if name == "speed" else builtin_vehicle(name)
        assert units.items() <= {p.name: p.unit for p in vehicle.parameters}.items()


WARM = """
import sys
import numpy as np
from stoop.vehicle import load_vehicle
v = load_vehicle({path!r})
assert "numba" not in sys.modules and "sympy" not in sys.modules, "loading a file compiles nothing"
k = v.kernel()
y = k.evaluate(v.values[:, None], np.array([35.0, 0, 3, 0, 0, 0, 1, 0, 0, 0, 200])[:, None], np.zeros((3, 1)))[1]
print("sympy" in sys.modules, np.isfinite(y).all())
"""


def test_a_warm_start_needs_no_sympy(vehicle: Vehicle) -> None:
    vehicle.kernel()
    code = WARM.format(path=str(files("stoop") / "data" / "twin_boom.toml"))
    command = [sys.executable, "-W", "error", "-c", code]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.stderr, run.stdout.split()) == ("", ["False", "True"])


def test_names_of_files_and_of_built_in_vehicles(twin_boom, tmp_path, monkeypatch):
    assert all(load_vehicle(name).where == name for name in BUILT_IN)
    (tmp_path / "result").mkdir()
    path = tmp_path / "twin-boom"
    path.write_text(twin_boom.replace('name = "Twin-boom', 'name = "My own'))
    monkeypatch.chdir(tmp_path)
    for name, own in ((path, True), ("twin-boom", False), ("./twin-boom", True)):
        assert load_vehicle(name).name.startswith("My own") == own
    for name, says in (
        ("twinboom", "^twinboom: .*did you mean the built-in vehicle twin-boom"),
        ("twin_boom.toml", "did you mean the built-in vehicle twin-boom"),
        ("nowhere/x.toml", r"^nowhere/x\.toml: there is no such vehicle file; check the path"),
        (tmp_path / "resul", r"did you mean .*/result\?"),
    ):
        with pytest.raises(VehicleError, match=says):
            load_vehicle(name)
