"""Theil's coefficient, its parts, the root mean square error and R2, against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_allclose

from stoop.assessment.goodness_of_fit import Match, channel_figures, r2, rmse, theil, theil_shares

curve = hnp.arrays(np.float64, st.integers(2, 30), elements=st.integers(-999, 999).map(float))


def pair(size: int = 400) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(size) / 100.0
    return np.sin(3 * t), 0.8 * np.sin(3 * t - 0.2) + 0.1


def test_against_the_definition_by_hand() -> None:
    # rms(z - y) = sqrt(1/2), rms(z) = sqrt(5/2), rms(y) = sqrt(10/2)
    z, y = np.array([1.0, 2.0]), np.array([1.0, 3.0])
    assert_allclose(theil(z, y), 1.0 / (np.sqrt(5.0) + np.sqrt(10.0)))
    assert_allclose(rmse(z, y), np.sqrt(0.5))
    assert_allclose(r2(z, y), 1.0 - 1.0 / 0.5)


@given(curve, st.floats(0.1, 10.0))
def test_bounds_and_units(z: np.ndarray, factor: float) -> None:
    assert theil(z, z) == 0.0
    assert theil(z, -z) == (pytest.approx(1.0) if np.any(z) else 0.0)
    y = np.roll(z, 1) + 0.5
    assert 0.0 <= theil(z, y) <= 1.0 + 1e-12
    assert_allclose(theil(factor * z, factor * y), theil(z, y), rtol=1e-9)


def test_shares_add_up_and_name_the_fault() -> None:
    z, y = pair()
    parts = theil_shares(z, y)
    assert_allclose(parts.bias + parts.variance + parts.covariance, 1.0)
    assert theil_shares(z, z + 1.0).bias == pytest.approx(1.0)
    assert theil_shares(z - z.mean(), 2.0 * (z - z.mean())).variance == pytest.approx(1.0)
    wave = 2 * np.pi * np.arange(100) / 100  # a whole period: a shift in phase changes nothing but the phase
    assert theil_shares(np.sin(wave), np.cos(wave)).covariance == pytest.approx(1.0)
    assert np.isnan(theil_shares(z, z).bias)


def test_what_is_missing_does_not_count() -> None:
    (z, y), nothing = pair(), np.full(5, np.nan)
    holes = np.where((np.arange(z.size) >= 50) & (np.arange(z.size) < 60), np.nan, z)
    there = np.isfinite(holes)
    for figure in (theil, rmse, r2):
        assert figure(holes, y) == figure(z[there], y[there])
        assert np.isnan(figure(nothing, np.zeros(5)))
    assert np.isnan(theil_shares(nothing, nothing).bias)
    assert np.isnan(r2(np.zeros(4), np.zeros(4)))


def test_vibration_does_not_count() -> None:
    z, y = pair()
    shaken = z + np.sin(2 * np.pi * 35 * np.arange(z.size) / 100.0)
    assert theil(shaken, y, 100.0) == pytest.approx(theil(z, y), abs=0.01)
    assert theil(shaken, y) > 2 * theil(z, y)


def test_a_diverged_simulation_is_worst_not_an_overflow() -> None:
    z, y = pair()
    far = np.where(np.arange(z.size) > 200, 1e300, y)
    assert theil(z, far) == pytest.approx(1.0)
    assert rmse(z, far) > 1e299
    assert r2(z, far) == -np.inf


def test_a_simulation_that_ends_early_is_judged_by_what_it_did_not_reach() -> None:
    """Its beginning alone would be a perfect match with white residuals."""
    z, y = pair()
    early = np.where(np.arange(z.size) > 0.6 * z.size, np.nan, z)
    figures = channel_figures(z, Match(early), 100.0, baseline=Match(y), deviation=np.full(z.size, 1.0))
    assert figures.rmse > 1e90
    assert figures.theil == pytest.approx(1.0)
    assert figures.r2 < -1e90
    assert figures.whiteness.verdict == "colored"
    assert figures.lost
    assert figures.inside == pytest.approx(0.6, abs=0.02)


def test_everything_stands_beside_the_baseline() -> None:
    z, y = pair()
    figures = channel_figures(z, Match(y, 2.0 * (z - y)), 100.0, baseline=Match(0.5 * y, z))
    parts = theil_shares(z, y)
    assert (figures.theil_shares.bias, figures.theil_shares.variance) == (parts.bias, parts.variance)
    assert figures.press == pytest.approx(2.0 * figures.rmse)
    assert figures.whiteness.verdict == figures.baseline.whiteness.verdict == "colored"
    assert figures.baseline.rmse == rmse(z, 0.5 * y)
    assert figures.baseline.r2 == r2(z, 0.5 * y)
    assert figures.baseline.press == pytest.approx(np.sqrt(np.mean(z**2)))
    assert np.isnan(channel_figures(z, Match(y), 100.0).press)
