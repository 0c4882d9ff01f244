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


def test_inputs_as_arrays_fly_the_maneuver_again_with_noise_by_seed() -> None:
    vehicle, maneuver = builtin_vehicle("twin-boom"), parse_maneuver(MANEUVER, "m")
    flight = simulate_flight(vehicle, maneuver, noise=False)
    deflection = trim(vehicle).deflections["elevator"] + maneuver.deflections()["elevator"]
    flown = simulate(vehicle, flight), simulate(vehicle, {"elevator": deflection}, np.arange(201) / 50.0)
    for again in flown:
        for channel in ("q", "alpha", "az", "altitude"):
            np.testing.assert_allclose(again.column(channel), flight.column(channel), rtol=0.0, atol=1e-9)
    one, two = (simulate(vehicle, flight.data, noise=True, seed=s) for s in (1, 1))
    np.testing.assert_array_equal(one.column("q"), two.column("q"))
    error = one.column("q") - flight.column("q")
    assert np.std(error) == pytest.approx(vehicle.file.sensors.q.sigma, rel=0.2)


def test_inputs_that_cannot_be_flown() -> None:
    vehicle, three = builtin_vehicle("twin-boom"), np.arange(3.0)
    for inputs, time, advice in (
        ({"elevater": np.zeros(3)}, three, "did you mean elevator"),
        ({"elevator": np.zeros(2)}, three, "as long as the time"),
        ({"elevator": np.zeros(3)}, np.array([0.0, 1.0, 3.0]), "one rate"),
        ({"elevator": np.zeros(3)}, None, "no time"),
        ({"elevator": np.array([0.0, np.nan, 0.0])}, three, "not finite"),
    ):
        with pytest.raises(ManeuverError, match=advice):
            simulate(vehicle, inputs, time)
