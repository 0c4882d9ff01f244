"""The color of residuals against its definition and against known autoregressions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.fft import irfft
from scipy.signal import lfilter

from stoop.assessment.coloring import ColoredNoise, autocorrelation, between_lags, fit_noise
from stoop.estimate.noise import lagged_products


def test_lagged_products_are_the_naive_sums() -> None:
    random = np.random.default_rng(0)
    pieces = [random.normal(size=(30, 2)), random.normal(size=(7, 2))]
    masks = [random.uniform(size=piece.shape) > 0.3 for piece in pieces]
    pieces = [np.where(mask, piece, 0.0) for piece, mask in zip(pieces, masks, strict=True)]
    sums, counts = lagged_products(pieces, [mask.astype(float) for mask in masks], 5)
    for lag in range(6):
        naive = sum((piece[: len(piece) - lag] * piece[lag:]).sum(axis=0) for piece in pieces)
        pairs = sum((mask[: len(mask) - lag] & mask[lag:]).sum(axis=0) for mask in masks)
        assert_allclose(sums[:, lag], naive, atol=1e-12)
        assert_allclose(counts[:, lag], pairs)


def test_autocorrelation_of_white_and_of_colored() -> None:
    white = np.random.default_rng(1).normal(size=(5000, 1))
    colored = lfilter([1.0], [1.0, -0.9], white, axis=0)
    found = autocorrelation([np.column_stack([white, colored, np.full(5000, np.nan)])], 20)
    assert_allclose(found[:2, 0], 1.0)
    assert np.abs(found[0, 1:]).max() < 4.0 / np.sqrt(5000)
    assert_allclose(found[1, :4], 0.9 ** np.arange(4), atol=0.05)
    assert np.isnan(found[2]).all()


def test_lags_without_pairs_lie_between_those_with() -> None:
    known = np.array(
        [[4.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0], [1.0, 0.5, 0.2, 0.1, 0.0, 0.0, 0.0, 0.0], [0.0] * 8]
    )
    counts = np.array([[9, 0, 0, 8, 0, 0, 7, 0], [9, 8, 7, 6, 5, 4, 3, 2], [0] * 8])
    found = between_lags(known, counts)
    assert_allclose(found[0], [4.0, 3.0, 2.0, 1.0, 4.0 / 3.0, 5.0 / 3.0, 2.0, 4.0 / 3.0])
    assert_allclose(found[1:], known[1:])


def test_noise_has_a_memory_of_some_records() -> None:
    """Lags of a channel that hardly decay; the variance stays, and so does noise that decays within a record."""
    lags = np.arange(9)
    autocovariance = np.array([4.0 * (1.0 - 1e-6 * lags), 2.0 * 0.9**lags])
    noise = fit_noise(autocovariance, [np.ones((200, 2))] * 3)
    slow, fast = (np.abs(np.roots([1.0, *-channel])).max() for channel in noise.coefficients)
    assert slow == pytest.approx(1.0 - 1.0 / 800.0)
    assert fast == pytest.approx(0.9, abs=1e-3)
    power = np.abs(noise.gain(2**18)) ** 2 * np.diag(noise.innovation)
    total = (2.0 * power.sum(axis=0) - power[0] - power[-1]) / 2**18
    assert_allclose(total, [4.0, 2.0], rtol=5e-3)


def test_impossible_autocovariance_stays_stable() -> None:
    noise = fit_noise(np.array([[1.0, 1.4, 0.2], [0.0, 0.0, 0.0]]), [np.ones((10, 2))])
    roots = np.roots(np.concatenate([[1.0], -noise.coefficients[0]]))
    assert np.abs(roots).max() < 1.0
    assert np.isfinite(noise.gain(64)).all()
    assert_allclose(noise.coefficients[1], 0.0)


def test_spectrum_transforms_to_the_autocovariance() -> None:
    noise = ColoredNoise(np.array([[0.8], [-0.3]]), np.array([[1.0, 0.4], [0.4, 2.0]]))
    gain = noise.gain(512)
    back = irfft(gain[:, :, None] * noise.innovation * gain.conj()[:, None, :], 512, axis=0)
    lags = np.arange(5)
    assert_allclose(back[:5, 0, 0], 0.8**lags / (1 - 0.64), atol=1e-9)
    # E[v0(i + l) v1(i)] = 0.8^l * 0.4 / (1 + 0.24)
    assert_allclose(back[:5, 0, 1], 0.8**lags * 0.4 / 1.24, atol=1e-9)
    assert back[1, 1, 0] == pytest.approx(-0.3 * 0.4 / 1.24)
