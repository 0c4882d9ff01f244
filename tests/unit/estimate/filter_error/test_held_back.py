"""Windows held back from a filter fit: innovations of a right model and of wrong ones, and a band that holds the gusts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from stoop.base.arrays import FloatArray
from stoop.estimate.fit import Options
from stoop.estimate.fitted_filter import FittedFilter
from stoop.flight import Flight
from stoop.prediction.initial_state import Predictor
from stoop.prediction.predict import Prediction, predict
from stoop.problem.windows import Window
from stoop.results.result import Covariance, NoiseCovariance, ProcessNoise, Result, from_json, to_json
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.identification import identify
from stoop.workflow.validation import validate

from .conftest import MANEUVER


@pytest.fixture(scope="module")
def flights(gusty: Vehicle) -> list[Flight]:
    return [simulate_flight(gusty, MANEUVER, seed=20 + k, name=f"flight{k}") for k in range(3)]


def ahead_of(vehicle: Vehicle, *flights: Flight) -> Prediction:
    """Return predictions with the noise of the vehicle file, as a fit that found the truth would make them."""
    sigma = np.array([getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs])
    noise = NoiseCovariance(vehicle.outputs, np.diag(sigma**2))
    known = FittedFilter.of_result(vehicle, noise, ProcessNoise("steady"))
    model = Predictor(vehicle, Covariance((), np.empty((0, 0))), noise, known)
    windows = [Window(f.name, 0.0, 15.0) for f in flights]
    return predict(model, {f.name: f for f in flights}, windows, [{}] * len(flights))


def correlations(ahead: Prediction) -> FloatArray:
    """Return those of neighboring innovations, in the standard errors of white ones, 1 / sqrt(n)."""
    assert ahead.innovations is not None
    each = [np.mean(v[1:] * v[:-1], axis=0) / np.mean(v**2, axis=0) for v in ahead.innovations]
    return np.array(each) * np.sqrt(750)


def test_innovations_of_the_truth_are_white_and_as_large_as_expected_and_of_a_wrong_model_not(
    gusty: Vehicle, flights: list[Flight]
) -> None:
    """Of 18 curves."""
    ahead = ahead_of(gusty, *flights)
    rms, r = np.array([np.sqrt(np.mean(v**2, axis=0)) for v in ahead.innovations or ()]), correlations(ahead)
    assert np.all(np.abs(rms - 1.0) < 0.1)
    assert np.mean(np.abs(r) < 1.96) > 0.8
    assert np.max(np.abs(r)) < 4.0
    for name, factor in (("Cmelevator", 1.4), ("Cmalpha", 1.6), ("CLalpha", 1.4)):
        wrong = gusty.with_numbers({name: {"value": factor * gusty.value(name)}})
        assert np.max(np.abs(correlations(ahead_of(wrong, flights[2])))) > 4.0, name


def test_the_likelihood_of_a_window_in_gusts_is_that_of_its_innovations(
    gusty: Vehicle, flights: list[Flight]
) -> None:
    """It tells a wrong control derivative by many standard errors, where a simulation in gusts can not."""
    wrong = gusty.with_numbers({"Cmelevator": {"value": 1.2 * gusty.value("Cmelevator")}})
    found, simulated = [], []
    for vehicle in (gusty, wrong):
        ahead = ahead_of(vehicle, flights[2])
        assert ahead.innovations is not None
        assert ahead.expected is not None
        ((v,), (s,)) = ahead.innovations, ahead.expected
        density = norm.logpdf(v * s, scale=s) + 0.5 * np.log(2.0 * np.pi)
        found.append(ahead.log_likelihood(vehicle.outputs))
        assert found[-1] == pytest.approx(density.sum(axis=1))
        simulated.append(replace(ahead, innovations=None, expected=None).log_likelihood(vehicle.outputs))
    gains = [one[0] - one[1] for one in (found, simulated)]
    scores = [np.sum(one) / np.sqrt(len(one) * np.var(one)) for one in gains]
    assert scores[0] > 5.0
    assert scores[1] < scores[0]


@pytest.fixture(scope="module")
def job(gusty_start: Vehicle, flights: list[Flight]) -> FittedModel:
    windows = ["flight0@0:15", "flight1@0:15"]
    return identify(gusty_start, flights, windows, "flight2@0:15", Options(method="filter-error"))


def held_back(result: Result) -> dict[str, float]:
    (maneuver,) = (m for m in result.maneuvers if m.role == "validation")
    return {c: one.innovations.rms for c, one in maneuver.channels.items()}


def test_a_right_model_in_gusts_is_not_refused(job: FittedModel) -> None:
    result = job.result
    assert result.verdict.grade in ("trusted", "usable")
    assert held_back(result) == pytest.approx(dict.fromkeys(held_back(result), 1.0), abs=0.1)
    assert not {"verdict-innovations", "verdict-outside"} & {n.code for n in result.verdict.against}
    assert held_back(from_json(to_json(result))) == held_back(result)


def test_validation_finds_the_same(job: FittedModel, flights: list[Flight], tmp_path: Path) -> None:
    job.save(tmp_path)
    again = validate(tmp_path, [flights[2]], ["0:15"])
    found = {c: one.innovations.rms for c, one in again.record.maneuvers[0].channels.items()}
    assert found == pytest.approx(held_back(job.result), rel=1e-6)
