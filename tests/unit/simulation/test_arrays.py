"""Inputs as arrays fly as the maneuver that they were taken from."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.errors import ManeuverError
from stoop.simulation import trim
from stoop.simulation.fly import simulate, simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import builtin_vehicle

MANEUVER = (
    'duration = 4.0\nrate = 50.0\n[[input]]\ncontrol = "elevator"\nshape = "doublet"\nstart = 0.5\n'
    "step = 0.4\namplitude = 0.05\n"
)


def test_recorded_channels_of_a_flight_fly_it_again() -> None:
    vehicle = builtin_vehicle("twin-boom")
    flight = simulate_flight(vehicle, parse_maneuver(MANEUVER, "m"), noise=False)
    again = simulate(vehicle, flight)
    for channel in ("q", "alpha", "az", "altitude"):
        np.testing.assert_allclose(again.column(channel), flight.column(channel), rtol=0.0, atol=1e-9)


def test_a_deflection_as_array() -> None:
    vehicle = builtin_vehicle("twin-boom")
    time = np.arange(201) / 50.0
    maneuver = parse_maneuver(MANEUVER, "m")
    deflection = trim(vehicle).deflections["elevator"] + maneuver.deflections()["elevator"]
    flown = simulate(vehicle, {"elevator": deflection}, time)
    expected = simulate_flight(vehicle, maneuver, noise=False)
    np.testing.assert_allclose(flown.column("q"), expected.column("q"), atol=1e-9)


def test_inputs_of_a_dataset_and_noise_by_seed() -> None:
    vehicle = builtin_vehicle("twin-boom")
    flight = simulate_flight(vehicle, parse_maneuver(MANEUVER, "m"), noise=False)
    one, two = (simulate(vehicle, flight.data, noise=True, seed=s) for s in (1, 1))
    np.testing.assert_array_equal(one.column("q"), two.column("q"))
    assert np.std(one.column("q") - flight.column("q")) == pytest.approx(
        vehicle.file.sensors.q.sigma, rel=0.2
    )


@pytest.mark.parametrize(
    ("inputs", "time", "advice"),
    [
        ({"elevater": np.zeros(3)}, np.arange(3.0), "did you mean elevator"),
        ({"elevator": np.zeros(2)}, np.arange(3.0), "as long as the time"),
        ({"elevator": np.zeros(3)}, np.array([0.0, 1.0, 3.0]), "one rate"),
        ({"elevator": np.zeros(3)}, None, "no time"),
        ({"elevator": np.array([0.0, np.nan, 0.0])}, np.arange(3.0), "not finite"),
    ],
)
def test_what_cannot_be_flown_is_said(
    inputs: dict[str, np.ndarray], time: np.ndarray | None, advice: str
) -> None:
    with pytest.raises(ManeuverError, match=advice):
        simulate(builtin_vehicle("twin-boom"), inputs, time)
