"""A longitudinal aircraft and its simulated flight, shared by these tests."""

import pytest

from stoop.flight import Flight
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.demo import MANEUVER, misled


@pytest.fixture(scope="session")
def aircraft() -> Vehicle:
    return resolve_vehicle("twin-boom").reduced("longitudinal")


@pytest.fixture(scope="session")
def flight(aircraft: Vehicle) -> Flight:
    return simulate_flight(aircraft, parse_maneuver(MANEUVER, "test"), seed=3, name="sim")


@pytest.fixture(scope="session")
def wrong(aircraft: Vehicle) -> Vehicle:
    return misled(aircraft, 3)


@pytest.fixture
def blank_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write an empty page where a report would be rendered, which takes its time."""
    monkeypatch.setattr("stoop.report.identification.render", lambda model: "<html></html>")
