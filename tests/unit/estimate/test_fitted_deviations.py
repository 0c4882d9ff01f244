"""The 95 % band of a fitted response holds 95 % of the readings when the model is right, by every method that has one."""

from __future__ import annotations

import numpy as np
import pytest
from unit.flown import maneuver

import stoop
from stoop.simulation.fly import simulate_flight

MANEUVER = maneuver(12.0, ("elevator", "3-2-1-1", 1.0, 0.3, 0.1))


@pytest.mark.parametrize("method", ["output-error", "filter-error", "multiple-shooting"])
def test_the_band_of_a_right_model_holds_the_readings(method: str) -> None:
    vehicle = stoop.load_vehicle("twin-boom").reduced("longitudinal")
    flight = simulate_flight(vehicle, MANEUVER, 3, name="f")
    (trace,) = stoop.fit(vehicle, flight, ["0:12"], options=stoop.Options(method=method)).traces
    inside = []
    for one in trace.channels.values():
        assert one.deviation is not None
        errors = (one.measured - one.simulated) / one.deviation
        inside.append(np.abs(errors[np.isfinite(errors)]) < 1.96)
    assert np.mean(np.concatenate(inside)) == pytest.approx(0.95, abs=0.03)
