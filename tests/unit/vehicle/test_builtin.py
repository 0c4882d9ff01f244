"""Vehicles that come with the package."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop.errors import VehicleError
from stoop.vehicle.builtin import BUILT_IN, resolve_vehicle


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
