"""The noise floor of a channel: independent of what a model explains, and what it does to the verdict against the lag."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stoop.assessment.goodness_of_fit import (
    Match,
    channel_figures,
    fit_percent,
    inside_band,
    noise_floor,
    unexplained,
)

RATE = 200.0
TIME = np.arange(4000) / RATE
SIGMA = 0.3


def noise(seed: int) -> np.ndarray:
    return SIGMA * np.random.default_rng(seed).standard_normal(len(TIME))


def test_white_noise_and_motion_are_told_apart() -> None:
    motion = np.sin(2.0 * np.pi * 0.7 * TIME)
    found, ratio = noise_floor(5.0 + motion + noise(1), RATE, math.inf)
    assert found == pytest.approx(SIGMA * math.sqrt(20.0 / RATE), rel=0.05)  # what lies below 10 Hz of 100 Hz
    assert ratio == pytest.approx(math.sqrt(0.5) / found, rel=0.05)
    assert noise_floor(noise(2), RATE, math.inf)[1] < 0.5


def test_a_perfect_model_of_a_calm_channel_is_below_its_noise_and_loses_to_no_lag() -> None:
    """Theil's coefficient of the truth itself: 0.7 to 1 where hardly anything moves."""
    calm = 0.02 * np.sin(2.0 * np.pi * 0.7 * TIME)
    found = channel_figures(calm + noise(3), Match(calm), RATE, Match(calm + 1e-3 * TIME), SIGMA)
    assert found.theil > 0.6
    assert found.below_noise
    assert not found.compared
    assert not found.lost
    lively = channel_figures(50.0 * calm + noise(3), Match(50.0 * calm), RATE, Match(0.0 * calm), SIGMA)
    assert not lively.below_noise
    assert lively.better
    assert lively.theil < 0.1


def test_a_model_that_explains_nothing_does_not_hide_behind_its_own_residuals() -> None:
    """The fit would take all motion for noise; the record's own noise does not."""
    motion = np.sin(2.0 * np.pi * 0.7 * TIME)
    measured = motion + 0.05 * noise(4)
    left = float(np.std(measured))
    found = channel_figures(measured, Match(0.0 * motion), RATE, Match(0.9 * motion), left)
    assert not found.below_noise
    assert found.lost


def test_slow_errors_that_the_better_of_model_and_lag_leaves_are_noise() -> None:
    """A drift of the attitude is no motion, though it is far above the white noise."""
    drift = 0.2 * np.sin(2.0 * np.pi * 0.2 * TIME)
    motion = np.sin(2.0 * np.pi * 0.7 * TIME)
    assert unexplained([(motion + drift + noise(7), motion)] * 2, RATE) == pytest.approx(
        math.hypot(0.2 * math.sqrt(0.5), SIGMA * math.sqrt(20.0 / RATE)), rel=0.05
    )
    still, model = drift + noise(8), Match(0.0 * drift)
    lag = Match(0.5 * drift)
    assert channel_figures(still, model, RATE, lag, SIGMA).lost
    found = channel_figures(still, model, RATE, lag, SIGMA, left=0.2 * math.sqrt(0.5))
    assert found.below_noise
    assert not found.lost
    assert not channel_figures(motion + still, model, RATE, lag, SIGMA, left=0.2).below_noise


def test_what_is_sampled_slowly_or_held_has_no_more_noise_than_the_fit_says() -> None:
    slow = np.sin(TIME[::40])  # 5 Hz: differences hold the motion
    assert noise_floor(slow, 5.0, 0.01)[0] <= 0.01
    held = np.repeat((np.sin(TIME) + noise(5))[::10], 10)
    assert noise_floor(held, RATE, math.inf)[0] < SIGMA


def test_fit_percent_is_one_less_the_share_of_the_error() -> None:
    z, y = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.5, 1.0, 2.0, 2.5])
    figures = channel_figures(z, Match(y), 1.0)
    share = math.sqrt(np.sum((z - y) ** 2) / np.sum((z - z.mean()) ** 2))
    assert figures.fit_percent == pytest.approx(100.0 * (1.0 - share))
    assert math.isnan(fit_percent(math.nan))


def test_the_band_holds_95_percent_of_what_it_describes() -> None:
    residual = noise(6)
    residual[:50] = np.nan
    assert inside_band(residual, np.full(len(TIME), SIGMA)) == pytest.approx(0.95, abs=0.01)
    assert inside_band(residual, np.full(len(TIME), 0.5 * SIGMA)) == pytest.approx(0.673, abs=0.03)
    assert math.isnan(inside_band(residual, np.full(len(TIME), np.nan)))
