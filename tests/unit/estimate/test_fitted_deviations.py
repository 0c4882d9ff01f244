"""The 95 % band of a fitted response holds 95 % of the readings when the model is right, by every method that has one."""

from __future__ import annotations

import numpy as np
import pytest

import stoop
from stoop.assessment.error_bars import error_bars
from stoop.estimate import methods
from stoop.estimate.fit import Options
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle

GYRO = 0.01

MANEUVER = """
duration = 12.0
rate = 50.0
[[input]]
control = "elevator"
shape = "3-2-1-1"
start = 1.0
step = 0.3
amplitude = 0.1
"""


@pytest.mark.parametrize("method", ["output-error", "filter-error", "multiple-shooting", "equation-error"])
def test_the_band_of_a_right_model_holds_the_readings(method: str) -> None:
    vehicle = stoop.load_vehicle("twin-boom").reduced("longitudinal")
    flight = simulate_flight(vehicle, parse_maneuver(MANEUVER, "m"), 3, name="f")
    fit = stoop.fit(vehicle, flight, ["0:12"], options=stoop.Options(method=method))
    (trace,) = fit.traces
    if method == "equation-error":
        assert all(one.deviation is not None for one in trace.channels.values()), (
            "its parameters are simulated"
        )
        return
    inside = []
    for one in trace.channels.values():
        assert one.deviation is not None
        errors = (one.measured - one.simulated) / one.deviation
        inside.append(np.abs(errors[np.isfinite(errors)]) < 1.96)
    assert np.mean(np.concatenate(inside)) == pytest.approx(0.95, abs=0.03)


def test_the_band_does_not_depend_on_the_stated_noise() -> None:
    """Where the file states five times the noise of the gyro, the slopes behind the band are still those of the simulation."""
    text = resolve_vehicle("twin-boom").text + f"[sensors.q]\nsigma = {5.0 * GYRO}\n"
    vehicle = parse_vehicle(text, "worse").reduced("longitudinal")
    maneuver = parse_maneuver(MANEUVER.replace("rate = 50.0", f"rate = 50.0\nnoise = {{ q = {GYRO} }}"), "m")
    flights = {"f": simulate_flight(vehicle, maneuver, 3, name="f")}
    method = "multiple-shooting"
    found = methods.find(method).fitter()(vehicle, flights, [Window("f", 0.0, 12.0)], Options(method=method))
    whole = found.problem.slopes(found.z, 0)[1] / found.problem.layout.scales
    covariance, q = error_bars(found).covariance, vehicle.outputs.index("q")
    k = len(covariance)
    own, simulated = (
        float(np.einsum("nj,jk,nk->", one[:, q, :k], covariance, one[:, q, :k]))
        for one in (found.reading_slopes(0), whole)
    )
    assert own == pytest.approx(simulated, rel=0.1)
