"""drone-models flies a vehicle of its own terms as our simulation does: 10 s from the same state under the same commands."""

from __future__ import annotations

from pathlib import Path

import pytest
from reference.test_export_mujoco import open_loop, shares_of_range

from stoop.exporters import crazyflow, exporter
from stoop.exporters.exporter import ModelData
from stoop.exporters.rotorpy_flight import motion
from stoop.vehicle.builtin import builtin_text
from stoop.vehicle.load import parse_vehicle

# The package itself is imported by the script, which sets what it asks for beside an imported SciPy.
pytestmark = pytest.mark.skipif(
    not exporter.installed("drone_models"), reason="drone-models is not installed"
)
OWN_TERMS = {
    "inflow = 0.25\ndrag = 0.08\n": "",
    "quadratic = [0.02, 0.02, 0.03]": "linear = [0.2, 0.2, 0.3]\n[environment]\ndensity = 1.225",
}


def test_ten_seconds(tmp_path: Path) -> None:
    text = builtin_text("quad-x")
    for old, new in OWN_TERMS.items():
        assert old in text
        text = text.replace(old, new)
    vehicle = parse_vehicle(text, "quad")
    target = crazyflow.Crazyflow(ModelData(vehicle))
    made = target.files()
    for place, content in made.files.items():
        (tmp_path / place).write_bytes(content)
    flight, script = open_loop(vehicle), exporter.load_script(tmp_path / made.main)
    found = shares_of_range(motion(flight), crazyflow.fly_drone_models(script, flight))
    assert target.omitted == {}
    assert max(found.values()) < 1e-3, "asked: 2e-2"
