"""Score tests of extensions: responses against simulations, and what is named on flights of known truth."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from unit.flown import maneuver

from stoop.assessment import extensions
from stoop.assessment.error_bars import error_bars
from stoop.assessment.extensions import LIMITS, extension_notices, extension_tests
from stoop.base.arrays import FloatArray
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options, fit
from stoop.estimate.response import simulation_responses
from stoop.flight import Flight
from stoop.problem.misfit import Misfit
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import catalogue

DURATION = 9.0
STEPS = {
    "pitch": maneuver(DURATION, ("elevator", "3-2-1-1", 1.0, 0.3, 0.12)),
    "roll": maneuver(DURATION, ("aileron", "doublet", 1.0, 0.5, 0.10), ("rudder", "2-1-1", 4.0, 0.6, 0.12)),
}
FORCES = ("CL", "CD", "CQ")
WINDOWS = [Window(name, 0.0, DURATION) for name in STEPS]


def flights(truth: Vehicle, seed: int = 5) -> dict[str, Flight]:
    return {n: simulate_flight(truth, m, seed=seed + k, name=n) for k, (n, m) in enumerate(STEPS.items())}


@functools.cache
def fitted(lag: float) -> Estimate:
    base = resolve_vehicle("twin-boom")
    truth = with_entries(base, {("controls", "aileron", "lag"): lag}) if lag else base
    return fit(base, flights(truth), WINDOWS, Options(seed=1))


def simulated(problem: Misfit, z: FloatArray, vehicle: Vehicle, index: int) -> FloatArray:
    """Return the readings (n, n_y) of another vehicle with the estimates of a fit."""
    layout = problem.layout
    found = zip(layout.parameters, layout.physical(z[None])[0].tolist(), strict=True)
    changed = replace(layout, vehicle=vehicle.with_numbers({p.name: {"value": v} for p, v in found}))
    return replace(problem, layout=replace(changed, parameters=layout.parameters)).outputs(z, index)


@pytest.mark.parametrize(
    "name",
    [
        "controls.aileron.delay", "Clalphabeta", "sensors.p.scale", "sensors.accelerometer_position.x",
        "controls.rudder.dead_zone", "controls.rudder.rate_limit",
    ],
)  # fmt: skip
def test_responses_are_those_of_simulations(name: str) -> None:
    done = fitted(0.0)
    found = simulation_responses(done.problem, done.z)
    (j, one), index = next((j, e) for j, e in enumerate(found.extensions) if e.name == name), 1
    vehicle = with_entries(done.problem.layout.vehicle, one.entries(one.value(one.step)))
    before = done.problem.outputs(done.z, index)
    after = simulated(done.problem, done.z, vehicle, index)
    wanted = done.problem.weights.whiten((after - before) / one.step, np.ones(before.shape, dtype=bool))
    error = np.linalg.norm(found.pieces[index][:, :, j] - wanted) / np.linalg.norm(wanted)
    assert error < 0.05


def test_right_model_lacks_nothing() -> None:
    done = fitted(0.0)
    found = extension_tests(done, error_bars(done))
    assert (found.tested > 80, found.level, found.found) == (True, LIMITS.level, ())
    assert extension_notices(found) == ()


def test_missing_lag_is_named_with_its_value_and_what_it_would_move() -> None:
    done = fitted(0.04)
    found = extension_tests(done, error_bars(done))
    best = found.found[0]
    assert best.name == "controls.aileron.lag"
    assert best.rivals[:1] == ("controls.aileron.delay",)
    assert best.value == pytest.approx(0.04, rel=0.25)
    assert {"Clp", "Claileron"} <= set(best.moves)
    assert all(abs(one.beside) < 5.0 for one in found.found[1:])
    (one,) = extension_notices(found)
    assert (one.code, one.subject, one.values["line"]) == ("model-lacks-one-of", best.name, best.line)


def test_what_priors_alone_say_of_the_mass_is_no_contradiction(monkeypatch: pytest.MonkeyPatch) -> None:
    """All forces over the mass are what a flight shows: wrong guesses of the coefficients are not an error of the scales."""
    base = resolve_vehicle("twin-boom")
    guesses = {
        p.name: {"free": True, "prior": 0.03 * abs(p.value), "mean": p.value * (1.3 if p.name[:2] in FORCES else 1.0)}
        for p in base.parameters if p.free and p.value
    }  # fmt: skip
    done = fit(base.with_numbers(guesses), flights(base), WINDOWS, Options(seed=1))
    for limits, named in ((LIMITS, False), (replace(LIMITS, max_prior=np.inf), True)):
        monkeypatch.setattr(extensions, "LIMITS", limits)
        found = extension_tests(done, error_bars(done)).found
        assert ("mass.mass" in [one.name for one in found]) == named


def test_what_is_known_of_a_held_number_does_not_contradict_it() -> None:
    """Within two standard deviations of its prior; without one any change does."""
    name, vehicle = "mass.inertia.zz", resolve_vehicle("quad-x")
    value = vehicle.value(name)
    for prior, contradicts in ((None, True), (0.2 * value, True), (0.5 * value, False)):
        held = vehicle.with_numbers({name: {"prior": prior, "free": False}})
        (number,) = (one for one in catalogue(held) if one.name == name)
        assert number.believes(0.6 * value) == contradicts
        assert number.believes(-0.6 * value) == contradicts
