"""Vehicles that are exported, their steady flights, and a JSBSim that holds them."""

import pytest

from stoop.simulation import Trim, trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries


@pytest.fixture(scope="session")
def square() -> Vehicle:
    entries = {("rotors", "T1"): 0.0, ("rotors", "T2"): 8.5, ("environment", "density"): 1.225}
    return with_entries(builtin_vehicle("quad-x"), entries)


@pytest.fixture(scope="session")
def steady(twin_boom: Vehicle) -> Trim:
    return trim(twin_boom, 35.0, 200.0)
