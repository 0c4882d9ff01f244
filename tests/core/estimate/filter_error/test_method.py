"""Filter error on simulated turbulence, beside output error on the same flights, and on windows that are held back."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.fits import fit_by
from scipy.stats import norm

from stoop import FittedModel, Flight, Options, Vehicle, simulate_flight, validate
from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import FloatArray
from stoop.estimate import methods
from stoop.estimate.filter_error import raised
from stoop.estimate.fitted_filter import FittedFilter
from stoop.estimate.treatment import Treatment
from stoop.prediction.initial_state import Predictor
from stoop.prediction.predict import Prediction, predict
from stoop.problem.windows import Window
from stoop.results.result import Covariance, NoiseCovariance, ProcessNoise, Result, from_json, to_json
from stoop.workflow.identification import fit

from .conftest import MANEUVER

WINDOW = Window("sim", 0.0, 15.0)


def errors(vehicle, flight, method, **options):
    found = fit_by(method, vehicle, {"sim": flight}, [WINDOW], **options)
    truth, std = json.loads(flight.data.attrs["truth"]), ErrorBars.of(found).std
    off = np.array([found.estimates[p.name] - truth[p.name] for p in found.problem.layout.parameters])
    return found, off, std[: len(off)]


@pytest.fixture(scope="module")
def steady(gusty_start, gusty_flight):
    return errors(gusty_start, gusty_flight, "filter-error")


def test_truth_lies_within_the_error_bars_and_innovations_are_white(steady):
    found, off, std = steady
    assert found.outcome.status == "converged"
    assert np.abs(off / std).max() < 3.5
    assert np.sqrt(np.mean((off / std) ** 2)) < 1.6
    for residual in (piece.residual for piece in found.evidence.pieces):
        lag = np.mean(residual[1:] * residual[:-1], axis=0) / np.mean(residual**2, axis=0)
        assert np.abs(lag).max() < 4.0 / np.sqrt(len(residual))
        assert np.mean(residual**2) == pytest.approx(1.0, abs=0.1)
    vehicle = found.problem.layout.vehicle
    true = [getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs]
    assert np.sqrt(np.diag(found.measurement_noise)) == pytest.approx(true, rel=0.2)


def test_the_first_noise_is_at_least_what_innovations_show(steady):
    """A search from the low noise of second differences costs a step for every factor of e."""
    found = steady[0]
    at = found.likelihood.known + found.problem.layout.vehicle.outputs.index("theta")
    low = found.optimum - 4.0 * (np.arange(len(found.optimum)) == at)
    assert raised(found.likelihood, low)[at] == pytest.approx(found.optimum[at], abs=0.5)
    assert np.array_equal(raised(found.likelihood, found.optimum), found.optimum)


def test_a_limit_of_steps_ends_it_and_more_of_them_go_on(steady, gusty_start, gusty_flight):
    args = ("filter-error", gusty_start, {"sim": gusty_flight}, [WINDOW])
    few = fit_by(*args, generations=4)
    assert (few.outcome.status, few.outcome.generation) == ("generations", 4)
    assert "--generations" in few.outcome.advice
    more = fit_by(*args, state=few.outcome.state)
    assert more.outcome.status == "converged"
    assert np.array_equal(more.z, steady[0].z)
    older = replace(few.outcome.state, memory=np.empty((0, 0)))  # as a release wrote it that kept no secant
    assert fit_by(*args, state=older).outcome.status == "converged"
    assert fit_by(*args, budget=100.0).outcome.status == "budget"


def test_a_gain_that_follows_the_flight_finds_the_same(steady, gusty_start, gusty_flight):
    varying, off, std = errors(gusty_start, gusty_flight, "filter-error-ekf")
    assert np.abs(off / std).max() < 3.5
    for name in ("CLalpha", "Cmalpha", "Cmq", "Cmelevator"):
        assert varying.estimates[name] == pytest.approx(steady[0].estimates[name], rel=0.05)


def test_output_error_is_worse_than_filter_error_and_too_sure_by_weights_of_white_noise(gusty, gusty_start):
    """By the color of its residuals it is less sure."""
    fixed = gusty_start.with_numbers({f"turbulence.{a}.intensity": {"free": False} for a in "uw"})
    flights = [simulate_flight(gusty, MANEUVER, seed=seed, name="sim") for seed in range(8)]
    size, held = [], []
    for method, colored in (("filter-error", False), ("output-error", True), ("output-error", False)):
        start, treatment = fixed if method == "output-error" else gusty_start, Treatment(noise_color=colored)
        each = [errors(start, one, method, treatment=treatment)[1:] for one in flights]
        off, std = (np.array(x)[:, :10] for x in zip(*each, strict=True))
        size.append(np.sqrt(np.mean(off**2, axis=0)))
        held.append(np.mean(np.abs(off) <= 1.96 * std))
    assert np.median(size[1] / size[0]) > 3.0
    assert np.median(size[2] / size[0]) > 3.0
    assert held[0] > 0.85
    assert held[2] < 0.8 < held[1]


def test_without_gusts_in_the_file_white_accelerations_stand_for_them(gusty_flight, gusty_start):
    calm = replace(gusty_start, file=gusty_start.file.model_copy(update={"turbulence": None}))
    found, off, std = errors(calm, gusty_flight, "filter-error")
    assert "process-noise" in [n.code for n in found.notices]
    assert np.abs((off / std)[:10]).max() < 5.0


@pytest.mark.parametrize("method", ["filter-error", "filter-error-ekf"])
def test_an_interrupted_fit_is_resumed_to_the_same_result(gusty_start, gusty_flight, resumed, method):
    window, options = [Window("sim", 0.0, 4.0)], Options(method=method)
    found = resumed(methods.find(method).fitter(), gusty_start, {"sim": gusty_flight}, window, options)
    assert found.outcome.status == "converged"


def test_spikes_count_as_not_measured(steady, gusty_start, gusty_flight):
    rng, data, at = np.random.default_rng(0), gusty_flight.data.copy(deep=True), {}
    for channel in gusty_start.outputs:
        sigma = getattr(gusty_start.file.sensors, channel).sigma
        at[channel] = np.flatnonzero(rng.random(data.sizes["time"]) < 0.01)
        data[channel][at[channel]] += 60.0 * sigma * rng.choice([-1.0, 1.0], len(at[channel]))
    (clean, _, std), spiked = steady, errors(gusty_start, replace(gusty_flight, data=data), "filter-error")[0]
    assert not any(n.code == "outliers-missing" for n in clean.notices)
    (said,) = [n for n in spiked.notices if n.code == "outliers-missing"]
    assert set(said.values["channels"]) == set(gusty_start.outputs)
    lost = np.isnan(spiked.problem.pieces[0].measured)
    assert all(lost[at[channel], i].all() for i, channel in enumerate(gusty_start.outputs))
    assert lost.sum() <= 1.1 * sum(map(len, at.values()))
    for (name, value), error in zip(clean.estimates.items(), std, strict=False):
        assert spiked.estimates[name] == pytest.approx(value, abs=error)


@pytest.fixture(scope="module")
def flights(gusty: Vehicle) -> list[Flight]:
    return [simulate_flight(gusty, MANEUVER, seed=20 + k, name=f"flight{k}") for k in range(3)]


def ahead_of(vehicle: Vehicle, *flights: Flight) -> Prediction:
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


def test_innovations_of_the_truth_are_white_and_as_large_as_expected_and_of_a_wrong_model_not(gusty, flights):
    ahead = ahead_of(gusty, *flights)
    rms, r = np.array([np.sqrt(np.mean(v**2, axis=0)) for v in ahead.innovations or ()]), correlations(ahead)
    assert np.all(np.abs(rms - 1.0) < 0.1)
    assert np.mean(np.abs(r) < 1.96) > 0.8
    assert np.max(np.abs(r)) < 4.0
    for name, factor in (("Cmelevator", 1.4), ("Cmalpha", 1.6), ("CLalpha", 1.4)):
        wrong = gusty.with_numbers({name: {"value": factor * gusty.value(name)}})
        assert np.max(np.abs(correlations(ahead_of(wrong, flights[2])))) > 4.0, name


def test_the_likelihood_of_a_window_in_gusts_is_that_of_its_innovations(gusty, flights):
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
    return fit(gusty_start, flights, windows, "flight2@0:15", Options(method="filter-error"))


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
