"""Vehicles that are exported, their steady flights, and a JSBSim that holds them."""

from __future__ import annotations

import pytest

from stoop.simulation import Trim, trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle


@pytest.fixture(scope="session")
def twin_boom() -> Vehicle:
    return builtin_vehicle("twin-boom")


@pytest.fixture(scope="session")
def steady(twin_boom: Vehicle) -> Trim:
    return trim(twin_boom, 35.0, 200.0)
