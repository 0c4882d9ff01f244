"""Agreement of another tool with our simulation: every axis and channel, by NumPy's own regression."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop.exporters import rotorpy_flight
from stoop.exporters.agreement import AXES, Compared, agreement_table, loads_along, percent
from stoop.exporters.exporter import ModelData
from stoop.exporters.gazebo import fly_gazebo, gazebo_loads
from stoop.exporters.gazebo_model import gazebo_model
from stoop.exporters.reference_flight import reference_flight
from stoop.exporters.targets import export
from stoop.simulation import trim
from stoop.vehicle.builtin import builtin_text
from stoop.vehicle.load import load_vehicle, parse_vehicle

ROOT = Path(__file__).parents[3]


def test_statistics_are_those_of_a_regression() -> None:
    rng = np.random.default_rng(1)
    ours = rng.normal(size=(400, 3)) * [1.0, 1e-14, 2.0]
    ours[:, 2] = 0.03 * np.arange(400)  # a heading that turns more than once
    theirs = 0.5 * ours + 0.3 + 0.2 * rng.normal(size=(400, 3))
    theirs[:, 2] = ours[:, 2] + 0.1
    wrapped = np.column_stack([ours[:, :2], (ours[:, 2] + np.pi) % (2.0 * np.pi) - np.pi])
    found = Compared("tool", "flight", ("Fx", "Fy", "psi"), wrapped, theirs)
    s = found.statistics
    assert s["slope"][0] == pytest.approx(np.polyfit(ours[:, 0], theirs[:, 0], 1)[0])
    assert s["correlation"][0] == pytest.approx(np.corrcoef(ours[:, 0], theirs[:, 0])[0, 1])
    assert s["error"][0] == pytest.approx(np.sqrt(np.mean((theirs - ours)[:, 0] ** 2)))
    assert s["share"][0] == pytest.approx(s["error"][0] / ours[:, 0].std())
    assert np.isnan([s[n][1] for n in ("slope", "correlation", "share")]).all(), "rounding beside Fx"
    assert [s["slope"][2], s["correlation"][2], s["error"][2]] == pytest.approx([1.0, 1.0, 0.1])
    assert agreement_table(found).rows[1][1:] == ("–", "0.366 N", "–", "–", "–")
    same = Compared("tool", "flight", ("Fx", "Fy"), ours[:, :2], ours[:, :2] + [0.1, 1.9e-26])
    assert agreement_table(same).rows[1][1:] == ("–", "0 N", "–", "–", "–"), "rounding prints as 0"


def test_rounding_prints_as_zero() -> None:
    assert [percent(x) for x in (1.9e-28, 0.0, 0.123, np.nan)] == ["0 %", "0 %", "12 %", "–"]


def test_page_has_every_axis() -> None:
    """The drag of rotors in the direction of flight falls with the inflow, which Gazebo has not."""
    text = builtin_text("hexa-x")
    vehicle = parse_vehicle(text.replace("[rotors]", "[rotors]\ndrag_inflow = 0.002", 1), "hexa")
    made = export(ModelData(vehicle), "gazebo")
    page = made.files["export.html"].decode()
    for axis in AXES:
        assert page.count(f'<th scope="row">{axis}</th>') == 2, "a table for PX4 and one for ArduPilot"
    (note,) = [n for n in made.notes if "rotors.drag_inflow" in n]
    assert all(f"% of {axis}" in note for axis in AXES)
    assert any("lowest correlation" in n for n in made.notes)


def test_a_lost_side_force_is_visible() -> None:
    """The hexacopter without the drag of its rotors: velocities hardly tell, the table and its sentence do."""
    vehicle = load_vehicle(ROOT / "examples/hexacopter.toml")
    point = trim(vehicle)
    flight, model = reference_flight(vehicle, point), gazebo_model(vehicle, point)
    assert flight is not None
    ours = loads_along(flight)
    whole = Compared("Gazebo", flight.title, tuple(AXES), ours, gazebo_loads(model, flight))
    assert whole.statistics["correlation"][1] > 0.999
    bare = replace(model, motors=tuple(replace(m, drag=0.0) for m in model.motors), damping=None)
    theirs = np.hstack([gazebo_loads(bare, flight), fly_gazebo(bare, flight)])
    names = (*AXES, *rotorpy_flight.CHANNELS)
    lost = Compared("Gazebo", flight.title, names, np.hstack([ours, rotorpy_flight.motion(flight)]), theirs)
    found = lost.statistics
    assert [found[n][1] for n in ("slope", "correlation", "share")] == pytest.approx(
        [0.0, 0.0, 1.0], abs=0.01
    )
    assert found["correlation"][names.index("ve")] > 0.95
    assert "lowest correlation 0 (Fx)" in str(lost)
    assert agreement_table(lost).rows[1][3:] == ("100 %", "0.00", "0.00")
