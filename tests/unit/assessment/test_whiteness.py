"""The statistic of Ljung and Box, against its formula written out, and its chance of a false alarm."""

from __future__ import annotations

import numpy as np
import pytest
from naive.whiteness import naive_ljung_box
from scipy.stats import chi2

from stoop.assessment.goodness_of_fit import WHITENESS_LAGS, whiteness


def colored(size: int, rho: float, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    out = np.zeros(size)
    for i, kick in enumerate(random.standard_normal(size)):
        out[i] = rho * out[i - 1] + kick if i else kick
    return out


def test_against_the_formula_written_out() -> None:
    holes = colored(300, 0.2, 8)
    holes[[40, 41, 150]] = np.nan
    for residual in (*(colored(300, rho, 7) for rho in (0.0, 0.3, 0.95)), holes):
        found = whiteness(residual)
        assert found.lags == WHITENESS_LAGS
        assert found.statistic == pytest.approx(naive_ljung_box(residual, WHITENESS_LAGS), rel=1e-10)
        assert found.p_value == pytest.approx(chi2.sf(found.statistic, WHITENESS_LAGS), rel=1e-12)
        assert whiteness(1e200 * residual).statistic == pytest.approx(found.statistic)
    for nothing in (np.zeros(50), np.full(50, np.nan), np.array([1.0, 2.0])):
        assert (whiteness(nothing).verdict, np.isnan(whiteness(nothing).statistic)) == ("", True)


def test_by_hand() -> None:
    # n = 10 allows two lags: r1 = sum / 10 = -9/10, r2 = 8/10; Q = 10 * 12 * (0.81 / 9 + 0.64 / 8)
    found = whiteness(np.array([1.0, -1.0] * 5))
    assert (found.lags, found.autocorrelation) == (2, pytest.approx(-0.9))
    assert found.statistic == pytest.approx(120.0 * (0.81 / 9.0 + 0.64 / 8.0))
    assert found.verdict == "colored"


def test_false_alarms_come_as_often_as_promised() -> None:
    random = np.random.default_rng(0)
    alarms = [whiteness(random.standard_normal(400)).verdict == "colored" for _ in range(600)]
    assert 0.03 < np.mean(alarms) < 0.08  # 5 %, standard error 0.9 %


def test_color_and_offset_are_seen() -> None:
    assert whiteness(colored(500, 0.5, 1)).verdict == "colored"
    assert whiteness(np.random.default_rng(1).standard_normal(500) + 1.0).verdict == "colored"
    assert whiteness(np.random.default_rng(1).standard_normal(500)).verdict == "white"


def test_a_slow_sensor_on_a_fast_grid_counts_the_lags_that_it_has() -> None:
    random = np.random.default_rng(2)
    residual = np.full(3000, np.nan)
    residual[::10] = random.standard_normal(300)
    found = whiteness(residual)
    assert found.lags == 2  # 10 and 20 of twenty
    assert found.p_value == pytest.approx(chi2.sf(found.statistic, 2), rel=1e-12)
    assert np.isnan(found.autocorrelation)
    residual[::10] = colored(300, 0.2, 3)  # with twenty degrees of freedom it would pass for white
    assert whiteness(residual).verdict == "colored"


def test_a_prediction_that_diverges_is_not_white() -> None:
    """All its power is in the last samples, which correlate with nothing."""
    growth = np.random.default_rng(0).standard_normal(500) + np.exp(np.minimum(np.arange(500.0), 300.0))
    found = whiteness(growth)
    assert found.verdict == "colored"
    assert np.isfinite(found.statistic)
