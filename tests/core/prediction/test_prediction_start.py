"""Initial states of predictions, estimated with the model from before the window, against simulated truth."""

from dataclasses import replace

import numpy as np
import pytest

from stoop.flight import Flight
from stoop.prediction.initial_state import BiasPrior, Predictor, bias_priors, predict_stretch, stretch_before
from stoop.prediction.predict import Prediction, predict
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.results.result import Covariance, NoiseCovariance
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle
from stoop.workflow.demo import MANEUVER

#: sensor noise of a rough record, SI, in the order of the outputs V, alpha, q, theta, ax, az
ROUGH = {"V": 0.8, "alpha": 0.02, "q": 0.05, "theta": 0.02, "ax": 0.5, "az": 1.0}
RUNS = 24


def model_of(vehicle: Vehicle, sigma: dict[str, float], errors: dict[str, float] | None = None) -> Predictor:
    """Return a vehicle whose noise is known, and some of whose numbers have a standard error."""
    known, outputs = errors or {}, vehicle.outputs
    covariance = np.diag(np.square([*known.values()])).reshape(len(known), len(known))
    noise = NoiseCovariance(outputs, np.diag([sigma[c] ** 2 for c in outputs]))
    return Predictor(vehicle, Covariance(tuple(known), covariance), noise)


@pytest.fixture(scope="module")
def truth(aircraft: Vehicle) -> Flight:
    quiet = "\n".join(f"{c} = 0.0" for c in aircraft.outputs)
    maneuver = parse_maneuver(f"{MANEUVER.partition('[noise]')[0]}\n[noise]\n{quiet}\n", "m")
    return simulate_flight(aircraft, maneuver, seed=0, name="sim")


def noisy(truth: Flight, sigma: dict[str, float], seed: int) -> Flight:
    rng, data = np.random.default_rng(seed), truth.data
    changed = {c: data[c] + s * rng.standard_normal(data[c].size) for c, s in sigma.items() if c in data}
    return replace(truth, data=data.assign(changed))


def ahead(model: Predictor, flight: Flight, window: Window) -> Prediction:
    return predict(model, {flight.name: flight}, [window], [{}])


def naive_readings(vehicle: Vehicle, flight: Flight, window: Window) -> np.ndarray:
    """Return the readings from the line through the first 0.2 s of the window, as they were predicted before."""
    from stoop.problem import Layout, Misfit, Weights

    (piece,) = Prepared.of(vehicle, {flight.name: flight}, [window]).pieces
    layout = replace(Layout.of(vehicle, ()), parameters=())
    problem = Misfit(layout, (piece,), Weights.of(np.ones(len(vehicle.outputs))), ((len(piece.time),),))
    return problem.outputs(np.empty(0), 0)


def test_the_start_is_accurate_and_its_band_holds_the_truth(aircraft: Vehicle, truth: Flight) -> None:
    window, model = Window("sim", 20.0, 24.0), model_of(aircraft, ROUGH)
    exact = np.column_stack([Prepared.of(aircraft, {"sim": truth}, [window]).pieces[0].measured])
    errors, naive, scaled = [], [], []
    for seed in range(RUNS):
        flight = noisy(truth, ROUGH, seed)
        found = ahead(model, flight, window)
        error, noise = found.readings[0] - exact, np.array([ROUGH[c] for c in aircraft.outputs])
        errors.append(error)
        naive.append(naive_readings(aircraft, flight, window) - exact)
        scaled.append(error / np.sqrt(found.deviations[0] ** 2 - noise**2))
    rms, before = (np.sqrt(np.mean(np.square(e), axis=(0, 1))) for e in (errors, naive))
    assert np.all(rms < 0.8 * before)
    assert np.all(rms[:4] < 0.6 * before[:4])  # V, alpha, q, theta
    # Four seconds of one window are one draw, so that 24 runs hold 24: chi-square of 24 per channel is within 40 %.
    assert np.sqrt(np.mean(np.square(scaled), axis=(0, 1))) == pytest.approx(np.ones(6), abs=0.4)


@pytest.mark.parametrize(("name", "error"), [("Cmalpha", 0.05), ("Cmq", 1.0), ("CLalpha", 0.1)])
def test_an_uncertain_number_widens_bands(aircraft: Vehicle, truth: Flight, name: str, error: float) -> None:
    """The naive twin estimates the start anew with another value, and predicts from there."""
    window, value = Window("sim", 6.0, 10.0), aircraft.value(name)
    (piece,) = Prepared.of(aircraft, {"sim": truth}, [window]).pieces
    stretch = stretch_before(aircraft, {"sim": truth}, window, piece)
    assert stretch.first > 0
    assert stretch.samples == pytest.approx(1.0 / piece.dt, abs=1)
    others = [aircraft.with_numbers({name: {"value": value + 1e-3 * error * s}}) for s in (1.0, -1.0)]
    up, down = (predict_stretch(model_of(other, ROUGH), stretch).readings for other in others)
    known, uncertain, unbounded = (
        predict_stretch(model_of(aircraft, ROUGH, errors), stretch)
        for errors in ({}, {name: error}, {name: error, "CD0": np.inf})
    )
    expected, found = np.abs(up - down) / 2e-3, np.sqrt(uncertain.deviation**2 - known.deviation**2)
    some = expected > 0.2 * expected.max(axis=0)
    assert found[some] == pytest.approx(expected[some], rel=0.05)
    np.testing.assert_allclose(unbounded.readings, uncertain.readings)
    assert np.isnan(unbounded.deviation).all()


def test_a_state_that_was_not_recorded_is_told_by_the_others(aircraft: Vehicle, truth: Flight) -> None:
    """Off its trim, where steady flight would be wrong, alpha follows from the motion before the window."""
    sigma = {c: 0.1 * s for c, s in ROUGH.items()}
    window, flight = Window("sim", 10.4, 13.0), noisy(truth, sigma, 5)
    blind = replace(flight, data=flight.data.assign(alpha=np.nan * flight.data["alpha"]))
    found, place = ahead(model_of(aircraft, sigma), blind, window), aircraft.outputs.index("alpha")
    exact = Prepared.of(aircraft, {"sim": truth}, [window]).pieces[0].measured[:, place]
    assert np.abs(found.readings[0][0, place] - exact[0]) < 0.01
    assert found.deviations[0][0, place] < 0.012
    (told,) = [n for n in found.prepared.notices if n.code == "predicted-from-trim"]
    assert told.values["channels"] == ("alpha",)
    assert str(told.values["errors"][0]).endswith("deg")
    # without a record before the window, its own beginning is used
    unstable = aircraft.with_numbers({"Cmalpha": {"value": 60.0}})
    for vehicle, start, times in ((aircraft, 0.0, [(0.0,)]), (aircraft, 2.0, []), (unstable, 20.0, [])):
        found = ahead(model_of(vehicle, ROUGH), truth, Window("sim", start, start + 5.0))
        told_of = [n.values["times"] for n in found.prepared.notices if n.code == "start-from-prediction"]
        assert told_of == times
        assert found.readings[0].shape == found.deviations[0].shape, "a divergence is a value"


@pytest.mark.parametrize("maneuvers", [2, 8])
def test_priors_of_biases_hold_those_of_a_further_maneuver(maneuvers: int) -> None:
    """Of sensors whose biases are 0.3 and 3 times as large as the file says."""
    rng, names = np.random.default_rng(0), [f"b{i}" for i in range(9)]
    width, held = {n: 10.0 ** (i % 3 - 1) for i, n in enumerate(names)}, []
    for draw in range(300):
        size = {n: (3.0 if draw % 2 else 0.3) * w for n, w in width.items()}
        flown = [{n: 5.0 + s * rng.standard_normal() for n, s in size.items()} for _ in range(maneuvers + 1)]
        priors = bias_priors([(f"f{i}", one) for i, one in enumerate(flown[1:])], "new", width)
        held += [abs(flown[0][n] - priors[n].mean) < 1.96 * priors[n].deviation for n in names]
    assert 0.93 < np.mean(held) < 0.98


def test_biases_of_one_maneuver_are_held_and_those_of_the_same_flight_come_first() -> None:
    fitted = [("a", {"b": 1.0}), ("b", {"b": 3.0}), ("b", {"b": 3.2})]
    of_b, new = bias_priors(fitted, "b", {}), bias_priors(fitted, None, {})
    assert bias_priors(fitted, "a", {}) == {"b": BiasPrior(1.0)}
    assert of_b["b"].mean == pytest.approx(3.1)
    assert of_b["b"].deviation < 0.5
    assert new["b"].mean == pytest.approx(0.5 * (1.0 + 3.1)), "each flight counts once"
    assert bias_priors(fitted[1:], None, {}) == bias_priors(fitted[1:], "b", {}), "of one its maneuvers"


def test_a_flight_of_other_biases_lies_within_the_band(aircraft: Vehicle, truth: Flight) -> None:
    own = {"alpha": 0.04, "q": 0.03, "az": -1.5}
    biased = replace(truth, data=truth.data.assign({c: truth.data[c] + b for c, b in own.items()}))
    sigma = {c: 0.1 * s for c, s in ROUGH.items()}
    flight, window = noisy(biased, sigma, 3), Window("sim", 6.0, 12.0)
    numbers = {f"sensors.{c}.bias": {"value": 0.0, "free": True, "prior": 1.0} for c in own}
    model = model_of(aircraft.with_numbers(numbers), sigma)

    def inside(deviation: float) -> dict[str, float]:
        widths = zip(numbers, own.values(), strict=True)
        priors = {name: BiasPrior(0.0, deviation * abs(b)) for name, b in widths}
        found = predict(model, {"sim": flight}, [window], [priors])
        error = np.abs(found.prepared.pieces[0].measured - found.readings[0])
        shares = np.mean(error < 1.96 * found.deviations[0], axis=0)
        return dict(zip(aircraft.outputs, shares.tolist(), strict=True))

    assert min(inside(0.0)[c] for c in own) < 0.3
    assert min(inside(1.0).values()) > 0.85
