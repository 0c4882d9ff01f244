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
from stoop.problem.windows import Window
from stoop.strategy import Strategy
from stoop.strategy.likelihood import against_start, rise_from_start, simulated_residuals
from stoop.strategy.run import fit
from stoop.vehicle import Vehicle

WINDOWS = [Window("sim", 0.0, 20.0)]


@pytest.fixture(scope="module")
def found(wrong: Vehicle, flight: Flight) -> Estimate:
    return methods.find("output-error").fitter()(wrong, {"sim": flight}, WINDOWS, Options())


def ended(found: Estimate, x: FloatArray) -> Estimate:
    """Return an estimate that ended with other parameters (D,) of the unit box."""
    z = np.concatenate([x, found.z[len(x) :]])
    return replace(found, z=z, outcome=replace(found.outcome, z=z))


def test_residuals_are_those_of_the_optimum_where_the_search_ended(found: Estimate) -> None:
    again = simulated_residuals(found, found.identified_vehicle)
    for mine, own in zip(again, found.residuals, strict=True):
        np.testing.assert_allclose(mine, own, atol=2e-3 * np.nanstd(own, axis=0).max())


def test_a_search_that_improves_on_the_file_is_confirmed(found: Estimate) -> None:
    assert rise_from_start(found) > 50.0
    assert against_start(found) is found


def test_an_end_at_its_start_gains_nothing_and_stays_confirmed(found: Estimate) -> None:
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


def test_a_regression_is_judged_by_its_simulation(aircraft: Vehicle, flight: Flight) -> None:
    """Noise of regressors biases it: the vehicle that flew, from which it began, explains the record better."""
    done = fit(
        Strategy.textbook(), aircraft, {"sim": flight}, WINDOWS, options=Options(method="equation-error")
    )
    assert rise_from_start(done.estimate) < -20.0
    assert done.estimate.outcome.status == "stalled"
