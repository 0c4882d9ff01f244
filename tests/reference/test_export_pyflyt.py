"""PyFlyt flies a vehicle of its own terms as our simulation does: 10 s from the same state under the same commands."""

from __future__ import annotations

from pathlib import Path

import pytest
from reference.test_export_mujoco import open_loop, shares_of_range

from stoop.exporters import exporter, pyflyt
from stoop.exporters.exporter import ModelData
from stoop.exporters.rotorpy_flight import motion
from stoop.vehicle.builtin import builtin_text
from stoop.vehicle.load import parse_vehicle

pytest.importorskip("PyFlyt")
OWN_TERMS = {
    "T1 = 2.5\nT2 = 6.0\ninflow = 0.25\ndrag = 0.08": "T2 = 8.5",
    "[body_drag]\nquadratic = [0.02, 0.02, 0.03]": "[body_drag]\nquadratic = [0.03, 0.03, 0.03]\n[environment]\ndensity = 1.225",
}


def test_ten_seconds(tmp_path: Path) -> None:
    text = builtin_text("quad-x")
    for old, new in OWN_TERMS.items():
        assert old in text
        text = text.replace(old, new)
    vehicle = parse_vehicle(text, "quad")
    target = pyflyt.PyFlyt(ModelData(vehicle))
    made = target.files()
    for place, content in made.files.items():
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).write_bytes(content)
    flight = open_loop(vehicle)
    script = exporter.load_script(tmp_path / made.main)
    found = shares_of_range(motion(flight)[:, :9], pyflyt.fly_pyflyt(script, flight, 2400))
    assert target.omitted == {}
    assert max(found.values()) < 2e-2
