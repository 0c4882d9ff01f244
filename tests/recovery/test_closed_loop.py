"""Aircraft that only an autopilot holds, and gusts: which estimator is chosen, and how far others are off."""

from dataclasses import replace

import numpy as np
import pytest
from core.estimate.test_decoupling import OBSERVED
from helpers.fits import deviations
from helpers.fits import fit_by as by_name

from stoop import Options, Vehicle, simulate_flight, trim
from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.extensions import extension_tests
from stoop.base.units import KNOT
from stoop.estimate import filter_error
from stoop.estimate.estimate import Estimate
from stoop.estimate.gusts import MIN_BIAS, exceed_sensors, gust_biases, gust_levels
from stoop.estimate.instability import PREDICTED_GROWTH, growth, growth_at_start
from stoop.flight import load_flight
from stoop.flight.flight import from_columns
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.results.extensions import ExtensionTests
from stoop.simulation.linearize import linear_models
from stoop.strategy.run import choose_method
from stoop.strategy.run import fit as fit_by
from stoop.vehicle import parse_vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import extended
from stoop_plan.flight_logs import save_flight_as
from stoop_plan.input_design.quick_fit import FIT_ALONE
from stoop_studies.verify import closed_loop, feedback, scenes
from stoop_studies.verify.defects import fixed_wing, wing_maneuvers
from stoop_studies.verify.scenes import ALTITUDE, Scene

WINDOW = (Window("pitch", 0.0, 10.0),)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Pitch maneuver of the aircraft with Cmalpha > 0, a longitudinal model to fit."""
    flown = closed_loop.aircraft_scene(0.0, 3, unstable="pitch")
    return replace(flown, start=flown.start.reduced("longitudinal"))


@pytest.fixture(scope="module")
def found(scene: Scene) -> tuple[str, Estimate]:
    choice = choose_method("", scene.start, scene.flights.values(), WINDOW)
    assert [n.code for n in choice.notices] == ["unstable"]
    done = fit_by(FIT_ALONE, scene.start, scene.flights, WINDOW)
    return done.setup.options.method, done.estimate


def test_growth_is_that_of_the_exact_linear_model(scene: Scene) -> None:
    """Eigenvalues of one sample, by differences at the mean measured state, against the exact Jacobian at trim."""
    known = {n: {"value": v} for n, v in scene.truth.items() if n in scene.start.rows}
    true = scene.start.with_numbers(known)
    A = linear_models(true, trim(true, None, ALTITUDE).lanes(true))[1][0]
    piece = Prepared.of(true, scene.flights, WINDOW).pieces[0]
    at = growth(true, piece, true.parameter_rows(piece.changes))
    assert at.rate == pytest.approx(float(np.linalg.eigvals(A).real.max()), rel=0.1)
    assert at.factor == pytest.approx(np.exp(10.0 * at.rate), rel=0.05)
    assert np.exp(at.rate * at.horizon) == pytest.approx(PREDICTED_GROWTH)


def test_the_default_finds_the_truth(scene: Scene, found: tuple[str, Estimate]) -> None:
    method, fit = found
    assert (method, fit.outcome.status) == ("stabilized-output-error", "converged")
    off = deviations(fit, {n: true for n, true in scene.truth.items() if n in fit.estimates})
    assert np.abs(off).max() < 4.0
    assert np.sqrt(np.mean(off**2)) < 1.6
    assert fit.estimates["Cmalpha"] == pytest.approx(scene.truth["Cmalpha"], rel=0.15)


def test_curves_are_predictions_near_the_record(found: tuple[str, Estimate]) -> None:
    _, fit = found
    assert [n.code for n in fit.notices if n.code.startswith("filter")] == ["filter-predicts"]
    piece, read, white = fit.problem.pieces[0], fit.readings[0], fit.evidence.pieces[0].residual
    assert np.isfinite(read).all()
    left = np.nanstd(piece.measured - read, axis=0)
    np.testing.assert_allclose(left, np.sqrt(np.diag(fit.measurement_noise)), rtol=0.25)
    assert np.nanstd(white) == pytest.approx(1.0, abs=0.1)


def test_who_names_output_error_is_warned(scene: Scene) -> None:
    named = choose_method("output-error", scene.start, scene.flights.values(), WINDOW)
    assert named.options.method == "output-error"
    assert [(n.code, n.severity) for n in named.notices] == [("unstable-open-loop", "warning")]
    other = choose_method("multiple-shooting", scene.start, scene.flights.values(), WINDOW)
    assert (other.options.method, other.notices) == ("multiple-shooting", ())
    fit = by_name("output-error", scene.start, scene.flights, WINDOW, budget=3000)
    assert fit.outcome.status != "converged"


def test_a_short_window_or_a_stable_aircraft_is_simulated(scene: Scene) -> None:
    """Over three seconds an error grows by less than a hundred."""
    assert growth_at_start(scene.start, scene.flights, WINDOW).excessive
    short = (Window("pitch", 1.0, 4.0),)
    assert choose_method("", scene.start, scene.flights.values(), short).options.method == "output-error"
    calm = closed_loop.aircraft_scene(0.0, 3)
    assert choose_method("", calm.start, calm.flights.values(), calm.windows).options.method == "output-error"


def test_large_biases_are_told_with_sign_and_size() -> None:
    """All errors beyond four standard errors of filter error: told with their sign, and within a factor of two."""
    scene = closed_loop.aircraft_scene(30.0 * KNOT, 2)
    choice = choose_method("output-error", scene.start, scene.flights.values(), scene.windows)
    assert [n.code for n in choice.notices] == ["gusts-ignored"]
    options = Options(method="output-error")
    fit = fit_by(FIT_ALONE, scene.start, scene.flights, scene.windows, options=options).estimate
    (told,) = [n for n in fit.notices if n.code == "gusts-bias"]
    found = gust_biases(fit, scene.flights)
    assert told.values["count"] == sum(abs(size) > MIN_BIAS for _, size in found.values())
    errors = {n: fit.estimates[n] - v for n, v in scene.truth.items()}
    error_bar = {n: bias / size for n, (bias, size) in found.items()}
    large = [n for n in errors if abs(errors[n]) > 4.0 * error_bar[n]]
    ratio = np.array([found[n][0] / errors[n] for n in large])
    assert len(large) > 3
    assert np.all((ratio > 0.5) & (ratio < 2.0))


def test_a_lateral_model_in_gusts_under_an_autopilot() -> None:
    """Filter error, which the gusts call for, with the vertical and axial gusts in the measured V and alpha."""
    scene = closed_loop.aircraft_scene(30.0 * KNOT, 3)
    done = fit_by(FIT_ALONE, scene.start.reduced("lateral"), scene.flights, scene.windows)
    found, truth = done.estimate, {n: scene.truth[n] for n in OBSERVED}
    assert done.setup.options.method == "filter-error"
    assert np.all(np.abs(deviations(found, truth)) < 3.0)
    assert max(abs(found.estimates[n] / truth[n] - 1.0) for n in ("Clbeta", "Clp", "Claileron")) < 0.03


TEN = (Window("sim", 0.0, 10.0),)


@pytest.fixture(scope="module")
def shaken():
    """Flights whose controls all move, in calm air and in light turbulence; three seeds."""
    vehicle = parse_vehicle(fixed_wing(), "all moved")
    light, out = scenes.in_turbulence(vehicle, 15.0 * KNOT), {}
    for seed in range(3):
        (maneuver, *_) = wing_maneuvers(np.random.default_rng(seed)).values()
        for name, truth in (("calm", vehicle), ("light", light)):
            out[name, seed] = {"sim": simulate_flight(truth, maneuver, seed=seed, name="sim")}
    return vehicle, out


def test_scale_errors_of_sensors_are_no_gusts(shaken):
    """Omega x v_air enters the kinematics, so that 8 % of a gyro would look like gusts of 0.5 to 0.7 noise deviations."""
    vehicle, flights = shaken
    for (air, seed), flown in flights.items():
        data = flown["sim"].data
        for channel in ("p", "q", "r", "V", "alpha", "beta") if air == "calm" else ():
            off = {"sim": replace(flown["sim"], data=data.assign({channel: 1.08 * data[channel]}))}
            assert not exceed_sensors(vehicle, gust_levels(vehicle, off, TEN)), (channel, seed)
        if air == "light":
            assert exceed_sensors(vehicle, 0.7 * gust_levels(vehicle, flown, TEN))


@pytest.mark.parametrize(("angle", "axis"), [("alpha", 2), ("beta", 1)])
def test_a_missing_vane_hides_its_own_axis_only(shaken, angle, axis):
    vehicle, flights = shaken
    for (air, _), flown in flights.items():
        blind = replace(flown["sim"], data=flown["sim"].data.drop_vars(angle))
        found, whole = (gust_levels(vehicle, {"sim": f}, TEN) for f in (blind, flown["sim"]))
        assert np.flatnonzero(np.isnan(found)).tolist() == [axis]
        assert exceed_sensors(vehicle, found) == (air == "light"), (air, found)
        assert np.delete(found, axis) == pytest.approx(np.delete(whole, axis), abs=0.2)


def test_noise_that_a_grid_spreads_over_neighbors_is_no_gust(shaken, tmp_path):
    """A table of 50 Hz on a grid of 100 Hz: neighbors share readings, which looked like gusts of 0.6 noise deviations."""
    vehicle, flights = shaken
    for (air, seed), flown in flights.items():
        flight, path = flown["sim"], tmp_path / f"{air}{seed}.csv"
        kept = slice(None, None, round(flight.rate / 50.0))
        slow = from_columns("slow", flight.time[kept], {n: flight.column(n)[kept] for n in flight.names}, {})
        save_flight_as(slow, path)
        read = load_flight(path, rate=100.0)
        levels = gust_levels(vehicle, {"sim": read}, (Window("sim", read.time[0], read.time[0] + 10.0),))
        assert np.isfinite(levels).all()
        assert exceed_sensors(vehicle, levels) == (air == "light")


def test_severe_gusts_are_filtered_though_the_fit_in_calm_air_leads_astray():
    scene = feedback.CASES["aircraft-severe"].fly(3012)
    done = fit_by(FIT_ALONE, scene.start, scene.flights, scene.windows, options=Options(seed=12))
    assert done.setup.options.method == "filter-error"
    layout, found = done.estimate.problem.layout, done.estimate.estimates
    errors = dict(zip([p.name for p in layout.parameters], done.tested.bars.std, strict=False))
    assert np.mean([abs(found[n] - x) < 1.96 * errors[n] for n, x in scene.truth.items()]) > 0.8


def lacking_in_gusts(truth: Vehicle) -> ExtensionTests:
    rng, flown, names = np.random.default_rng(1), scenes.maneuvers(), ("pitch", "roll")
    flights = {n: simulate_flight(truth, flown[n], seed=int(rng.integers(2**31)), name=n) for n in names}
    windows = [Window(n, 0.0, scenes.DURATION) for n in names]
    done = filter_error.steady(scenes.turbulent_aircraft(), flights, windows, Options(seed=1))
    return extension_tests(done, ErrorBars.of(done))


def test_lag_is_named_in_gusts_and_a_right_aircraft_lacks_nothing() -> None:
    right = scenes.turbulent_aircraft()
    best = lacking_in_gusts(with_entries(right, {("controls", "aileron", "lag"): 0.04})).found[0]
    assert best.name in ("controls.aileron.lag", "controls.aileron.delay")
    assert (best.value, lacking_in_gusts(right).found) == (pytest.approx(0.04, rel=0.3), ())


def test_gusts_that_a_method_assumes_are_extended_with_the_vehicle() -> None:
    """The table is set after the file was read, as the method of gusty flights does."""
    vehicle = scenes.turbulent_aircraft()
    wider, _ = extended(vehicle)
    assert ("turbulence" in vehicle.text, wider.states) == (False, vehicle.states)
    assert set(vehicle.rows) <= set(wider.rows)
