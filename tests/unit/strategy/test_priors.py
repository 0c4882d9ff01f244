"""Priors that the flight contradicts are widened; right ones stay, and so do measurements of the mass."""

from __future__ import annotations

from functools import cache

import pytest

from stoop.assessment.error_bars import error_bars
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.strategy import Strategy, fit
from stoop.strategy.decision import Fitted
from stoop.vehicle import Vehicle
from stoop_studies.verify import scenes

ONLY = Strategy.only("priors")
FREE = ("Clp", "Claileron", "Clbeta", "Cnbeta", "Cnr", "Cnrudder")


@cache
def flight() -> Flight:
    return simulate_flight(scenes.aircraft(), scenes.maneuvers()["roll"], noise=True, seed=3, name="roll")


def user(**priors: dict[str, float]) -> Vehicle:
    """Return the true vehicle with few free numbers, whose priors are about the truth but for those given."""
    truth = scenes.aircraft()
    changes: dict[str, dict[str, object]] = {p.name: {"free": False} for p in truth.parameters if p.free}
    for name in FREE:
        changes[name] = {"free": True, "prior": 0.2 * abs(truth.value(name))} | priors.get(name, {})
    return truth.with_numbers(changes)


def done(vehicle: Vehicle, strategy: Strategy = ONLY) -> Fitted:
    windows = [Window("roll", 0.0, scenes.DURATION)]
    return fit(strategy, vehicle, {"roll": flight()}, windows, options=Options(budget=3000.0))


def test_a_prior_that_the_flight_contradicts_is_widened() -> None:
    truth = scenes.aircraft().value("Clp")
    wrong = user(Clp={"value": 0.4 * truth, "prior": 0.004 * abs(truth)})
    held, found = done(wrong, Strategy.textbook()), done(wrong)
    (record,) = (one for one in found.decisions if one.name == "priors")
    assert record.state == "applied"
    assert record.gained > 0.0
    (said,) = (one for one in found.estimate.notices if one.code == "prior-widened")
    assert said.subject == "Clp"
    # the fit that the prior held is far from the flight: to first order the difference is too small
    assert 0.3 * abs(truth) < said.values["consistent"] + 2.0 * said.values["std"] < 0.7 * abs(truth)
    assert said.values["prior"] == pytest.approx(0.004 * abs(truth))

    def off(one: Fitted) -> float:
        i = [p.name for p in one.estimate.problem.layout.parameters].index("Clp")
        return abs(one.estimate.estimates["Clp"] - truth) / float(error_bars(one.estimate).std[i])

    assert off(held) > 10.0
    assert off(found) < 3.0
    assert said.values["estimate"] / truth > 0.6


def test_right_priors_stay() -> None:
    found = done(user())
    assert [one.state for one in found.decisions if one.name == "priors"] == ["not needed"]
    assert found.estimate.estimates == done(user(), Strategy.textbook()).estimate.estimates


def test_a_mass_is_a_measurement() -> None:
    """It is named by the notices of a result, and not estimated anew."""
    mass = scenes.aircraft().value("mass.mass")
    heavy = user().with_numbers({"mass.mass": {"value": 1.3 * mass, "prior": 0.001 * mass, "free": True}})
    found = done(heavy)
    assert found.estimate.estimates["mass.mass"] == pytest.approx(1.3 * mass, rel=0.02)
    assert not any(one.subject == "mass.mass" for one in found.estimate.notices)
