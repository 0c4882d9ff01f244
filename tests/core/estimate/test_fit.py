"""Output error and its noise: starts, refusals, interruptions, optimizers, outliers, the band of a response by every method."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from helpers.flown import maneuver
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.stats import bartlett, norm
from threadpoolctl import threadpool_limits

import stoop
from stoop import Flight, Options, Vehicle, optimize, simulate_flight
from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError, StoopError
from stoop.estimate import noise_model as model
from stoop.estimate.fit import estimation_problem, fit, settle, starts
from stoop.estimate.noise import channel_residuals, correlation_times, noise_variance
from stoop.estimate.regression import start_value
from stoop.prediction.predict import expected_biases, predict, predictor
from stoop.problem import Misfit, Weights
from stoop.problem.observation import along_body, first_complete, guess_start, imu_axes
from stoop.problem.windows import Window
from stoop.simulation import START_NAMES
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import parse_vehicle
from stoop.workflow.demo import MANEUVER, TABLE_1

WINDOW, Patch = [Window("sim", 0.0, 30.0)], pytest.MonkeyPatch
DT = 0.02


def test_start_is_guessed_from_the_first_measurements(aircraft: Vehicle) -> None:
    """Biases, scales, the place of the vane and the alignment of the inertial unit are undone."""
    t, zero = np.arange(50) / 100.0, {c: np.zeros(50) for c in START_NAMES[:-1]}
    rising = {"V": 30.0 + 2.0 * t, "theta": np.full(50, np.nan)}
    start, missing = guess_start(aircraft, t, {c: zero[c] for c in ("alpha", "q")} | rising, "here")
    assert (start["V"], start["theta"], missing) == (pytest.approx(30.0), 0.0, ["theta"])
    for sensors, readings, wanted in (
        ("V = { scale = 0.8, bias = 1.0 }\nvane_position = [2.0, 0.0, 0.0]",
         {"V": 0.8 * 35.0 + 1.0, "q": 0.5, "alpha": 0.1 - 2.0 * 0.5 / 35.0}, {"V": 35.0, "alpha": 0.1}),
        ("imu_alignment = [0.0, 0.0, 0.3]", {"V": 35.0, "p": 0.5 * np.cos(0.3), "q": -0.5 * np.sin(0.3)},
         {"p": 0.5, "q": 0.0}),
    ):  # fmt: skip
        vehicle = parse_vehicle(f"{aircraft.text}\n[sensors]\n{sensors}\n", "read.toml")
        start, _ = guess_start(vehicle, t, zero | {c: np.full(50, x) for c, x in readings.items()}, "here")
        assert {n: start[n] for n in wanted} == pytest.approx(wanted, abs=1e-12), sensors
    late = {"V": np.array([np.nan, 1, 1, 1]), "q": np.array([1, 1, np.nan, 1.0]), "r": np.full(4, np.nan)}
    assert (first_complete(late), first_complete({"r": np.full(4, np.nan)})) == (1, 0)


def test_what_cannot_be_fitted_is_refused(wrong: Vehicle, flight: Flight, monkeypatch: Patch) -> None:
    held = wrong.with_numbers({p.name: {"free": False} for p in wrong.parameters})
    late = replace(flight, data=flight.data.copy(deep=True))
    late.data["V"][:-1] = np.nan
    for vehicle, flown, window, advice in (
        (held, flight, WINDOW, "--free"),
        (wrong, flight, [Window("sim", 0.0, 30.0, "heavy")], "loading"),
        (wrong, late, WINDOW, "whole state"),
    ):
        with pytest.raises(StoopError, match=advice):
            fit(vehicle, {"sim": flown}, window)
    with pytest.raises(IdentificationError, match=r"neither a name .*ps_gde\(mutation=...\)"):
        Options(optimizer=test_budget_holds_for_the_refinement_too)  # type: ignore[arg-type]
    monkeypatch.setattr("stoop.estimate.fit.MAX_BYTES", 1e5)
    with pytest.raises(IdentificationError, match="unit of the log's time"):
        fit(wrong, {"sim": flight}, WINDOW, Options())


def test_channels_that_say_nothing_are_left_out(aircraft: Vehicle, wrong: Vehicle, flight: Flight) -> None:
    """A stuck attitude; no vane, without which there is no equation error; a covariance that is given is kept."""
    stuck = replace(flight, data=flight.data.assign(theta=flight.data["theta"] * 0.0 + 0.01))
    blind = replace(stuck, data=stuck.data.drop_vars("alpha"))
    problem, _ = estimation_problem(wrong, {"sim": blind}, WINDOW, Options())
    assert start_value(problem.layout, problem.pieces) is None
    given = np.diag([0.09, 1e-4, 1e-4, 1e-4, 0.01, 0.01])
    given[0, 4] = given[4, 0] = 0.01
    found = fit(wrong, {"sim": blind}, WINDOW, Options(covariance=given))
    assert ("stuck-channel", "theta") in [(n.code, n.subject) for n in found.prepared.notices]
    assert found.estimates["Cmalpha"] == pytest.approx(aircraft.value("Cmalpha"), rel=0.2)
    assert np.allclose(found.problem.weights.covariance, given)


def test_components_that_a_reduced_model_holds_are_zero_along_the_body(aircraft: Vehicle) -> None:
    vehicle = parse_vehicle(aircraft.text + "\n[sensors]\nimu_alignment = [0.1, -0.2, 0.3]\n", "turned.toml")
    pitching = imu_axes(vehicle, vehicle.values) @ [0.0, 0.7, 0.0]
    assert along_body(vehicle, {"q": pitching[1]})["q"] == pytest.approx(0.7)
    turning = np.random.default_rng(1).standard_normal((3, 5))
    read = dict(zip(("ax", "ay", "az"), imu_axes(vehicle, vehicle.values) @ turning, strict=True))
    np.testing.assert_allclose(list(along_body(vehicle, read).values()), turning, atol=1e-12)


def test_budget_holds_for_the_refinement_too(wrong: Vehicle, flight: Flight) -> None:
    """Settling the weights (some 100 trajectories here) is counted, but not cut: a resumed search needs them."""
    problem, _ = estimation_problem(wrong, {"sim": flight}, WINDOW, Options())
    settling = settle(problem, starts(problem)).spent
    for budget in (settling + 20.0, settling + 60.0):
        found = fit(wrong, {"sim": flight}, WINDOW, Options(budget=budget))
        assert found.trajectories <= budget + 4.0
        assert found.notices or found.outcome.status != "converged"


def test_ctrl_c_early_keeps_the_first_dive(wrong: Vehicle, flight: Flight, monkeypatch: Patch) -> None:
    calls, residuals = itertools.count(1), Misfit.residuals

    def interrupt(self: Misfit, Z: np.ndarray, rung: int) -> np.ndarray:
        if next(calls) == 6:
            raise KeyboardInterrupt
        return residuals(self, Z, rung)

    monkeypatch.setattr(Misfit, "residuals", interrupt)
    found = fit(wrong, {"sim": flight}, WINDOW, Options())
    assert (found.outcome.status, found.outcome.state) == ("interrupted", None)
    assert np.isfinite(found.cost)


def test_biases_for_a_prediction_come_from_the_same_flight(aircraft: Vehicle, wrong: Vehicle) -> None:
    maneuver, biases, flights = parse_maneuver(MANEUVER, "test"), {"a": 0.03, "b": -0.03}, {}
    for name, bias in biases.items():
        biased = aircraft.with_numbers({"sensors.q.bias": {"value": bias}})
        flights[name] = simulate_flight(biased, maneuver, 1, name=name)
    found = fit(wrong, flights, [Window(n, 0.0, 20.0) for n in biases], Options())
    told = {n: expected_biases(found, n)["sensors.q.bias"].mean for n in biases}
    assert told == pytest.approx(biases, abs=0.003)
    known = predictor(found, 0.0 * ErrorBars.of(found).covariance)
    ahead = predict(known, flights, [Window("b", 20.0, 28.0)], [expected_biases(found, "b")])
    assert np.sqrt(np.mean((ahead.prepared.pieces[0].measured[:, 2] - ahead.readings[0][:, 2]) ** 2)) < 0.02


def test_a_channel_is_trusted_whatever_lies_between_the_pieces(aircraft: Vehicle, flight: Flight) -> None:
    """What a vehicle did between two maneuvers, kilometers for a position, tells nothing of the noise."""
    windows = [Window("sim", 0.0, 10.0), Window("sim", 15.0, 25.0)]
    problem, _ = estimation_problem(aircraft, {"sim": flight}, windows, Options())
    first, second = problem.pieces
    apart = replace(problem, pieces=(first, replace(second, measured=second.measured + 1e6)))
    residuals = [0.01 * np.random.default_rng(1).standard_normal(p.measured.shape) for p in problem.pieces]
    assert np.array_equal(noise_variance(apart, residuals), noise_variance(problem, residuals))
    assert noise_variance(apart, residuals) == pytest.approx(np.mean(np.concatenate(residuals) ** 2, axis=0))
    assert np.all(noise_variance(apart, [0.0 * r for r in residuals]) > 0.0)


def test_the_truth_and_the_noise_are_recovered_with_the_same_bits_whatever_the_threads(
    aircraft: Vehicle, wrong: Vehicle, flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = []
    for threads in (1, 2):
        monkeypatch.setenv("STOOP_THREADS", str(threads))
        with threadpool_limits(limits=threads, user_api="blas"):
            found.append(fit(wrong, {"sim": flight}, WINDOW, Options(seed=5)))
    one, other = found
    assert np.array_equal(one.z, other.z)
    assert np.array_equal(ErrorBars.of(one).std, ErrorBars.of(other).std, equal_nan=True)
    assert one.outcome.status == "converged"
    truth = {name: aircraft.value(name) for name in TABLE_1}
    assert {n: one.estimates[n] for n in TABLE_1} == pytest.approx(truth, rel=0.15)
    sigma = np.array([getattr(aircraft.file.sensors, c).sigma for c in aircraft.outputs])
    noise = noise_variance(one.problem, channel_residuals(one.problem, one.z))
    assert np.sqrt(noise) == pytest.approx(sigma, rel=0.1)


def test_optimizers_of_every_kind_reach_the_same_place(wrong: Vehicle, flight: Flight) -> None:
    best = fit(wrong, {"sim": flight}, WINDOW, Options()).estimates
    # one of each kind; an object does what its name does
    kinds = ("ps-gde", optimize.create("ps-gde"), "pso", "ordered-shade", "scipy-least-squares")
    found = [fit(wrong, {"sim": flight}, WINDOW, Options(optimizer=one, budget=3000.0)) for one in kinds]
    assert np.array_equal(found[0].z, found[1].z)
    assert found[1].outcome.optimizer == "ps-gde"
    for one in found:
        assert one.estimates == pytest.approx(best, rel=2e-3, abs=1e-4), one.outcome.optimizer


def test_an_interrupted_search_ends_where_an_undisturbed_one_does(wrong: Vehicle, flight: Flight) -> None:
    states: list[optimize.State] = []

    def interrupt(progress: optimize.Progress) -> None:
        states.append(progress.state)
        raise KeyboardInterrupt

    whole = fit(wrong, {"sim": flight}, WINDOW, Options())
    cut = fit(wrong, {"sim": flight}, WINDOW, Options(), interrupt)
    assert (cut.outcome.status, np.isfinite(cut.cost)) == ("interrupted", True)
    fit(wrong, {"sim": flight}, WINDOW, Options(budget=150.0), lambda p: states.append(p.state))
    for state in states[:2]:
        resumed = fit(wrong, {"sim": flight}, WINDOW, Options(), state=state)
        assert np.array_equal(whole.z, resumed.z)
        assert resumed.outcome.cost <= state.evaluations.cost


@pytest.mark.parametrize("method", ["output-error", "filter-error", "multiple-shooting"])
def test_the_band_of_a_right_model_holds_the_readings(aircraft: Vehicle, method: str) -> None:
    flight = simulate_flight(aircraft, maneuver(12.0, ("elevator", "3-2-1-1", 1.0, 0.3, 0.1)), 3, name="f")
    (trace,) = stoop.fit(aircraft, flight, ["0:12"], options=Options(method=method)).traces
    errors = np.array([(one.measured - one.simulated) / one.deviation for one in trace.channels.values()])
    assert np.mean(np.abs(errors[np.isfinite(errors)]) < 1.96) == pytest.approx(0.95, abs=0.03)


def contaminated(seed: int, share: float, width: float) -> FloatArray:
    rng = np.random.default_rng(seed)
    return rng.standard_normal(3000) * np.where(rng.random(3000) < share, width, 1.0)


def negative_log_likelihood(x: FloatArray, r: FloatArray) -> float:
    sigma, share, wide = np.exp(x[0]), 1.0 / (1.0 + np.exp(-x[1])), np.exp(x[2])
    return -float(np.sum(np.log((1 - share) * norm.pdf(r, 0, sigma) + share * norm.pdf(r, 0, wide))))


@pytest.mark.parametrize(("share", "width"), [(0.02, 10.0), (0.003, 80.0), (0.2, 4.0)])
def test_em_finds_what_direct_maximization_finds(share: float, width: float) -> None:
    r = 0.3 * contaminated(0, share, width)
    found, start = model.fit_mixture(r), [np.log(0.3), np.log(share / (1 - share)), np.log(0.3 * width)]
    fine = {"xatol": 1e-8, "fatol": 1e-8}
    best = minimize(negative_log_likelihood, start, (r,), "Nelder-Mead", options=fine)
    assert -float(np.sum(found.log_density(r))) == pytest.approx(best.fun, abs=0.05)
    assert found.sigma == pytest.approx(np.exp(best.x[0]), rel=5e-3)
    assert found.width * found.sigma == pytest.approx(np.exp(best.x[2]), rel=0.02)


def test_weights_and_slopes_are_derivatives_of_the_likelihood() -> None:
    mixture, r, h = model.Mixture(0.5, 0.1, 6.0), np.linspace(-5.0, 5.0, 101), 1e-5
    score = -0.25 * (mixture.log_density(r + h) - mixture.log_density(r - h)) / (2 * h)
    w, slopes = mixture.weights(r)
    np.testing.assert_allclose(w * r, score, atol=1e-8)
    ahead, behind = (mixture.weights(r + d)[0] * (r + d) for d in (h, -h))
    np.testing.assert_allclose(slopes, (ahead - behind) / (2 * h), atol=1e-6)
    assert np.isnan(mixture.weights(np.array([np.nan]))[0])


def test_outliers_are_found_and_nothing_else_is_called_so() -> None:
    for share, width in ((0.02, 10.0), (0.003, 80.0)):
        for seed in range(20):
            r = contaminated(seed, share, width)[:, None]
            found = model.outlier_model([r[:1000], r[1000:]], DT, 1.0)
            assert found is not None
            assert found[0].share == pytest.approx(share, rel=0.8)
            assert found[0].width == pytest.approx(width, rel=0.6)
    for seed in range(200):
        assert model.outlier_model([np.random.default_rng(seed).standard_normal((3000, 1))], DT, 1.0) is None
    # bursts, four times as large for half a second of every five: as likely a wrong model in the maneuvers
    rng = np.random.default_rng(2)
    smooth = np.convolve(rng.standard_normal(3100), np.ones(100) / 10.0, "valid")[:3000]
    burst = np.where(np.arange(3000) % 250 < 25, 4.0, 1.0)
    assert model.outlier_model([(smooth * burst)[:, None]], DT, 60.0) is None


def test_shrinkage_keeps_what_is_known_and_draws_what_is_not() -> None:
    draw = np.random.default_rng(3)
    groups = [s * draw.standard_normal(n) for s, n in ((1.0, 40), (1.3, 60), (0.9, 25))]
    degrees = np.array([len(g) - 1.0 for g in groups])
    p = model.homogeneous(np.array([np.var(g, ddof=1) for g in groups]), degrees)
    assert p == pytest.approx(bartlett(*groups).pvalue, rel=1e-9)
    variances = np.array([1.0, 1.1, 16.0, 30.0])
    found = model.shrunk(variances, np.array([700.0, 700.0, 700.0, 10.0]))
    np.testing.assert_allclose(found[:3], variances[:3], rtol=0.02)
    assert 10.0 < found[3] < 30.0
    alike = model.shrunk(np.random.default_rng(4).chisquare(20.0, 50) / 20.0, np.full(50, 20.0))
    assert np.std(alike) < 0.1
    np.testing.assert_allclose(np.mean(alike), 1.0, atol=0.1)


def test_a_noisy_maneuver_is_found_and_equal_ones_are_left() -> None:
    rng, plain, labels = np.random.default_rng(5), model.NoiseModel.plain(2, 4), np.arange(4)
    pieces = [rng.standard_normal((700, 2)) for _ in labels]
    relative, unequal, _ = model.maneuver_noise(pieces, labels, DT, plain)
    assert unequal == (False, False)
    np.testing.assert_array_equal(relative, 1.0)
    pieces[3][:, 1] *= 4.0
    pieces[2] = pieces[2][:3]
    relative, unequal, unknown = model.maneuver_noise(pieces, labels, DT, plain)
    assert unequal == (False, True)
    assert relative[3, 1] / relative[0, 1] == pytest.approx(4.0, rel=0.15)
    assert (np.argwhere(unknown).tolist(), relative[2, 1]) == ([[2, 1]], 1.0)


def test_of_neighboring_innovations_the_first_is_the_outlier() -> None:
    v = np.random.default_rng(6).standard_normal((800, 3))
    v[100, 0], v[101:105, 1] = 60.0, 15.0
    v[400, 2] = -50.0
    (mask,) = model.outlying_innovations([v], DT)
    assert (mask[100, 0], mask[400, 2], mask[101:105].any()) == (True, True, False)
    assert mask.sum() < 5


def test_weights_of_a_noisier_piece_are_those_of_its_covariance() -> None:
    root = np.random.default_rng(7).standard_normal((3, 3))
    covariance, factors = root @ root.T + np.eye(3), np.array([1.0, 4.0, 0.5])
    scaled = Weights.of(covariance).scaled(factors)
    assert scaled.covariance == pytest.approx(covariance * np.outer(factors, factors))
    assert scaled.root.T @ scaled.root == pytest.approx(np.linalg.inv(scaled.covariance))


def test_outliers_hardly_move_a_fit(aircraft: Vehicle, wrong: Vehicle, flight: Flight) -> None:
    windows, rng = [Window("sim", 0.0, 30.0)], np.random.default_rng(8)
    clean = fit(wrong, {"sim": flight}, windows, Options())
    assert not any(n.code in ("outliers", "maneuver-noise") for n in clean.notices)
    readings = {}
    for channel in aircraft.outputs:
        x, sigma = flight.data[channel].to_numpy().copy(), getattr(aircraft.file.sensors, channel).sigma
        at = rng.random(x.size) < 0.01
        x[at] += 40.0 * sigma * rng.choice([-1.0, 1.0], int(at.sum()))
        readings[channel] = (flight.data[channel].dims, x)
    found = fit(wrong, {"sim": replace(flight, data=flight.data.assign(readings))}, windows, Options())
    (said,) = [n for n in found.notices if n.code == "outliers"]
    assert set(said.values["channels"]) == set(aircraft.outputs)  # type: ignore[arg-type]
    rows = clean.evidence.pieces[0].rows()[1]
    for name, error in zip(clean.estimates, np.sqrt(np.diag(np.linalg.inv(rows.T @ rows))), strict=False):
        assert found.estimates[name] == pytest.approx(clean.estimates[name], abs=1.5 * error)
    recorded, shown = np.column_stack([x for _, x in readings.values()]), found.prepared.pieces[0].measured
    np.testing.assert_array_equal(shown[:100], recorded[:100])


def test_correlation_times() -> None:
    """Of white noise 1, holes or not; of an autoregression 1 + 2 sum a^k = (1 + a) / (1 - a)."""
    white = np.random.default_rng(0).standard_normal((4000, 3))
    white[::7, 2] = np.nan
    assert correlation_times([white[:2000], white[2000:]], 0.01) == pytest.approx(1.0, abs=0.15)
    for a in (0.5, 0.9):
        x = lfilter([1.0], [1.0, -a], np.random.default_rng(1).standard_normal((60_000, 1)), axis=0)
        assert correlation_times([x], 0.01)[0] == pytest.approx((1 + a) / (1 - a), rel=0.2)
