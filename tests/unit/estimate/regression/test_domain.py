"""Domains: transforms against their sums, spreads against double sums, and what they promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive.regression import double_sum, transform

from stoop.estimate.regression import least_squares as domain
from stoop.estimate.regression.least_squares import FrequencyDomain, TimeDomain


def test_the_transform_is_the_sum() -> None:
    signals = np.random.default_rng(2).standard_normal((80, 2))
    frequencies = np.array([0.3, 0.7, 1.1, 1.5])
    found = domain.fourier_transform(signals, frequencies, 0.05)
    for k, f in enumerate(frequencies):
        for i in range(2):
            assert found[k, i] == pytest.approx(transform(signals[:, i], f, 0.05), abs=1e-11)


@pytest.mark.parametrize("where", [TimeDomain(), FrequencyDomain(0.1, 2.0)])
def test_a_model_that_holds_is_found_exactly(where: domain.Domain) -> None:
    """A domain is linear: what holds sample by sample holds in it."""
    rng = np.random.default_rng(5)
    X = np.cumsum(rng.standard_normal((600, 3)), axis=0)
    y = X @ [1.0, -2.0, 0.5]
    rows = where.rows(np.column_stack([y, X]), 0.02)
    np.testing.assert_allclose(
        np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0], [1.0, -2.0, 0.5], rtol=1e-9
    )


@settings(max_examples=30, deadline=None)
@given(st.floats(-5.0, 5.0), st.floats(-2.0, 2.0))
def test_a_band_sees_neither_bias_nor_drift(bias: float, drift: float) -> None:
    t = 0.02 * np.arange(500)
    signal = np.sin(5.0 * t)
    plain, moved = (FrequencyDomain().rows(s[:, None], 0.02) for s in (signal, signal + bias + drift * t))
    np.testing.assert_allclose(moved, plain, atol=1e-9)


def test_noise_keeps_its_variance_in_a_band() -> None:
    v = np.random.default_rng(0).standard_normal((1000, 200))
    assert np.var(FrequencyDomain(0.1, 5.0).rows(v, 0.02)) == pytest.approx(1.0, rel=0.03)


def test_frequencies_lie_one_over_the_record_apart() -> None:
    f = FrequencyDomain(0.1, 2.0).frequencies(500, 0.02)
    assert np.diff(f) == pytest.approx(0.1)
    assert f[0] == pytest.approx(0.1)
    assert f[-1] <= 2.0 + 1e-9
    assert FrequencyDomain(0.0, 2.0).frequencies(500, 0.02)[0] == pytest.approx(0.1)


def test_the_spread_is_the_double_sum() -> None:
    rng = np.random.default_rng(1)
    v = np.convolve(rng.standard_normal(64), [1.0, 0.7, 0.3], "same")
    X = rng.standard_normal((64, 3))
    lags = 12  # a fifth of the rows
    np.testing.assert_allclose(TimeDomain(span=0.01).scatter(X, v, 0.02), double_sum(X, v, lags), rtol=1e-9)


def test_white_residuals_in_a_band_spread_as_the_normal_matrix() -> None:
    rng = np.random.default_rng(1)
    X, v = rng.standard_normal((50, 2)), rng.standard_normal(50)
    np.testing.assert_allclose(FrequencyDomain().scatter(X, v, 0.02), X.T @ X * np.mean(v**2))
