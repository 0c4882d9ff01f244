"""An independent simulator as truth: JSBSim's aircraft and quadrotor, flown and identified from their noisy readings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stoop_studies.verify import jsbsim, multirotor


@pytest.mark.parametrize("case", ["trainer", "quadrotor, by its speeds", "quadrotor, by its commands"])
def test_a_vehicle_is_found_from_its_outputs(case: str) -> None:
    """Every number within three standard errors or 2 %; those of an airplane together scatter as they say."""
    recorded = multirotor.SPEEDS if "speeds" in case else multirotor.COMMANDS
    flown: Any = jsbsim.flown_case("T37") if case == "trainer" else multirotor.flown_case(recorded)
    told = flown.estimates(flown.flight(seed=0))
    names = np.array(list(flown.truth))
    truth, found, sigma = (np.array([told[k][n] for n in names]) for k in ("truth", "estimate", "sigma"))
    off = np.abs(found - truth)
    agree = off <= np.maximum(jsbsim.SIGMAS * sigma, jsbsim.SHARE * np.abs(truth))
    assert agree.all(), names[~agree]
    if case == "trainer":
        assert 0.4 < np.mean((off / sigma) ** 2) < 2.0, "36 normal squares, were they independent"
