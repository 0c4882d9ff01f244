"""A longitudinal aircraft in gusts, and what its filter has to do with."""

import pytest
from helpers.flown import maneuver

from stoop import Flight, Vehicle, load_vehicle, simulate_flight
from stoop.vehicle import parse_vehicle
from stoop.workflow.demo import misled

TABLE = """
[turbulence]
u = { intensity = { value = 1.5, free = true, bounds = [0.05, 6.0] }, length = 200.0 }
w = { intensity = { value = 1.2, free = true, bounds = [0.05, 6.0] }, length = 100.0 }
"""
MANEUVER = maneuver(15.0, ("elevator", "3-2-1-1", 1.0, 0.4, 0.06), ("elevator", "doublet", 7.0, 1.0, 0.04))


@pytest.fixture(scope="session")
def gusty() -> Vehicle:
    return parse_vehicle(load_vehicle("twin-boom").text + TABLE, "gusty").reduced("longitudinal")


@pytest.fixture(scope="session")
def gusty_flight(gusty: Vehicle) -> Flight:
    return simulate_flight(gusty, MANEUVER, seed=4, name="sim")


@pytest.fixture(scope="session")
def gusty_start(gusty: Vehicle) -> Vehicle:
    """Ten coefficients, wrong by up to 60 %, and the intensities, half as strong as they are."""
    wrong, names = misled(gusty, 4), [f"turbulence.{axis}.intensity" for axis in "uw"]
    return wrong.with_numbers({n: {"value": 0.5 * gusty.value(n), "free": True} for n in names})
