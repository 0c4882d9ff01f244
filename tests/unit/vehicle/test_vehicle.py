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


@pytest.mark.parametrize(("old", "new"), SAME)
def test_numbers_and_their_freedom_do_not_decide_the_equations(
    twin_boom: str, vehicle: Vehicle, old: str, new: str
) -> None:
    assert twin_boom.count(old) == 1
    assert parse_vehicle(twin_boom.replace(old, new), "x").structure == vehicle.structure


@pytest.mark.parametrize("more", EXTRA_SAME)
def test_noise_and_loadings_do_not_decide_the_equations(twin_boom: str, vehicle: Vehicle, more: str) -> None:
    assert parse_vehicle(f"{twin_boom}\n{more}", "x").structure == vehicle.structure


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


@pytest.mark.parametrize("more", EXTRA_OTHER)
def test_what_adds_a_number_or_an_equation_decides(twin_boom: str, vehicle: Vehicle, more: str) -> None:
    assert parse_vehicle(f"{twin_boom}\n{more}", "x").structure != vehicle.structure


@pytest.mark.parametrize(("old", "new"), OTHER)
def test_what_changes_an_equation_decides(twin_boom: str, vehicle: Vehicle, old: str, new: str) -> None:
    assert twin_boom.count(old) == 1
    assert parse_vehicle(twin_boom.replace(old, new), "x").structure != vehicle.structure


def test_equal_structures_have_equal_rows(twin_boom: str, vehicle: Vehicle) -> None:
    variants = [parse_vehicle(twin_boom.replace(old, new), "x") for old, new in (*SAME, *OTHER)]
    variants += [parse_vehicle(f"{twin_boom}\n{more}", "x") for more in (*EXTRA_SAME, *EXTRA_OTHER)]
    rows: dict[str, object] = {}
    for v in (vehicle, *variants):
        shape = (v.rows, v.inputs, v.states, v.outputs)
        assert rows.setdefault(v.structure, shape) == shape


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


def test_with_numbers_knows_names(vehicle: Vehicle) -> None:
    with pytest.raises(VehicleError, match="no number is called 'CLalfa'; did you mean CLalpha"):
        vehicle.with_numbers({"CLalfa": {"value": 5.0}})


def test_a_tied_number_cannot_be_changed(twin_boom: str) -> None:
    v = parse_vehicle(f'{twin_boom}\n[sensors.q]\nbias = "=sensors.p.bias"\n', "x")
    with pytest.raises(
        VehicleError, match=r"sensors\.q\.bias: tied to 'sensors\.p\.bias'; change that one instead"
    ):
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
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, env=dict(os.environ)
    )
    assert run.stderr == ""
    assert run.stdout.split() == ["False", "True"]


def test_freeing_a_number_does_not_compile_anew(vehicle: Vehicle) -> None:
    freed = vehicle.with_numbers({"mass.inertia.xx": {"free": True, "value": 90.0}})
    assert freed.kernel() is vehicle.kernel()


def test_kernel_has_one_row_per_number(vehicle: Vehicle) -> None:
    sizes = (len(vehicle.states), len(vehicle.inputs), len(vehicle.parameters), len(vehicle.outputs))
    assert vehicle.kernel().sizes == sizes
    assert np.isfinite(vehicle.values).all()
