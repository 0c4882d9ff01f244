"""Agreement of another tool with our simulation: every axis and channel, by NumPy's own regression."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.exporters.agreement import AXES, Compared, agreement_table, percent
from stoop.exporters.exporter import ModelData
from stoop.exporters.targets import export
from stoop.vehicle.builtin import builtin_text
from stoop.vehicle.load import parse_vehicle


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
    assert agreement_table(found).rows[1][3:] == ("–", "–", "–")


def test_rounding_prints_as_zero() -> None:
    assert [percent(x) for x in (1.9e-28, 0.0, 0.123, np.nan)] == ["0 %", "0 %", "12 %", "–"]


def test_page_shows_a_side_force_that_gazebo_loses() -> None:
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
