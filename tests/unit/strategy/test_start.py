"""A search is confirmed only where its end explains the fitted windows better than its start, simulated open loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.problem.prepare import prepare
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.strategy import Strategy
from stoop.strategy.likelihood import against_start, rise_from_start
from stoop.strategy.run import fit
from stoop.vehicle import Vehicle
from stoop.workflow.demo import MANEUVER

WINDOWS = [Window("sim", 0.0, 20.0)]


@pytest.fixture(scope="module")
def found(wrong: Vehicle, flight: Flight) -> Estimate:
    return methods.find("output-error").fitter()(wrong, {"sim": flight}, WINDOWS, Options())


def ended(found: Estimate, x: FloatArray) -> Estimate:
    z = np.concatenate([x, found.z[len(x) :]])
    return replace(found, z=z, outcome=replace(found.outcome, z=z))


def test_an_end_better_than_its_start_or_at_it_is_confirmed(found: Estimate) -> None:
    assert rise_from_start(found) > 50.0
    assert against_start(found) is found
    still = ended(found, found.problem.layout.start)
    assert rise_from_start(still) == pytest.approx(0.0, abs=1e-4)
    assert against_start(still) is still


def test_an_end_worse_than_its_start_is_not_confirmed(found: Estimate) -> None:
    """As far again on the wrong side of the start as the optimum is on the right one."""
    start = found.problem.layout.start
    worse = ended(found, np.clip(2.0 * start - found.z[: len(start)], 0.0, 1.0))
    fall = -rise_from_start(worse)
    assert fall > 20.0
    judged = against_start(worse)
    assert judged.outcome.status == "stalled"
    assert f"{fall:.0f} lower" in judged.outcome.advice
    interrupted = replace(worse, outcome=replace(worse.outcome, status="interrupted"))
    assert against_start(interrupted) is interrupted


def test_windows_held_back_speak_too(found: Estimate, wrong: Vehicle, flight: Flight) -> None:
    """A window that the start flew is predicted by the start; the fit explains its own windows only."""
    ahead = prepare(wrong, {"sim": flight}, [Window("sim", 20.0, 28.0)])
    assert rise_from_start(found, ahead) > 10.0
    assert against_start(found, ahead) is found
    other = simulate_flight(wrong, parse_maneuver(MANEUVER, "test"), seed=4, name="other")
    ahead = prepare(wrong, {"other": other}, [Window("other", 0.0, 20.0)])
    assert rise_from_start(found, ahead) < -20.0
    judged = against_start(found, ahead)
    assert judged.outcome.status == "stalled"
    assert "the windows held back" in judged.outcome.advice


def test_a_regression_is_judged_by_its_simulation(aircraft: Vehicle, flight: Flight) -> None:
    """Noise of regressors biases it: the vehicle that flew, from which it began, explains the record better."""
    options = Options(method="equation-error")
    done = fit(Strategy.textbook(), aircraft, {"sim": flight}, WINDOWS, options=options)
    assert rise_from_start(done.estimate) < -20.0
    assert done.estimate.outcome.status == "stalled"
