"""Attitude against rates: noise is not turning, and what is wrong is seen through noise."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.rotations import quaternions_of
from stoop.base.variables import QUATERNION
from stoop.checks.kinematics import check_rates
from stoop.checks.mapping import check_mapping

RATE = 100.0  #: Hz
TIME = np.arange(3000) / RATE
NOISE = 0.01  #: rad, of the attitude: what the built-in vehicles have


def record(size: float, seed: int, swap: bool = False) -> dict[str, FloatArray]:
    """Return a vehicle that rolls back and forth, its attitude noisy; nothing else turns."""
    rng = np.random.default_rng(seed)
    angles = np.zeros((TIME.size, 3))
    angles[:, 0] = size * np.sin(2.0 * TIME)
    rates = np.zeros((TIME.size, 3))
    rates[:, 1 if swap else 0] = 2.0 * size * np.cos(2.0 * TIME)
    e = quaternions_of(angles + NOISE * rng.standard_normal(angles.shape))
    rates += 0.01 * rng.standard_normal(rates.shape)
    return dict(zip(QUATERNION, e.T, strict=True)) | dict(zip("pqr", rates.T, strict=True))


def found(data: dict[str, FloatArray]) -> list[Notice]:
    judged = check_mapping({}, data, RATE, {})
    return [*judged.notices, *check_rates(judged.corrected(data), RATE, {})]


@pytest.mark.parametrize("size", [0.0, 0.005, 0.02, 0.05, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_noise_accuses_nobody(size: float, seed: int) -> None:
    assert found(record(size, seed)) == []


def test_swapped_axes_are_seen_through_noise() -> None:
    (notice,) = found(record(0.3, 0, swap=True))
    assert (notice.code, notice.values["lines"]) == ("mapping-exchange", ("p", "q"))


def test_a_wrong_scale_is_seen_through_noise() -> None:
    data = record(0.3, 0)
    (notice,) = found(data | {"p": 0.5 * data["p"]})
    assert (notice.code, notice.subject) == ("rate-scale", "p")
    assert notice.values["gain"] == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", [0.02, 0.03, 0.05])
def test_noise_that_the_filter_of_the_grid_smoothed_accuses_nobody(size: float, seed: int) -> None:
    """Neighbors on the grid then scatter less than what was recorded; correlations of 0.8 were false alarms."""
    data = record(size, seed)
    smooth = {name: np.convolve(x, [0.25, 0.5, 0.25], mode="same")[2:-2] for name, x in data.items()}
    assert found(smooth) == []
