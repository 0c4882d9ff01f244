"""An independent simulator as truth: JSBSim's quadrotor, flown and identified from its noisy readings."""

from __future__ import annotations

import numpy as np
import pytest

from stoop_studies.verify.jsbsim import SHARE, SIGMAS
from stoop_studies.verify.multirotor import COMMANDS, SPEEDS, flown_case


@pytest.mark.parametrize("recorded", [SPEEDS, COMMANDS])
def test_a_quadrotor_is_found_from_its_outputs(recorded: str) -> None:
    """Thrust, torque, inflow, lag, drag, damping and inertia within three standard errors or 2 %."""
    quadrotor = flown_case(recorded)
    told = quadrotor.estimates(quadrotor.flight(seed=0))
    truth, found, sigma = (
        np.array([told[k][n] for n in quadrotor.truth]) for k in ("truth", "estimate", "sigma")
    )
    off = np.abs(found - truth)
    agree = off <= np.maximum(SIGMAS * sigma, SHARE * np.abs(truth))
    assert agree.all(), np.array(list(quadrotor.truth))[~agree]
