"""Flights under an autopilot: the loop is closed, and made-up estimates turn every verdict round."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stoop_studies.findings import Setting
from stoop_studies.verify import closed_loop
from stoop_studies.verify.feedback import CASES, EXPERIMENT
from stoop_studies.verify.scenes import aircraft, maneuvers, with_biases
from stoop_studies.verify.study import run_key

SETTING = Setting(runs=100)


def verdicts(offset: float, sigma: float) -> set[str]:
    """Return the verdicts on errors of unit scatter with a mean of `offset` and standard errors `sigma`."""
    rng = np.random.default_rng(0)
    results: dict[str, Any] = {
        run_key(case, seed): {
            "names": ["a", "b"], "errors": (offset + rng.standard_normal(2)).tolist(), "sigma": [sigma] * 2,
            "status": "converged", "method": "filter-error",
        }
        for seed in SETTING.seeds
        for case in CASES
    }  # fmt: skip
    return {c.verdict for c in EXPERIMENT.findings(SETTING, results).claims}


def test_right_standard_errors_hold() -> None:
    assert verdicts(0.0, 1.0) == {"holds"}


@pytest.mark.parametrize(("offset", "sigma"), [(1.5, 1.0), (0.0, 0.5)])
def test_bias_and_narrow_intervals_do_not(offset: float, sigma: float) -> None:
    assert "does not hold" in verdicts(offset, sigma)


def test_recorded_surfaces_follow_the_recorded_motion() -> None:
    """Surface less maneuver is the law of the readings of the sample before."""
    rng, maneuver = np.random.default_rng(3), maneuvers()["roll"]
    vehicle = with_biases(aircraft(), rng)
    flight = closed_loop.fly(vehicle, maneuver, rng, "roll")
    fed = flight.column("aileron") - maneuver.deflections()["aileron"]
    law = sum(gain * flight.column(c) for c, gain in closed_loop.LAW["aileron"].items())
    np.testing.assert_allclose(np.diff(fed[1:]), np.diff(law[:-1]), atol=1e-12)
