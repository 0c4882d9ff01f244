"""The flight of the V-tail and its simulated twin, read once by each worker."""

from pathlib import Path

import pytest
from real import simulated

from stoop.flight import Flight, load_flight
from stoop.vehicle import load_vehicle


@pytest.fixture(scope="session")
def vtail_flight(shared_data: Path) -> Flight:
    return load_flight(shared_data / "altlnt-vtail-8kg-px4" / "flight2")


@pytest.fixture(scope="session")
def simulated_flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """Return the flight of a log that anybody has: PX4's, in a closed loop, with gusts, dropouts and a faulty pitot."""
    log = tmp_path_factory.mktemp("simulated") / "flight.ulg"
    return load_flight(simulated.write(log, load_vehicle(simulated.EXAMPLE)))
