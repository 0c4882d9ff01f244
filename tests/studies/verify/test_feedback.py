"""Flights under an autopilot: the loop is closed, and made-up estimates turn every verdict round."""

from __future__ import annotations

import numpy as np

from stoop_studies.verify import closed_loop
from stoop_studies.verify.scenes import aircraft, maneuvers, with_biases


def test_recorded_surfaces_follow_the_recorded_motion() -> None:
    """Surface less maneuver is the law of the readings of the sample before."""
    rng, maneuver = np.random.default_rng(3), maneuvers()["roll"]
    vehicle = with_biases(aircraft(), rng)
    flight = closed_loop.fly(vehicle, maneuver, rng, "roll")
    fed = flight.column("aileron") - maneuver.deflections()["aileron"]
    law = sum(gain * flight.column(c) for c, gain in closed_loop.LAW["aileron"].items())
    np.testing.assert_allclose(np.diff(fed[1:]), np.diff(law[:-1]), atol=1e-12)
