"""Default bounds are no knowledge, those of the file and physics are; a search is confirmed where it explains more in the end."""

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.flown import maneuver, with_few_free

from stoop.base.arrays import FloatArray
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.problem.prepare import Prepared
from stoop.problem.weights import Weights
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.strategy import Strategy
from stoop.strategy.bounds import widen
from stoop.strategy.decision import Fitted, Setup, estimate
from stoop.strategy.likelihood import against_start, log_likelihood_rise, rise_from_start
from stoop.strategy.run import fit, setup_of
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.defaults import wider_bounds
from stoop.workflow.demo import MANEUVER

INERTIA, WINDOWS = "mass.inertia.yy", [Window("flight", 0.0, 5.0)]
FIT_ALONE = Strategy.default().without("faults", "assumptions", "sensor-delays")
WHOLE = [Window("sim", 0.0, 20.0)]


@cache
def known() -> Vehicle:
    vehicle = with_few_free(builtin_vehicle("twin-boom").reduced("longitudinal"), ())
    return vehicle.with_numbers({INERTIA: {"free": True}})


@cache
def flight() -> Flight:
    pulse = ("elevator", "doublet", 0.5, 0.5, 0.05)
    return simulate_flight(known(), maneuver(5.0, pulse, altitude=200.0), name="flight")


def found(share: float, method: str = "output-error", **fields: object) -> Estimate:
    vehicle = known().with_numbers({INERTIA: {"value": share * known().value(INERTIA), **fields}})
    options = Options(budget=4000.0, method=method)
    return fit(FIT_ALONE, vehicle, {"flight": flight()}, WINDOWS, options=options).estimate


@pytest.mark.parametrize(
    ("share", "method"), [(0.35, "output-error"), (2.5, "filter-error"), (2.5, "multiple-shooting")]
)
def test_an_inertia_outside_of_the_default_box_is_found(share: float, method: str) -> None:
    fit = found(share, method)
    assert fit.estimates[INERTIA] == pytest.approx(known().value(INERTIA), rel=0.03)
    widened = [n for n in fit.notices if n.code == "bounds-widened"]
    assert [n.subject for n in widened] == [INERTIA]
    (p,) = fit.problem.layout.parameters
    assert (p.lower, p.upper) == pytest.approx((widened[0].values["low"], widened[0].values["high"]))
    assert not any(u.fixed for u in fit.unknowns)
    truth = known().value(INERTIA)
    if method == "output-error":  # bounds of the file stay
        held = found(0.5, bounds=(0.3 * truth, 0.7 * truth))
        assert held.estimates[INERTIA] == pytest.approx(0.7 * truth)
        assert not [n for n in held.notices if n.code == "bounds-widened"]


def test_what_was_found_stands_where_wider_bounds_end_worse() -> None:
    vehicle = known().with_numbers({INERTIA: {"value": 0.35 * known().value(INERTIA)}})
    setup = setup_of(Strategy.textbook(), vehicle, {"flight": flight()}, WINDOWS, options=Options())
    calls: list[Fitted] = []

    def fitter(setup: Setup) -> Fitted:
        one = estimate(setup)
        if calls:
            z = np.concatenate([one.estimate.problem.layout.start, one.estimate.z[1:]])
            one = replace(one, estimate=replace(one.estimate, z=z))
        calls.append(one)
        return one

    kept = widen(setup, fitter)
    assert (len(calls), kept.estimate.estimates) == (2, calls[0].estimate.estimates)
    assert kept.estimate.trajectories == sum(one.estimate.trajectories for one in calls)
    assert not [n for n in kept.estimate.notices if n.code == "bounds-widened"]


def test_boxes_double_beyond_the_bound_as_far_as_physics_allows() -> None:
    for name, value, box, bound, wider in (
        ("Cmq", -10.0, (-150.0, 0.0), 0.0, (-150.0, 150.0)), ("CLq", 5.0, (-20.0, 60.0), -20.0, (-100.0, 60.0)),
        (INERTIA, 1.0, (0.5, 1.5), 0.5, (0.1, 1.5)), ("CD0", 0.05, (0.0, 0.5), 0.0, (0.0, 0.5)),
        ("controls.elevator.lag", 0.05, (0.0, 0.2), 0.0, (0.0, 0.2)),
    ):  # fmt: skip
        assert wider_bounds(name, value, box, bound) == wider, name


def test_each_maneuver_of_unlike_noise_has_variances_of_its_own() -> None:
    """A quiet maneuver that is explained twice as well outweighs a noisy one, explained 2 % worse."""
    rng = np.random.default_rng(5)
    quiet, noisy = 0.01 * rng.standard_normal((500, 1)), rng.standard_normal((500, 1))

    def fit(residuals: list[np.ndarray], relative: tuple[float, ...]) -> Any:
        pieces = [SimpleNamespace(maneuver=i, relative_noise=relative) for i in range(2)]
        problem = SimpleNamespace(pieces=pieces, weights=Weights.of(np.ones(1)))
        outcome = SimpleNamespace(optimizer="gauss-newton")
        return SimpleNamespace(weighted_problem=problem, residuals=residuals, inflation=1.0, outcome=outcome)

    before, after = [quiet, noisy], [0.5 * quiet, 1.02 * noisy]
    assert log_likelihood_rise(fit(before, ()), fit(after, ()))[0] < 0.0, "one variance for both"
    rise, count = log_likelihood_rise(fit(before, (1.0,)), fit(after, (1.0,)))
    assert (rise, count) == (pytest.approx(500.0 * math.log(2.0 / 1.02)), 1000.0)


@pytest.fixture(scope="module")
def searched(wrong: Vehicle, flight: Flight) -> Estimate:
    return methods.find("output-error").fitter()(wrong, {"sim": flight}, WHOLE, Options())


def ended(searched: Estimate, x: FloatArray) -> Estimate:
    z = np.concatenate([x, searched.z[len(x) :]])
    return replace(searched, z=z, outcome=replace(searched.outcome, z=z))


def test_an_end_better_than_its_start_or_at_it_is_confirmed(searched: Estimate) -> None:
    assert rise_from_start(searched) > 50.0
    assert against_start(searched) is searched
    still = ended(searched, searched.problem.layout.start)
    assert rise_from_start(still) == pytest.approx(0.0, abs=1e-4)
    assert against_start(still) is still


def test_an_end_worse_than_its_start_is_not_confirmed(searched: Estimate) -> None:
    """As far again on the wrong side of the start as the optimum is on the right one."""
    start = searched.problem.layout.start
    worse = ended(searched, np.clip(2.0 * start - searched.z[: len(start)], 0.0, 1.0))
    fall = -rise_from_start(worse)
    assert fall > 20.0
    judged = against_start(worse)
    assert judged.outcome.status == "stalled"
    assert f"{fall:.0f} lower" in judged.outcome.advice
    interrupted = replace(worse, outcome=replace(worse.outcome, status="interrupted"))
    assert against_start(interrupted) is interrupted


def test_windows_held_back_speak_too(searched: Estimate, wrong: Vehicle, flight: Flight) -> None:
    """A window that the start flew is predicted by the start; the fit explains its own windows only."""
    ahead = Prepared.of(wrong, {"sim": flight}, [Window("sim", 20.0, 28.0)])
    assert rise_from_start(searched, ahead) > 10.0
    assert against_start(searched, ahead) is searched
    other = simulate_flight(wrong, parse_maneuver(MANEUVER, "test"), seed=4, name="other")
    ahead = Prepared.of(wrong, {"other": other}, [Window("other", 0.0, 20.0)])
    assert rise_from_start(searched, ahead) < -20.0
    judged = against_start(searched, ahead)
    assert judged.outcome.status == "stalled"
    assert "the windows held back" in judged.outcome.advice


def test_a_regression_is_judged_by_its_simulation(aircraft: Vehicle, flight: Flight) -> None:
    """Noise of regressors biases it: the vehicle that flew, from which it began, explains the record better."""
    options = Options(method="equation-error")
    done = fit(Strategy.textbook(), aircraft, {"sim": flight}, WHOLE, options=options)
    assert rise_from_start(done.estimate) < -20.0
    assert done.estimate.outcome.status == "stalled"
