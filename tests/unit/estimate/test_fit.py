from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import stoop
from stoop import optimize
from stoop.errors import FlightError, IdentificationError, VehicleError
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options, estimation_problem, fit, refine, settle, starts
from stoop.estimate.noise import channel_residuals, noise_variance
from stoop.estimate.regression import start_value
from stoop.flight import Flight
from stoop.prediction.initial_state import Predictor
from stoop.prediction.predict import expected_biases, predict
from stoop.problem import Misfit
from stoop.problem.observation import along_body, first_complete, guess_start, imu_axes
from stoop.problem.windows import Window
from stoop.results.result import Covariance, NoiseCovariance
from stoop.simulation import START_NAMES
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.demo import MANEUVER, TABLE_1
from stoop_studies.optimizers.compositions import ps_gde
from stoop_studies.optimizers.mutation import distinct

WINDOW = [Window("sim", 0.0, 30.0)]


def test_start_is_guessed_from_the_first_measurements(aircraft: Vehicle) -> None:
    t = np.arange(50) / 100.0
    readings = {c: np.zeros(50) for c in ("V", "alpha", "q", "theta")}
    readings["V"] = 30.0 + 2.0 * t
    readings["theta"] = np.full(50, np.nan)
    start, missing = guess_start(aircraft, t, readings, "here")
    assert start["V"] == pytest.approx(30.0)
    assert start["theta"] == 0.0
    assert missing == ["theta"]


def test_start_undoes_scale_bias_and_vane_position(aircraft: Vehicle) -> None:
    text = (
        aircraft.text
        + """
[sensors]
V = { scale = 0.8, bias = 1.0 }
vane_position = [2.0, 0.0, 0.0]
"""
    )
    vehicle = parse_vehicle(text, "scaled.toml")
    t = np.arange(30) / 100.0
    readings = {c: np.zeros(30) for c in START_NAMES[:-1]}
    readings["V"] = np.full(30, 0.8 * 35.0 + 1.0)
    readings["q"] = np.full(30, 0.5)
    readings["alpha"] = np.full(30, 0.1 - 2.0 * 0.5 / 35.0)
    start, _ = guess_start(vehicle, t, readings, "here")
    assert start["V"] == pytest.approx(35.0)
    assert start["alpha"] == pytest.approx(0.1)


def test_start_undoes_the_alignment_of_the_inertial_unit(aircraft: Vehicle) -> None:
    vehicle = parse_vehicle(aircraft.text + "\n[sensors]\nimu_alignment = [0.0, 0.0, 0.3]\n", "turned.toml")
    t = np.arange(30) / 100.0
    readings = {c: np.zeros(30) for c in START_NAMES[:-1]}
    readings |= {
        "V": np.full(30, 35.0),
        "p": np.full(30, 0.5 * np.cos(0.3)),
        "q": np.full(30, -0.5 * np.sin(0.3)),
    }
    start, _ = guess_start(vehicle, t, readings, "here")
    assert start["p"] == pytest.approx(0.5)
    assert start["q"] == pytest.approx(0.0, abs=1e-12)


def test_components_that_a_reduced_model_holds_are_zero_along_the_body(aircraft: Vehicle) -> None:
    text = aircraft.text + "\n[sensors]\nimu_alignment = [0.1, -0.2, 0.3]\n"
    vehicle = parse_vehicle(text, "turned.toml")
    pitching = imu_axes(vehicle, vehicle.values) @ [0.0, 0.7, 0.0]
    assert along_body(vehicle, {"q": pitching[1]})["q"] == pytest.approx(0.7)
    turning = np.random.default_rng(1).standard_normal((3, 5))
    read = dict(zip(("ax", "ay", "az"), imu_axes(vehicle, vehicle.values) @ turning, strict=True))
    np.testing.assert_allclose(list(along_body(vehicle, read).values()), turning, atol=1e-12)


def test_a_piece_begins_where_its_state_was_measured() -> None:
    readings = {"V": np.array([np.nan, 1, 1, 1]), "q": np.array([1, 1, np.nan, 1.0]), "r": np.full(4, np.nan)}
    assert first_complete(readings) == 1
    assert first_complete({"r": np.full(4, np.nan)}) == 0


def test_lateral_model_flies_at_the_measured_speed() -> None:
    """Truth flown 20 % faster than V*: the held speed must be the measured one, or all derivatives scale."""
    full = resolve_vehicle("twin-boom")
    text = """
duration = 16.0
rate = 50.0
airspeed = 42.0
[[input]]
control = "aileron"
shape = "doublet"
start = 1.0
step = 0.6
amplitude = 0.04
[[input]]
control = "rudder"
shape = "doublet"
start = 6.0
step = 0.8
amplitude = 0.05
[noise]
"""
    flight = simulate_flight(full, parse_maneuver(text, "lateral"), seed=1, name="sim")
    lateral = full.reduced("lateral")
    drag = [p.name for p in lateral.parameters if p.free and p.name[:2] in ("CD", "CL", "Cm")]
    held = lateral.with_numbers({n: {"free": False} for n in drag})
    found = fit(held, {"sim": flight}, [Window("sim", 0.0, 16.0)], Options()).estimates
    for name in ("Claileron", "Clp", "Cnbeta", "Cnrudder"):
        assert found[name] == pytest.approx(full.value(name), rel=0.12), name
    blind = replace(flight, data=flight.data.drop_vars("V"))
    with pytest.raises(FlightError, match="'V' was not recorded"):
        fit(held, {"sim": blind}, [Window("sim", 0.0, 16.0)])


def test_without_a_vane_there_is_no_equation_error_but_a_fit(wrong: Vehicle, flight: Flight) -> None:
    blind = replace(flight, data=flight.data.drop_vars("alpha"))
    problem, _ = estimation_problem(wrong, {"sim": blind}, WINDOW, Options())
    assert start_value(problem.layout, problem.pieces) is None
    found = fit(wrong, {"sim": blind}, WINDOW, Options())
    assert found.estimates["Cmalpha"] == pytest.approx(-2.12, rel=0.2)


def test_a_stuck_channel_counts_as_not_measured(aircraft: Vehicle, wrong: Vehicle, flight: Flight) -> None:
    data = flight.data.copy()
    data["theta"] = data["theta"] * 0.0 + 0.01
    found = fit(wrong, {"sim": replace(flight, data=data)}, WINDOW, Options())
    assert ("stuck-channel", "theta") in [(n.code, n.subject) for n in found.prepared.notices]
    assert found.estimates["Cmalpha"] == pytest.approx(aircraft.value("Cmalpha"), rel=0.1)


def test_budget_holds_for_the_refinement_too(wrong: Vehicle, flight: Flight) -> None:
    """Settling the weights (some 100 trajectories here) is counted, but not cut: a resumed search needs them."""
    problem, _ = estimation_problem(wrong, {"sim": flight}, WINDOW, Options())
    settling = settle(problem, starts(problem)).spent
    for budget in (settling + 20.0, settling + 60.0):
        found = fit(wrong, {"sim": flight}, WINDOW, Options(budget=budget))
        assert found.trajectories <= budget + 4.0
        assert found.notices or found.outcome.status != "converged"


def test_optimizers_that_plan_ahead_are_told_the_budget(
    wrong: Vehicle, flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    create, told = optimize.create, []

    def watched(name: str, budget: float | None = None) -> optimize.Optimizer[Any]:
        made = create(name, budget)
        told.append(made.budget)
        return made

    monkeypatch.setattr(optimize, "create", watched)
    found = fit(wrong, {"sim": flight}, WINDOW, Options(optimizer="l-shade", budget=400.0))
    (planned,) = told
    assert planned < 400.0
    assert planned == pytest.approx(found.outcome.trajectories, abs=1.0)


def test_weights_do_not_depend_on_the_budget(wrong: Vehicle, flight: Flight) -> None:
    states: list[optimize.State] = []
    fit(wrong, {"sim": flight}, WINDOW, Options(budget=150.0), lambda p: states.append(p.state))
    few, many = states[0], fit(wrong, {"sim": flight}, WINDOW, Options(), state=states[0])
    assert many.outcome.cost <= few.evaluations.cost
    assert np.array_equal(many.z, fit(wrong, {"sim": flight}, WINDOW, Options()).z)


def test_ctrl_c_before_the_search_keeps_the_first_dive(
    wrong: Vehicle, flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    residuals = Misfit.residuals

    def interrupt(self: Misfit, Z: np.ndarray, rung: int) -> np.ndarray:
        calls.append(len(Z))
        if len(calls) == 6:
            raise KeyboardInterrupt
        return residuals(self, Z, rung)

    monkeypatch.setattr(Misfit, "residuals", interrupt)
    found = fit(wrong, {"sim": flight}, WINDOW, Options())
    assert found.outcome.status == "interrupted"
    assert found.outcome.state is None
    assert np.isfinite(found.cost)


def test_a_piece_whose_state_comes_too_late_is_refused(wrong: Vehicle, flight: Flight) -> None:
    data = flight.data.copy(deep=True)
    data["V"][:-1] = np.nan
    with pytest.raises(FlightError, match="whole state"):
        fit(wrong, {"sim": replace(flight, data=data)}, WINDOW, Options())


def model_of(found: Estimate) -> Predictor:
    """Return the fitted model, its parameters taken as known."""
    layout = found.problem.layout
    noise = NoiseCovariance(layout.vehicle.outputs, found.problem.weights.covariance)
    return Predictor(found.identified_vehicle, Covariance((), np.empty((0, 0))), noise)


def test_biases_for_a_prediction_come_from_the_same_flight(aircraft: Vehicle, wrong: Vehicle) -> None:
    maneuver = parse_maneuver(MANEUVER, "test")
    flights = {}
    for name, bias in (("a", 0.03), ("b", -0.03)):
        biased = aircraft.with_numbers({"sensors.q.bias": {"value": bias}})
        flights[name] = simulate_flight(biased, maneuver, 1, name=name)
    found = fit(wrong, flights, [Window("a", 0.0, 20.0), Window("b", 0.0, 20.0)], Options())
    assert expected_biases(found, "a")["sensors.q.bias"].mean == pytest.approx(0.03, abs=0.003)
    assert expected_biases(found, "b")["sensors.q.bias"].mean == pytest.approx(-0.03, abs=0.003)
    ahead = predict(model_of(found), flights, [Window("b", 20.0, 28.0)], [expected_biases(found, "b")])
    error = ahead.prepared.pieces[0].measured[:, 2] - ahead.readings[0][:, 2]
    assert np.sqrt(np.mean(error**2)) < 0.02


def test_equation_error_is_exact_without_noise(aircraft: Vehicle, wrong: Vehicle, flight: Flight) -> None:
    """On noise-free states and accelerations only the derivative of q is approximated."""
    clean = simulate_flight(aircraft, parse_maneuver(MANEUVER, "test"), noise=False, name="sim")
    problem, _ = estimation_problem(wrong, {"sim": clean}, WINDOW, Options())
    guess = start_value(problem.layout, problem.pieces)
    assert guess is not None
    found = dict(
        zip([p.name for p in problem.layout.parameters], problem.layout.physical(guess[None])[0], strict=True)
    )
    for name in ("CL0", "CLalpha", "CD0", "CDalpha"):
        assert found[name] == pytest.approx(aircraft.value(name), rel=1e-3)
    assert found["Cmalpha"] == pytest.approx(aircraft.value("Cmalpha"), rel=0.1)


def test_recovers_the_truth_and_the_noise(aircraft: Vehicle, wrong: Vehicle, flight: Flight) -> None:
    found = fit(wrong, {"sim": flight}, WINDOW, Options(seed=1))
    assert found.outcome.status == "converged"
    for name in TABLE_1:
        assert found.estimates[name] == pytest.approx(aircraft.value(name), rel=0.15)
    sigma = np.array([getattr(aircraft.file.sensors, c).sigma for c in aircraft.outputs])
    assert np.sqrt(noise_variance(found.problem, channel_residuals(found.problem, found.z))) == pytest.approx(
        sigma, rel=0.1
    )


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


def test_same_seed_same_bits_whatever_the_threads(
    wrong: Vehicle, flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(threads: str) -> np.ndarray:
        monkeypatch.setenv("STOOP_THREADS", threads)
        return fit(wrong, {"sim": flight}, WINDOW, Options(seed=5)).z

    first = run("1")
    assert np.array_equal(first, run("2"))
    assert np.array_equal(first, run("3"))


def test_optimizers_of_every_kind_reach_the_same_place(wrong: Vehicle, flight: Flight) -> None:
    best = fit(wrong, {"sim": flight}, WINDOW, Options()).estimates
    for name in ("ps-gde", "pso", "ordered-shade", "scipy-least-squares"):  # one of each kind
        found = fit(wrong, {"sim": flight}, WINDOW, Options(optimizer=name, budget=3000.0)).estimates
        for key, value in best.items():
            assert found[key] == pytest.approx(value, rel=2e-3, abs=1e-4), (name, key)


def current_to_elite(X: np.ndarray, F: np.ndarray, scale: Any, generator: np.random.Generator) -> np.ndarray:
    """Return the mutation of docs/optimizers.md."""
    elite = X[F.argsort()[generator.integers(0, 5, len(X))]]
    a, b = X[distinct(len(X), 2, generator)]
    return np.asarray(X + scale * generator.uniform(0.7, 1.6, (len(X), 1)) * (elite - X + a - b))


def test_an_optimizer_of_ones_own_in_a_fit(wrong: Vehicle, flight: Flight) -> None:
    """An object does what its name does, and a mutation of one's own arrives where the default does."""
    named, given = (
        stoop.fit(wrong, flight, ["0:30"], options=Options(optimizer=one, budget=1000.0))
        for one in ("ps-gde", ps_gde())
    )
    assert given.result.optimizer == "ps-gde"
    assert np.array_equal(named.estimate.z, given.estimate.z)
    best = fit(wrong, {"sim": flight}, WINDOW, Options()).estimates
    own = ps_gde(mutation=current_to_elite)
    found = fit(wrong, {"sim": flight}, WINDOW, Options(optimizer=own, budget=3000.0)).estimates
    for key, value in best.items():
        assert found[key] == pytest.approx(value, rel=2e-3, abs=1e-4), key


def test_a_bare_mutation_is_no_optimizer() -> None:
    with pytest.raises(IdentificationError, match=r"neither a name .*ps_gde\(mutation=...\)"):
        Options(optimizer=current_to_elite)  # type: ignore[arg-type]


def test_interrupted_search_keeps_its_best(wrong: Vehicle, flight: Flight) -> None:
    def interrupt(progress: optimize.Progress) -> None:
        raise KeyboardInterrupt

    found = fit(wrong, {"sim": flight}, WINDOW, Options(), interrupt)
    assert found.outcome.status == "interrupted"
    assert np.isfinite(found.cost)


def test_interrupted_refinement_keeps_the_search(
    wrong: Vehicle, flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    found = fit(wrong, {"sim": flight}, WINDOW, Options())
    monkeypatch.setattr("stoop.optimize.refine", interrupt)
    again = refine(found.problem, found.prepared, found.outcome, estimate_noise=True)
    assert again.outcome.status == "interrupted"
    assert np.array_equal(again.z, found.outcome.z)


def test_resumed_search_ends_where_an_undisturbed_one_does(wrong: Vehicle, flight: Flight) -> None:
    states: list[optimize.State] = []
    whole = fit(wrong, {"sim": flight}, WINDOW, Options(), lambda p: states.append(p.state))
    resumed = fit(wrong, {"sim": flight}, WINDOW, Options(), state=states[0])
    assert np.array_equal(whole.z, resumed.z)


def test_given_covariance_is_kept(wrong: Vehicle, flight: Flight) -> None:
    given = np.diag([0.09, 1e-4, 1e-4, 1e-4, 0.01, 0.01])
    given[0, 4] = given[4, 0] = 0.01
    found = fit(wrong, {"sim": flight}, WINDOW, Options(covariance=given))
    assert np.allclose(found.problem.weights.covariance, given)


def test_nothing_free_is_an_error(aircraft: Vehicle, flight: Flight) -> None:
    held = aircraft.with_numbers({p.name: {"free": False} for p in aircraft.parameters})
    with pytest.raises(IdentificationError, match="--free"):
        fit(held, {"sim": flight}, WINDOW)


def test_unknown_loading_is_an_error(wrong: Vehicle, flight: Flight) -> None:
    with pytest.raises(VehicleError, match="loading"):
        fit(wrong, {"sim": flight}, [Window("sim", 0.0, 30.0, "heavy")])


def test_loading_changes_the_mass_of_one_maneuver(aircraft: Vehicle, wrong: Vehicle) -> None:
    """Two flights of different mass, fitted jointly with the masses told, give one set of coefficients."""
    maneuver = parse_maneuver(MANEUVER, "test")
    heavy = aircraft.with_numbers({"mass.mass": {"value": 210.0}})
    flights = {
        "light": simulate_flight(aircraft, maneuver, 1, name="light"),
        "heavy": simulate_flight(heavy, maneuver, 2, name="heavy"),
    }
    loaded = replace(wrong, file=wrong.file.model_copy(update={"loadings": {"full": {"mass.mass": 210.0}}}))
    windows = [Window("light", 0.0, 30.0), Window("heavy", 0.0, 30.0, "full")]
    found = fit(loaded, flights, windows, Options())
    assert found.estimates["CLalpha"] == pytest.approx(4.78, rel=0.02)
    wrongly = fit(loaded, flights, [windows[0], Window("heavy", 0.0, 30.0)], Options())
    noise = [np.linalg.slogdet(one.measurement_noise)[1] for one in (wrongly, found)]
    assert noise[0] > noise[1] + 1.0


def test_prediction_starts_near_the_measurements_and_fits_no_parameter(
    wrong: Vehicle, flight: Flight
) -> None:
    found = fit(wrong, {"sim": flight}, [Window("sim", 0.0, 15.0)], Options())
    ahead = predict(
        model_of(found), {"sim": flight}, [Window("sim", 15.0, 25.0)], [expected_biases(found, "sim")]
    )
    piece = ahead.prepared.pieces[0]
    assert ahead.readings[0][0, 0] == pytest.approx(piece.measured[:10, 0].mean(), abs=0.5)
    error = piece.measured - ahead.readings[0]
    assert np.std(error[:, 1]) < 0.03


def test_starts_include_the_files_own_values(wrong: Vehicle, flight: Flight) -> None:
    problem, _ = estimation_problem(wrong, {"sim": flight}, WINDOW, Options())
    own = starts(problem)[0]
    assert problem.layout.physical(own[None])[0] == pytest.approx(
        [p.value for p in problem.layout.parameters]
    )


def test_windows_that_would_fill_the_memory_are_refused(
    wrong: Vehicle, flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stoop.estimate.fit.MAX_BYTES", 1e5)
    with pytest.raises(IdentificationError, match="unit of the log's time"):
        fit(wrong, {"sim": flight}, WINDOW, Options())
