"""A full aircraft that flies multisines on all controls, shared by these tests."""

import pytest

from stoop import Flight, Vehicle, load_vehicle, simulate_flight, trim
from stoop.simulation.maneuver import Maneuver

DURATION = 25.0


def multisines() -> Maneuver:
    amplitudes = {"elevator": 0.2, "aileron": 0.08, "rudder": 0.12}
    more = {"shape": "multisine", "start": 0.0, "duration": DURATION, "band": 1.2, "stride": 3}
    first = enumerate(amplitudes.items(), 3)
    inputs = [{"control": c, "amplitude": a, "first": i, **more} for i, (c, a) in first]
    return Maneuver.model_validate({"duration": DURATION, "rate": 50.0, "input": inputs})


@pytest.fixture(scope="session")
def full() -> Vehicle:
    vehicle = load_vehicle("twin-boom")
    thrust = trim(vehicle, None, 200.0).changes["propulsion.thrust"]
    return vehicle.with_numbers({"propulsion.thrust": {"value": thrust}})


@pytest.fixture(scope="session")
def clean(full: Vehicle) -> Flight:
    return simulate_flight(full, multisines(), noise=False, name="clean")


@pytest.fixture(scope="session")
def noisy(full: Vehicle) -> Flight:
    return simulate_flight(full, multisines(), seed=1, name="noisy")
