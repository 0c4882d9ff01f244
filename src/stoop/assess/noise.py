"""The color of residuals: autocovariance over segments with holes, continued by an autoregression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.fft import rfft
from scipy.linalg import toeplitz

from stoop.base.arrays import FloatArray
from stoop.estimate.noise import lagged_products

LEAST: Final = 1e-3  #: of the variance: least power at any frequency; bounds how slow the noise can be


@dataclass(frozen=True, eq=False)
class ColoredNoise:
    """One autoregression per channel, driven by innovations that may be correlated between channels.

    ``v[n] = sum_i coefficients[:, i] v[n - 1 - i] + w[n]``, ``cov(w) = innovation``.

    Attributes
    ----------
    coefficients : (ny, order)
    innovation : (ny, ny)
    """

    coefficients: FloatArray
    innovation: FloatArray

    def spectrum(self, size: int) -> npt.NDArray[np.complex128]:
        """Return the power spectrum (size // 2 + 1, ny, ny) at the frequencies of an FFT of `size`.

        Its inverse transform is the autocovariance E[v(i + l) v(i)'], wrapped at `size`.
        """
        gain = self._gain(size)
        spectrum: npt.NDArray[np.complex128] = gain[:, :, None] * self.innovation * gain.conj()[:, None, :]
        return spectrum

    def power(self, size: int) -> FloatArray:
        """Return the diagonal (size // 2 + 1, ny) of the spectrum."""
        power: FloatArray = np.abs(self._gain(size)) ** 2 * np.diag(self.innovation)
        return power

    def _gain(self, size: int) -> npt.NDArray[np.complex128]:
        ones = np.ones((len(self.coefficients), 1))
        return np.asarray(1.0 / rfft(np.concatenate([ones, -self.coefficients], axis=1), size, axis=1).T)


def autocorrelation(residuals: Sequence[FloatArray], lags: int) -> FloatArray:
    """Return the residual autocorrelation (ny, lags + 1) over segments (n_i, ny) with NaN where missing.

    White residuals stay within 1.96 / sqrt(N) beyond lag 0. Normalized by the variance over all samples,
    which keeps it between -1 and 1; NaN for a channel without residuals.
    """
    present = [np.isfinite(residual) for residual in residuals]
    filled = [np.where(mask, residual, 0.0) for residual, mask in zip(residuals, present, strict=True)]
    sums, _ = lagged_products(filled, [mask.astype(np.float64) for mask in present], lags)
    power = np.where(sums[:, :1] > 0.0, sums[:, :1], np.nan)
    return sums / power


def fit_noise(autocovariance: FloatArray, residuals: Sequence[FloatArray]) -> ColoredNoise:
    """Return the autoregressions with the given autocovariance (ny, order + 1).

    Parameters
    ----------
    autocovariance : (ny, order + 1)
        Made possible first, where holes in the data or their correction have made it impossible.
    residuals : sequence of (n_i, ny)
        From which the correlation of the innovations between channels is taken.
    """
    fitted = [_levinson(_possible(channel)) for channel in autocovariance]
    coefficients = np.array([item[0] for item in fitted])
    power = np.sqrt(np.array([item[1] for item in fitted]))
    return ColoredNoise(
        coefficients, np.outer(power, power) * _innovation_correlation(coefficients, residuals)
    )


def _possible(autocovariance: FloatArray) -> FloatArray:
    """Return the autocovariance (order + 1,) with enough white noise added for its matrix to be positive."""
    result = autocovariance.copy()
    least = float(np.linalg.eigvalsh(toeplitz(result))[0])
    result[0] += max(0.0, LEAST * abs(float(result[0])) - least)
    return result


def _levinson(autocovariance: FloatArray) -> tuple[FloatArray, float]:
    """Return the coefficients and the innovation's variance by the Levinson-Durbin recursion."""
    coefficients = np.zeros(0)
    power = float(autocovariance[0])
    for order in range(1, len(autocovariance)):
        rest = float(autocovariance[order] - coefficients @ autocovariance[order - 1 : 0 : -1])
        reflection = rest / power if power > 0.0 else 0.0
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        power *= 1.0 - reflection**2
    return coefficients, power


def _innovation_correlation(coefficients: FloatArray, residuals: Sequence[FloatArray]) -> FloatArray:
    """Return the correlation (ny, ny) between channels of what the autoregressions do not foresee."""
    total = np.zeros((len(coefficients), len(coefficients)))
    order = coefficients.shape[1]
    for residual in residuals:
        surprise = residual[order:].copy()
        for lag in range(order):
            surprise -= coefficients[:, lag] * residual[order - 1 - lag : len(residual) - 1 - lag]
        total += surprise.T @ surprise
    power = np.sqrt(np.diag(total))
    power = np.where(power > 0.0, power, 1.0)
    correlation: FloatArray = total / np.outer(power, power)
    correlation[np.diag_indices_from(correlation)] = 1.0
    return correlation
