"""Gusts against scenes of the studies: what is none, what is filtered, and what the model lacks beside them."""

from dataclasses import replace

import numpy as np
import pytest

from stoop import Options, Vehicle, simulate_flight
from stoop.assessment.error_bars import error_bars
from stoop.assessment.extensions import extension_tests
from stoop.base.units import KNOT
from stoop.estimate import filter_error
from stoop.estimate.gusts import exceed_sensors, gust_levels
from stoop.flight import load
from stoop.flight.flight import from_columns
from stoop.problem.windows import Window
from stoop.results.extensions import ExtensionTests
from stoop.strategy.run import FIT_ALONE, fit
from stoop.vehicle import parse_vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import extended
from stoop_plan.flight_logs import save_flight_as
from stoop_studies.verify import feedback, scenes
from stoop_studies.verify.defects import fixed_wing, wing_maneuvers

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
        read = load(path, rate=100.0)
        levels = gust_levels(vehicle, {"sim": read}, (Window("sim", read.time[0], read.time[0] + 10.0),))
        assert np.isfinite(levels).all()
        assert exceed_sensors(vehicle, levels) == (air == "light")


def test_severe_gusts_are_filtered_though_the_fit_in_calm_air_leads_astray():
    scene = feedback.CASES["aircraft-severe"].fly(3012)
    done = fit(FIT_ALONE, scene.start, scene.flights, scene.windows, options=Options(seed=12))
    assert done.setup.options.method == "filter-error"
    layout, found = done.estimate.problem.layout, done.estimate.estimates
    errors = dict(zip([p.name for p in layout.parameters], done.tested.bars.std, strict=False))
    assert np.mean([abs(found[n] - x) < 1.96 * errors[n] for n, x in scene.truth.items()]) > 0.8


def lacking_in_gusts(truth: Vehicle) -> ExtensionTests:
    rng, flown, names = np.random.default_rng(1), scenes.maneuvers(), ("pitch", "roll")
    flights = {n: simulate_flight(truth, flown[n], seed=int(rng.integers(2**31)), name=n) for n in names}
    windows = [Window(n, 0.0, scenes.DURATION) for n in names]
    done = filter_error.steady(scenes.turbulent_aircraft(), flights, windows, Options(seed=1))
    return extension_tests(done, error_bars(done))


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
