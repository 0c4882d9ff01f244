"""Vehicles that come with the package."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop.errors import VehicleError
from stoop.vehicle.builtin import BUILT_IN, resolve_vehicle


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_vehicle_loads(name: str) -> None:
    vehicle = resolve_vehicle(name)
    assert vehicle.where == name
    assert len([p for p in vehicle.parameters if p.free]) >= (16 if vehicle.rotors else 32)


def test_file_is_read(twin_boom: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "twin-boom"
    path.write_text(twin_boom.replace('name = "Twin-boom', 'name = "My own'))
    assert resolve_vehicle(path).name.startswith("My own")
    monkeypatch.chdir(tmp_path)
    assert resolve_vehicle("twin-boom").name.startswith("Twin-boom")
    assert resolve_vehicle("./twin-boom").name.startswith("My own")


@pytest.mark.parametrize("name", ["twinboom", "twin_boom.toml", "twin-bom"])
def test_near_name_is_suggested(name: str) -> None:
    with pytest.raises(VehicleError, match=f"^{name}: .*did you mean the built-in vehicle twin-boom"):
        resolve_vehicle(name)


def test_missing_file() -> None:
    with pytest.raises(
        VehicleError, match=r"^nowhere/x\.toml: there is no such vehicle file; check the path"
    ):
        resolve_vehicle("nowhere/x.toml")


def test_a_misspelled_path_has_its_neighbor(tmp_path: Path) -> None:
    (tmp_path / "result").mkdir()
    with pytest.raises(VehicleError, match=r"did you mean .*/result\?"):
        resolve_vehicle(tmp_path / "resul")
