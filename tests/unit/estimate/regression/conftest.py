"""A full aircraft that flies multisines on all controls, shared by these tests."""

from __future__ import annotations

import pytest

from stoop.flight import Flight
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle

DURATION = 25.0


def multisines(duration: float = DURATION, rate: float = 50.0) -> Maneuver:
    amplitudes = {"elevator": 0.2, "aileron": 0.08, "rudder": 0.12}
    more = {"shape": "multisine", "start": 0.0, "duration": duration, "band": 1.2, "stride": 3}
    inputs = [
        {"control": c, "amplitude": a, "first": 3 + i, **more} for i, (c, a) in enumerate(amplitudes.items())
    ]
    return Maneuver.model_validate({"duration": duration, "rate": rate, "input": inputs})


@pytest.fixture(scope="session")
def full() -> Vehicle:
    vehicle = resolve_vehicle("twin-boom")
    thrust = trim(vehicle, None, 200.0).changes["propulsion.thrust"]
    return vehicle.with_numbers({"propulsion.thrust": {"value": thrust}})


@pytest.fixture(scope="session")
def clean(full: Vehicle) -> Flight:
    return simulate_flight(full, multisines(), noise=False, name="clean")


@pytest.fixture(scope="session")
def noisy(full: Vehicle) -> Flight:
    return simulate_flight(full, multisines(), seed=1, name="noisy")
