"""The slope of lift with the angle of attack: that of a line where the vane moves, none where rounding alone moves it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from stoop.checks.air import LIMITS, Air
from stoop.checks.engine import LIMITS as THRESHOLDS

LIFT = ("lift", "alpha", "az")


def slope(alpha: np.ndarray, az: np.ndarray) -> float:
    return float(Air({"alpha": alpha, "az": az}, LIMITS.rate)({}, None)[LIFT].value)


def test_the_slope_is_that_of_the_line_of_least_squares() -> None:
    rng = np.random.default_rng(0)
    alpha = 0.05 * rng.standard_normal(400)
    az = -9.8 - 60.0 * alpha + 0.5 * rng.standard_normal(400)
    line = np.polyfit(alpha, -az, 1)
    assert slope(alpha, az) == pytest.approx(line[0] / np.mean(-az), rel=1e-9)


def test_a_vane_that_moves_by_rounding_alone_has_no_slope() -> None:
    """Its readings follow the lift, in the last digit."""
    up = np.random.default_rng(0).integers(0, 2, 400)
    alpha = np.where(up, np.nextafter(290.0, 300.0), 290.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(slope(alpha, -9.8 - up))


@pytest.mark.parametrize(
    "state", [{"alpha": ("beta", 1.0), "beta": ("alpha", 1.0)}, {"beta": ("beta", -1.0)}]
)
def test_flow_angles_that_no_force_follows_are_told(state: dict[str, tuple[str, float]]) -> None:
    """Side force falls with sideslip, and lift grows with the angle of attack."""
    rng = np.random.default_rng(0)
    time = np.arange(600) / LIMITS.rate
    alpha, beta = 0.05 * np.sin(0.8 * time), 0.05 * np.sin(1.1 * time)
    readings = {"alpha": alpha, "beta": beta, "az": -9.8 - 60.0 * alpha, "ay": -20.0 * beta}
    air = Air(
        {n: x + 0.1 * rng.standard_normal(600) * n.startswith("a") for n, x in readings.items()}, LIMITS.rate
    )
    right, wrong = (air(now, None)["flow", "beta", "ay"] for now in ({}, state))
    gained, clear = right.gain(wrong, THRESHOLDS, complete=True)
    assert clear
    assert gained > THRESHOLDS.evidence
