"""Numbers of a vehicle: which are there, which are free, and which of them decide the equations."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from stoop.errors import VehicleError
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import BUILT_IN, resolve_vehicle
from stoop.vehicle.defaults import EQUATION_1

CONTROLS = "\n[controls.elevator]\n[controls.aileron]\n[controls.rudder]\n"


@pytest.fixture(scope="module")
def vehicle(twin_boom: str) -> Vehicle:
    return parse_vehicle(twin_boom, "twin_boom.toml")


def test_eq_1_has_its_32_parameters_and_they_are_free(vehicle: Vehicle) -> None:
    free = [p.name for p in vehicle.parameters if p.free and "." not in p.name]
    assert len(free) == 32
    assert set(free) == {name for terms in EQUATION_1.values() for name in terms}


def test_rows_follow_parameters(vehicle: Vehicle) -> None:
    for i, p in enumerate(vehicle.parameters):
        assert vehicle.rows[p.name] == i
        assert vehicle.value(p.name) == p.value == vehicle.values[i]
        assert not p.free or p.lower < p.upper
        assert p.lower <= p.value <= p.upper
    assert len({p.name for p in vehicle.parameters}) == len(vehicle.parameters)


SAME = [
    ("CL0 = 0.385", "CL0 = 0.5"),
    ("CL0 = 0.385", "CL0 = { value = 0.385, free = false, bounds = [0.0, 1.0], prior = 0.1 }"),
    ("mass = 189.40", "mass = { value = 150.0, free = true }"),
    ('name = "Twin-boom', 'name = "Other'),
    ("# Printed there", "# No longer printed there"),
]
EXTRA_SAME = [
    "[sensors.q]\nsigma = 0.3",
    "[sensors]\nestimate_biases = false",
    '[loadings.heavy]\n"mass.mass" = 200.0',
]


EXTRA_OTHER = [
    "[sensors.q]\nscale = 1.0", "[sensors.q]\ndelay = 0.02", '[sensors.q]\nbias = "=sensors.p.bias"',
    "[model]\nreduce = 'lateral'", "[sensors]\nvane_position = [0.0, 0.0, 0.0]",
    f"{CONTROLS}lag = 0.1", f"{CONTROLS}delay = 0.1", f"{CONTROLS}mix = {{ a = 1.0 }}",
]  # fmt: skip
OTHER = [
    ('kind = "constant"\nthrust = { value = 220.87, free = false }', 'kind = "channel"'),
    ("density = 1.20165", 'density = "standard"'),
    ("CL0 = 0.385", "CL0 = false"),
    ("CL0 = 0.385", 'CL0 = 0.385\nCLx = { term = "alpha^2" }'),
    ("CL0 = 0.385\nCLalpha = 4.78", "CLalpha = 4.78\nCL0 = 0.385\nCLnew = { term = '1' }"),
    ('rate_normalization = "reference"', 'rate_normalization = "actual"'),
    ("xz = 5.0", "xz = 5.0, xy = 0.0"),
]


def test_equations_decide_the_structure_and_numbers_do_not(twin_boom: str, vehicle: Vehicle) -> None:
    """Noise, freedom and loadings do not; equal structures have equal rows, inputs, states and outputs."""
    shapes: dict[str, object] = {}
    for changes, more, equal in ((SAME, EXTRA_SAME, True), (OTHER, EXTRA_OTHER, False)):
        assert all(twin_boom.count(old) == 1 for old, _ in changes)
        texts = [twin_boom.replace(old, new) for old, new in changes] + [f"{twin_boom}\n{x}" for x in more]
        for text, edit in zip(texts, (*changes, *more), strict=True):
            v = parse_vehicle(text, "x")
            assert (v.structure == vehicle.structure) == equal, edit
            shape = (v.rows, v.inputs, v.states, v.outputs)
            assert shapes.setdefault(v.structure, shape) == shape
    assert shapes[vehicle.structure] == (vehicle.rows, vehicle.inputs, vehicle.states, vehicle.outputs)


def test_reduced_models_estimate_their_own_coefficients(vehicle: Vehicle) -> None:
    def free(v: Vehicle) -> set[str]:
        return {p.name for p in v.parameters if p.free and "." not in p.name}

    own = {c: set(EQUATION_1[c]) for c in EQUATION_1}
    assert free(vehicle.reduced("longitudinal")) == own["CL"] | own["CD"] | own["Cm"]
    assert free(vehicle.reduced("lateral")) == own["CQ"] | own["Cl"] | own["Cn"]
    freed = vehicle.with_numbers({"CD0": {"free": True}, "CQ0": {"free": True}})
    assert "CD0" in free(freed.reduced("lateral")), "drag enters the side force: free when asked for"
    assert "CQ0" not in free(freed.reduced("longitudinal")), "no equation contains it"


def test_ties_share_a_row(twin_boom: str) -> None:
    text = f'{twin_boom}\n{CONTROLS}lag = 0.05\n[sensors.q]\nbias = "=sensors.p.bias"\n'
    v = parse_vehicle(
        text.replace("[controls.aileron]", '[controls.aileron]\nlag = "=controls.rudder.lag"'), "x"
    )
    assert v.rows["controls.aileron.lag"] == v.rows["controls.rudder.lag"]
    assert v.rows["sensors.q.bias"] == v.rows["sensors.p.bias"]
    assert v.value("controls.aileron.lag") == 0.05
    changed = v.with_numbers({"controls.rudder.lag": {"value": 0.2}})
    assert changed.value("controls.aileron.lag") == 0.2


def test_with_numbers_changes_what_it_names(vehicle: Vehicle) -> None:
    changed = vehicle.with_numbers(
        {"CLalpha": {"value": 5.0}, "mass.mass": {"free": True}, "mass.inertia.xz": {"value": 7.0}}
    )
    different = {p.name for p, q in zip(vehicle.parameters, changed.parameters, strict=True) if p != q}
    assert different == {"CLalpha", "mass.mass", "mass.inertia.xz"}
    assert changed.structure == vehicle.structure
    assert vehicle.value("CLalpha") == 4.78


def test_names_that_cannot_be_changed(twin_boom: str, vehicle: Vehicle) -> None:
    with pytest.raises(VehicleError, match="no number is called 'CLalfa'; did you mean CLalpha"):
        vehicle.with_numbers({"CLalfa": {"value": 5.0}})
    v = parse_vehicle(f'{twin_boom}\n[sensors.q]\nbias = "=sensors.p.bias"\n', "x")
    with pytest.raises(VehicleError, match=r"sensors\.q\.bias: tied to 'sensors\.p\.bias'; change that one"):
        v.with_numbers({"sensors.q.bias": {"free": False}})


def test_units(vehicle: Vehicle) -> None:
    units = {p.name: p.unit for p in vehicle.parameters}
    expected = {"mass.mass": "kg", "mass.inertia.xz": "kg m2", "CLalpha": "1/rad", "CDalpha2": "1/rad2", "CLq": "1",
                "sensors.ax.bias": "m/s2", "sensors.phi.bias": "rad", "propulsion.thrust": "N"}  # fmt: skip
    assert expected.items() <= units.items()


def test_inputs_of_a_mixer(twin_boom: str) -> None:
    mix = "\n".join(
        f"[controls.{c}]\nmix = {{ pwm_3 = {a}, pwm_4 = {b} }}\ncenter = {{ pwm_3 = 1500.0 }}"
        for c, a, b in (("elevator", 0.1, 0.1), ("rudder", 0.1, -0.1))
    )
    v = parse_vehicle(f"{twin_boom}\n{mix}\n[controls.aileron]\nlag = 0.05\n", "x")
    assert v.inputs == ("pwm_3", "pwm_4", "aileron")
    assert v.states[-1] == "aileron.lag"


WARM = """
import sys
from stoop.vehicle import load_vehicle
v = load_vehicle({path!r})
assert "numba" not in sys.modules and "sympy" not in sys.modules, "loading a file compiles nothing"
k = v.kernel()
import numpy as np
y = k.evaluate(v.values[:, None], np.array({state})[:, None], np.zeros((3, 1)))[1]
print("sympy" in sys.modules, np.isfinite(y).all())
"""


def test_a_warm_start_needs_no_sympy(vehicle: Vehicle) -> None:
    vehicle.kernel()
    path = Path(str(files("stoop") / "data" / "twin_boom.toml"))
    state = [35.0, 0.0, 3.0, 0, 0, 0, 1.0, 0, 0, 0, 200.0]
    code = WARM.format(path=str(path), state=state)
    command = [sys.executable, "-W", "error", "-c", code]
    run = subprocess.run(command, capture_output=True, text=True, env=dict(os.environ))
    assert run.stderr == ""
    assert run.stdout.split() == ["False", "True"]


def test_kernel_has_one_row_per_number(vehicle: Vehicle) -> None:
    freed = vehicle.with_numbers({"mass.inertia.xx": {"free": True, "value": 90.0}})
    assert freed.kernel() is vehicle.kernel(), "freeing a number compiles nothing"
    sizes = (len(vehicle.states), len(vehicle.inputs), len(vehicle.parameters), len(vehicle.outputs))
    assert vehicle.kernel().sizes == sizes
    assert np.isfinite(vehicle.values).all()


def test_built_in_vehicles_load() -> None:
    for name in BUILT_IN:
        vehicle = resolve_vehicle(name)
        assert vehicle.where == name
        assert len([p for p in vehicle.parameters if p.free]) >= (16 if vehicle.rotors else 32), name


def test_file_is_read(twin_boom: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "twin-boom"
    path.write_text(twin_boom.replace('name = "Twin-boom', 'name = "My own'))
    assert resolve_vehicle(path).name.startswith("My own")
    monkeypatch.chdir(tmp_path)
    assert resolve_vehicle("twin-boom").name.startswith("Twin-boom")
    assert resolve_vehicle("./twin-boom").name.startswith("My own")


def test_names_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "result").mkdir()
    for name, says in (
        ("twinboom", "^twinboom: .*did you mean the built-in vehicle twin-boom"),
        ("twin_boom.toml", "did you mean the built-in vehicle twin-boom"),
        ("nowhere/x.toml", r"^nowhere/x\.toml: there is no such vehicle file; check the path"),
        (tmp_path / "resul", r"did you mean .*/result\?"),
    ):
        with pytest.raises(VehicleError, match=says):
            resolve_vehicle(name)
