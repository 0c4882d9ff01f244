"""Autocorrelation sums of residuals with holes, by fast Fourier transforms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from stoop.base.arrays import FloatArray


def lagged_products(
    residuals: Sequence[FloatArray], present: Sequence[FloatArray], lags: int
) -> tuple[FloatArray, FloatArray]:
    """Return the sums over all segments of v(i) v(i + l), and how many products they hold.

    Parameters
    ----------
    residuals, present : sequences of (n_i, ny)
        Residuals with zeros where missing; ones where not.
    lags : int
        l runs from 0 to `lags`.

    Returns
    -------
    sums, counts : (ny, lags + 1)
    """
    sums = sum(_correlate(residual, lags) for residual in residuals)
    counts = sum(_correlate(mask, lags) for mask in present)
    return np.asarray(sums), np.maximum(np.rint(np.asarray(counts)), 0.0)


def _correlate(values: FloatArray, lags: int) -> FloatArray:
    size = next_fast_len(len(values) + lags, real=True)
    transformed = rfft(values, size, axis=0)
    return np.asarray(irfft(np.abs(transformed) ** 2, size, axis=0)[: lags + 1].T)
