"""The catalogue of extensions: at its null value each changes nothing, and its lines are a valid vehicle file."""

import numpy as np
import pytest

from stoop.vehicle import Vehicle
from stoop.vehicle.arrays import Evaluation
from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import extended
from stoop.vehicle.load import parse_vehicle


def disturbed(base: Vehicle, seed: int, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Return states and inputs (n, 15) at random beside level flight at a speed."""
    rng = np.random.default_rng(seed)
    x = 0.05 * rng.standard_normal((len(base.states), 15))
    x[base.states.index("u")] += speed
    x[base.states.index("e0")] += 1.0
    return x, 0.4 + 0.05 * rng.standard_normal((len(base.inputs), 15))


@pytest.mark.parametrize("name", ["twin-boom", "quad-x", "quadplane"])
def test_extended_vehicle_has_the_same_equations_at_the_null_values(name: str) -> None:
    base = load_vehicle(name)
    vehicle, catalogue = extended(base)
    assert len({one.name for one in catalogue}) == len(catalogue)
    x, u = disturbed(base, 1, 20.0)
    assert (vehicle.states, vehicle.inputs) == (base.states, base.inputs)
    found = vehicle.array_equations()(vehicle.values, x, u)
    wanted = base.kernel().evaluate(np.repeat(base.values[:, None], 15, axis=1), x, u)
    for a, b in zip(found, wanted, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["twin-boom", "quad-x"])
def test_every_extension_can_be_written_and_estimated(name: str) -> None:
    base = load_vehicle(name)
    for one in extended(base)[1]:
        written = with_entries(base, one.free_entries(one.step))
        added = {p.name for p in written.parameters if p.free} - {p.name for p in base.parameters if p.free}
        assert len(added) == (3 if one.kind == "drag" else 1), one.name  # drag is free by default


def test_line_is_what_the_file_needs() -> None:
    base = load_vehicle("twin-boom")
    found = {one.name: one.line(0.04) for one in extended(base)[1]}
    assert found["controls.aileron.lag"] == "[controls.aileron] lag = 0.04"
    assert found["Cmalpha2"] == '[aerodynamics.Cm] Cmalpha2 = {term = "alpha^2", value = 0.04}'
    assert found["controls.aileron.rate_limit"] == "[controls.aileron] rate_limit = 25.0"
    assert found["sensors.vane_position.x"] == "[sensors] vane_position = [0.04, 0.0, 0.0]"


def test_rotors_with_one_axis_are_a_group_beside_others() -> None:
    text = load_vehicle("quad-x").text
    for name in ("m1", "m2"):
        text = text.replace(f"[rotor.{name}]", f"[rotor.{name}]\naxis = [0.1, 0.0, -1.0]")
    vehicle, catalogue = extended(parse_vehicle(text, "tilted"))
    (first, second) = (one for one in catalogue if "+" in one.name)
    assert first.name == "rotor.m1+m2.factor"
    assert first.line(-0.1) == '[rotor.m1] factor = 0.9; [rotor.m2] factor = "=rotor.m1.factor"'
    assert second.numbers == ("rotor.m3.factor", "rotor.m4.factor")
    assert len({vehicle.rows[f"rotor.m{i}.factor"] for i in range(1, 5)}) == 4


def test_a_change_is_that_of_another_evaluation() -> None:
    base = load_vehicle("twin-boom")
    vehicle, catalogue = extended(base)
    (x, u), equations, rows = disturbed(base, 2, 35.0), vehicle.array_equations(), vehicle.values.tolist()
    # another in every piece
    rows[vehicle.rows["sensors.p.bias"]] = np.random.default_rng(3).standard_normal(15)
    at, before = Evaluation(equations, rows, x, u), np.vstack(equations(rows, x, u))
    other = u.copy()
    other[1] += 0.1
    for names, inputs in [(one.numbers, u) for one in catalogue if one.numbers] + [((), other)]:
        changed = list(rows)
        for name in names:
            changed[vehicle.rows[name]] += 0.01
        found = np.zeros_like(before)
        for i, change in at.changes(changed, at.inputs if inputs is u else inputs):
            found[i] = change
        wanted = np.vstack(equations(changed, x, inputs)) - before
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
        assert names or np.any(found)


def test_values_changed_since_reading_and_reductions_stay() -> None:
    base = load_vehicle("twin-boom").with_numbers({"Clp": {"value": -0.4, "free": False}})
    longer = with_entries(base, {("controls", "aileron", "lag"): 0.05})
    assert (longer.value("Clp"), longer.value("controls.aileron.lag")) == (-0.4, 0.05)
    assert "Clp" not in {p.name for p in longer.parameters if p.free}
    assert longer.controls == base.controls
    base = base.reduced("longitudinal")
    vehicle, catalogue = extended(base)
    assert vehicle.states == base.states
    assert {one.name for one in catalogue} & {"Cmalpha2", "Clalphabeta"} == {"Cmalpha2"}
