"""Moments of inertia that a wrong model moves to where no body has them are held, and their priors count in the error bars."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stoop.assessment.error_bars import error_bars
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.strategy import Strategy, fit
from stoop.strategy.decision import Fitted
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.checks import is_body
from stoop.workflow.derivatives import derivatives
from stoop.workflow.flying import linearize
from stoop.workflow.outputs import with_values
from stoop_studies.verify import scenes

HOLD = Strategy.only("held-numbers")
PITCH = "mass.inertia.yy"
FREE = ("Cmalpha", "Cmq")


@cache
def flight() -> Flight:
    return simulate_flight(scenes.aircraft(), scenes.maneuvers()["pitch"], noise=True, seed=5, name="pitch")


def user(scale: float, **inertia: object) -> Vehicle:
    """Return the true vehicle whose elevator turns it so much less, the inertia and little else of it free."""
    truth = scenes.aircraft()
    changes: dict[str, dict[str, object]] = {p.name: {"free": False} for p in truth.parameters if p.free}
    changes |= {n: {"free": True} for n in FREE} | {PITCH: {"free": True} | inertia}
    changes["Cmelevator"] = {"value": scale * truth.value("Cmelevator"), "free": False}
    return truth.with_numbers(changes)


def done(vehicle: Vehicle, strategy: Strategy = HOLD) -> Fitted:
    windows = [Window("pitch", 0.0, scenes.DURATION)]
    options = Options(budget=3000.0, method="output-error")
    return fit(strategy, vehicle, {"pitch": flight()}, windows, options=options)


def std(estimate: Estimate, name: str) -> float:
    return float(error_bars(estimate).std[[p.name for p in estimate.problem.layout.parameters].index(name)])


@pytest.mark.parametrize("prior", [None, 8.0])
def test_an_inertia_of_no_body_is_held_and_the_written_vehicle_loads(prior: float | None) -> None:
    """A surface that is eight times too effective asks for more inertia: to a default bound, also where no body has it."""
    truth = scenes.aircraft().value(PITCH)
    vehicle = user(8.0, prior=prior and prior * truth)
    free = done(vehicle, Strategy.textbook()).estimate
    assert is_body(free.identified_vehicle) == (prior is None)
    assert free.unknowns[0].fixed == "bound"
    found = done(vehicle)
    assert PITCH not in found.estimate.estimates
    (said,) = (one for one in found.estimate.notices if one.code == "inertia-held")
    assert (said.subject, said.values["value"]) == (PITCH, truth)
    (record,) = (one for one in found.decisions if one.name == "held-numbers")
    assert record.state == "applied"
    held = found.estimate.problem.layout.vehicle
    written = parse_vehicle(with_values(held, found.estimate.estimates), "written")
    assert written.value(PITCH) == truth
    assert not next(p for p in written.parameters if p.name == PITCH).free
    for verb in (trim, linearize, derivatives):
        verb(written)  # type: ignore[operator]


def test_an_inertia_that_the_flight_shows_stays_free() -> None:
    found = done(user(1.0, prior=0.3 * scenes.aircraft().value(PITCH)))
    assert found.estimate.estimates[PITCH] == pytest.approx(scenes.aircraft().value(PITCH), rel=0.1)
    assert not any(one.code == "inertia-held" for one in found.estimate.notices)


def test_the_prior_of_a_held_moment_widens_error_bars_as_refits_with_another_moment_say() -> None:
    truth = scenes.aircraft().value(PITCH)
    prior = 0.03 * truth

    def held(value: float, known: float | None) -> Estimate:
        vehicle = user(1.0, free=False, value=value, prior=known)
        return done(vehicle, Strategy.textbook()).estimate

    below, above = (held(truth + sign * prior, None).estimates["Cmalpha"] for sign in (-1.0, 1.0))
    moved = 0.5 * abs(above - below)
    before, after = (std(held(truth, known), "Cmalpha") for known in (None, prior))
    assert moved > before  # or there is nothing to see
    assert np.sqrt(after**2 - before**2) == pytest.approx(moved, rel=0.05)
