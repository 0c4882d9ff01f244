"""The aircraft of the PS-GDE paper."""

from __future__ import annotations

from importlib.resources import files

import pytest

from stoop.vehicle import Vehicle, load_vehicle


@pytest.fixture(scope="session")
def twin_boom() -> Vehicle:
    return load_vehicle(str(files("stoop") / "data" / "twin_boom.toml"))
