"""A longitudinal aircraft, its simulated flight, and a finished job with its folder, for tests of all packages."""

from pathlib import Path

import pytest

from stoop.flight import Flight
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle, load_vehicle
from stoop.workflow import FittedModel
from stoop.workflow.demo import MANEUVER, misled
from stoop.workflow.identification import finish, search


@pytest.fixture(scope="session")
def twin_boom() -> Vehicle:
    return builtin_vehicle("twin-boom")


@pytest.fixture(scope="session")
def aircraft() -> Vehicle:
    return load_vehicle("twin-boom").reduced("longitudinal")


@pytest.fixture(scope="session")
def flight(aircraft: Vehicle) -> Flight:
    return simulate_flight(aircraft, parse_maneuver(MANEUVER, "test"), seed=3, name="sim")


@pytest.fixture(scope="session")
def wrong(aircraft: Vehicle) -> Vehicle:
    return misled(aircraft, 3)


@pytest.fixture(scope="session")
def job(wrong: Vehicle, flight: Flight) -> FittedModel:
    return finish(search(wrong, flight, ["0:20"], ["20:28"], command="stoop identify <here>"))


@pytest.fixture(scope="session")
def folder(job: FittedModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return job.save(tmp_path_factory.mktemp("job") / "result")


@pytest.fixture
def blank_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write an empty page where a report would be rendered, which takes its time."""
    monkeypatch.setattr("stoop.report.identification.render", lambda model: "<html></html>")
