"""Bias of a reduced model by the motion that it holds, predicted from the record, against fits to simulated truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stoop.assessment.error_bars import error_bars
from stoop.assessment.reduction import neglected_motion, reduction_notices
from stoop.estimate.fit import Fit, fit
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle

MANEUVER = """
duration = 16.0
rate = 50.0
[[input]]
control = "elevator"
shape = "pulse"
start = 0.5
duration = 3.0
amplitude = {elevator}
[[input]]
control = "aileron"
shape = "3-2-1-1"
start = 2.0
step = 0.5
amplitude = {size}
[[input]]
control = "rudder"
shape = "3-2-1-1"
start = 7.0
step = 0.6
amplitude = {size}
[noise]
"""
SIGMA = dict.fromkeys(("alpha", "beta", "p", "q", "r", "phi", "theta", "psi"), 0.002)
NOISE = {"V": 0.1, "ax": 0.05, "ay": 0.05, "az": 0.05, **SIGMA}
OBSERVED = ("Clbeta", "Clp", "Claileron", "Cnbeta")  #: well determined here, and the most biased


@pytest.fixture(scope="module")
def full() -> Vehicle:
    return resolve_vehicle("twin-boom")


def flown(full: Vehicle, elevator: float, size: float = 0.04) -> Flight:
    noise = "\n".join(f"{c} = {s}" for c, s in NOISE.items())
    text = MANEUVER.format(elevator=elevator, size=size) + noise
    return simulate_flight(full, parse_maneuver(text, "mixed"), seed=1, name="sim")


def lateral_fit(full: Vehicle, flight: Flight) -> Fit:
    return fit(full.reduced("lateral"), {"sim": flight}, [Window("sim", 0.0, 16.0)])


@pytest.mark.parametrize("elevator", [0.06, -0.1])
def test_the_bias_of_a_lateral_model_flown_at_changing_speed_is_predicted(
    full: Vehicle, elevator: float
) -> None:
    flight = flown(full, elevator)
    found = lateral_fit(full, flight)
    lacking = neglected_motion(found, {"sim": flight})
    assert set(lacking.departures) == {"V", "alpha", "q", "theta"}
    assert lacking.departures["V"] > 2.0
    actual = np.array([found.estimates[n] - full.value(n) for n in OBSERVED])
    predicted = np.array([lacking.biases[n] for n in OBSERVED])
    assert (actual > 0).tolist() == (predicted > 0).tolist()
    assert np.all((predicted / actual > 0.4) & (predicted / actual < 1.5))
    (told,) = reduction_notices(found, {"sim": flight}, error_bars(found))
    assert told.code == "reduced-model-biased"
    assert "Claileron" in told.values["parameters"]
    assert "V by" in str(told)
    assert "fit the full model" in str(told)


def test_a_maneuver_that_leaves_the_held_states_alone_is_not_told(full: Vehicle) -> None:
    flight = flown(full, 0.0, 0.004)
    found = lateral_fit(full, flight)
    lacking = neglected_motion(found, {"sim": flight})
    assert all(abs(lacking.biases[n] / full.value(n)) < 0.01 for n in OBSERVED)
    assert not reduction_notices(found, {"sim": flight}, error_bars(found))


def test_states_that_were_not_recorded_and_whole_models_say_nothing(full: Vehicle) -> None:
    flight = flown(full, 0.06)
    longitudinal = full.reduced("longitudinal")
    blind = replace(flight, data=flight.data.drop_vars(["beta", "p", "r", "phi", "psi"]))
    found = fit(longitudinal, {"sim": blind}, [Window("sim", 0.0, 16.0)])
    assert neglected_motion(found, {"sim": blind}).biases == {}
    assert reduction_notices(found, {"sim": blind}, error_bars(found)) == []
