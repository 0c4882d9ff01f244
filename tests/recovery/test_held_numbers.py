"""Moments of inertia that no body has are held; their priors widen the error bars of the others."""

from functools import cache

import numpy as np
import pytest

from stoop.assessment.components import held_mass_properties
from stoop.assessment.error_bars import ErrorBars
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
from stoop.workflow.flying import linearize
from stoop.workflow.outputs import with_values
from stoop_analysis.workflow.derivatives import derivatives
from stoop_studies.verify import scenes
from stoop_studies.verify.closed_loop import quadrotor_scene

HOLD, PITCH = Strategy.only("held-numbers"), "mass.inertia.yy"


@cache
def flight(name: str) -> Flight:
    seed = {"pitch": 5, "roll": 3}[name]
    return simulate_flight(scenes.aircraft(), scenes.maneuvers()[name], noise=True, seed=seed, name=name)


def user(**numbers: dict[str, object]) -> Vehicle:
    truth = scenes.aircraft()
    changes: dict[str, dict[str, object]] = {p.name: {"free": False} for p in truth.parameters if p.free}
    return truth.with_numbers(changes | {n: {"free": True} | told for n, told in numbers.items()})


def pitching(scale: float, **inertia: object) -> Vehicle:
    """Return that whose elevator turns it so much less, with damping and moment of inertia free."""
    elevator = {"value": scale * scenes.aircraft().value("Cmelevator"), "free": False}
    return user(Cmalpha={}, Cmq={}, Cmelevator=elevator, **{PITCH: inertia})


def done(vehicle: Vehicle, strategy: Strategy = HOLD, name: str = "pitch") -> Fitted:
    windows, options = [Window(name, 0.0, scenes.DURATION)], Options(budget=3000.0, method="output-error")
    return fit(strategy, vehicle, {name: flight(name)}, windows, options=options)


def std(estimate: Estimate, name: str) -> float:
    return float(ErrorBars.of(estimate).std[[p.name for p in estimate.problem.layout.parameters].index(name)])


@pytest.mark.parametrize("prior", [None, 8.0])
def test_an_inertia_of_no_body_is_held_and_the_written_vehicle_loads(prior: float | None) -> None:
    """A surface that is eight times too effective asks for more inertia: to a default bound, also where no body has it."""
    truth = scenes.aircraft().value(PITCH)
    vehicle = pitching(8.0, prior=prior and prior * truth)
    free = done(vehicle, Strategy.textbook()).estimate
    assert (is_body(free.identified_vehicle), free.unknowns[0].fixed) == (prior is None, "bound")
    found = done(vehicle)
    assert PITCH not in found.estimate.estimates
    (said,) = (one for one in found.estimate.notices if one.code == "inertia-held")
    assert (said.subject, said.values["value"]) == (PITCH, truth)
    (record,) = (one for one in found.decisions if one.name == "held-numbers")
    assert record.state == "applied"
    held = found.estimate.problem.layout.vehicle
    written = parse_vehicle(with_values(held, found.estimate.estimates), "written")
    (before, after) = (next(p for p in v.parameters if p.name == PITCH) for v in (held, written))
    assert (after.value, after.free) == (truth, False)
    assert after.prior == pytest.approx(before.prior, rel=1e-9)
    assert after.prior_mean == truth
    for verb in (trim, linearize, derivatives):
        verb(written)  # type: ignore[operator]


def test_a_held_moment_without_a_prior_is_known_as_its_bounds_say() -> None:
    """Evenly: the standard deviation is that of a number which is anywhere between them."""
    vehicle = pitching(8.0)
    (moment,) = (p for p in vehicle.parameters if p.name == PITCH)
    found = held_mass_properties(done(vehicle).estimate)
    assert found == {PITCH: pytest.approx(np.std(np.linspace(moment.lower, moment.upper, 100_001)), rel=1e-4)}


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_of_the_inertia_in_yaw_and_the_torque_of_rotors_a_flight_shows_the_ratio(share: float) -> None:
    scene = quadrotor_scene(0.0, 1)
    name, truth = "mass.inertia.zz", scene.truth["mass.inertia.zz"]
    vehicle = scene.start.with_numbers({name: {"value": share * truth, "prior": 0.2 * share * truth}})
    (flight,) = scene.flights.values()
    windows = [Window(flight.name, 0.0, 8.0)]
    found = fit(HOLD, vehicle, {flight.name: flight}, windows, options=Options(method="multiple-shooting"))
    held = [one.subject for one in found.estimate.notices if one.code == "inertia-held"]
    assert held == ([name] if share < 0.5 else [])
    torque = found.estimate.estimates["rotors.torque_ratio"]
    assert abs(torque - scene.truth["rotors.torque_ratio"] * (share if held else 1.0)) < 0.1 * torque


def held(value: float, known: float | None) -> Estimate:
    return done(pitching(1.0, free=False, value=value, prior=known), Strategy.textbook()).estimate


@pytest.mark.parametrize(("number", "share"), [(PITCH, 0.03), (PITCH, 0.3), ("mass.mass", 0.002)])
def test_a_held_mass_property_widens_error_bars_as_a_free_one_does(number: str, share: float) -> None:
    """Consider covariance (Tapley, Schutz and Born) against the joint estimate of the number itself."""
    names = ("CLalpha", "CLq") if number == "mass.mass" else ("Cmalpha", "Cmq")
    prior = share * scenes.aircraft().value(number)

    def fitted(**told: object) -> Estimate:
        return done(user(**{n: {} for n in names}, **{number: told}), Strategy.textbook()).estimate

    value = fitted().estimates[number]  # so that no prior pulls
    free = fitted(value=value, prior=prior)
    held_there, alone = (fitted(free=False, value=value, prior=known) for known in (prior, None))
    for name in names:
        assert std(held_there, name) == pytest.approx(std(free, name), rel=0.02)
    assert std(held_there, names[0]) > 1.02 * std(alone, names[0])


def test_the_prior_of_a_moment_that_the_flight_contradicts_counts_whole() -> None:
    truth = scenes.aircraft().value(PITCH)
    prior, wrong = 0.03 * truth, 1.03 * truth
    below, above = (held(wrong + sign * prior, None).estimates["Cmalpha"] for sign in (-1.0, 1.0))
    moved = 0.5 * abs(above - below)
    before, after = (std(held(wrong, known), "Cmalpha") for known in (None, prior))
    assert np.sqrt(after**2 - before**2) == pytest.approx(moved, rel=0.15)
