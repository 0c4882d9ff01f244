"""Time and frequency domain: a linear transform of regression rows, applied to the response and the regressors alike.

A linear transform weights samples; it cannot bias an equation that holds at every sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from stoop.base.arrays import ComplexArray, FloatArray

MAX_LAG: Final = 2.0  #: s; residuals further apart count as independent
WINDOW: Final = 0.2  #: s, length of the smoothing window
ROWS_PER_WINDOW: Final = 4
TAPER: Final = 0.1  #: share of the record that is tapered at either end
MIN_FREQUENCIES: Final = 4  #: in the band of a record that is used


class Domain(Protocol):
    """A linear transform from samples to rows of a regression."""

    @property
    def name(self) -> str:
        """``"time"`` or ``"frequency"``."""

    @property
    def settings(self) -> dict[str, float]:
        """The numbers that a reader of the estimates wants to know."""

    @property
    def keeps_constants(self) -> bool:
        """Whether a constant survives the transform."""

    @property
    def colored(self) -> bool:
        """Whether error bars are corrected for the color of the residuals; else residuals count as white."""

    def rows(self, signals: FloatArray, dt: float) -> FloatArray:
        """Return the rows (m, k) of signals (n, k) sampled every `dt` s; none where the record is too short."""

    def scatter(self, X: FloatArray, v: FloatArray, dt: float) -> FloatArray:
        """Return the covariance (k, k) of X' v, rows X (m, k) of one stretch, for noise with the color of v (m,)."""


@dataclass(frozen=True)
class TimeDomain:
    """Samples smoothed by a Hann window, four rows a window.

    Residuals are colored: by the smoothing, and by what the model lacks.

    Attributes
    ----------
    span : float, s
        Length of the window.
    """

    span: float = WINDOW
    name: str = "time"
    keeps_constants: bool = True
    colored: bool = True

    @property
    def settings(self) -> dict[str, float]:
        """Length of the window, s."""
        return {"span": self.span}

    def rows(self, signals: FloatArray, dt: float) -> FloatArray:
        """Return smoothed samples (m, k)."""
        from scipy.signal import oaconvolve
        from scipy.signal.windows import hann

        size = 2 * round(0.5 * self.span / dt) + 1
        if len(signals) < 2 * size:
            return np.empty((0, signals.shape[1]))
        window = hann(size + 2)[1:-1]
        smooth = oaconvolve(signals, (window / window.sum())[:, None], mode="valid", axes=0)
        return np.asarray(smooth[:: self._stride(dt)])

    def _stride(self, dt: float) -> int:
        """Return the samples from one row to the next."""
        return max(1, round(self.span / dt / ROWS_PER_WINDOW))

    def scatter(self, X: FloatArray, v: FloatArray, dt: float) -> FloatArray:
        """Return the double sum of the rows with the residuals' autocovariance.

        The autocovariance is estimated up to a lag of 2 s and tapered to zero there, which keeps the result
        positive semidefinite (W. K. Newey and K. D. West, Econometrica 55(3), 1987).
        """
        lags = min(round(MAX_LAG / (dt * self._stride(dt))), len(v) // 5)
        size = 2 * len(v)
        sampled = np.fft.irfft(np.abs(np.fft.rfft(v, size)) ** 2)[: lags + 1] / len(v)
        tapered = sampled * (1.0 - np.arange(lags + 1) / (lags + 1.0))
        kernel = np.concatenate([tapered, np.zeros(size - 2 * lags - 1), tapered[:0:-1]])
        spectrum = np.fft.rfft(kernel).real
        colored = np.fft.irfft(spectrum[:, None] * np.fft.rfft(X, size, axis=0), size, axis=0)[: len(X)]
        product = X.T @ colored
        return np.asarray(0.5 * (product + product.T))


@dataclass(frozen=True)
class FrequencyDomain:
    """Fourier coefficients of a band, real parts above imaginary parts.

    The record is detrended and tapered first. Frequencies are spaced by one over the record's length: closer ones
    would repeat the same information. Residuals count as white within the band; what lies outside - rate noise that
    differentiation amplifies, vibration, drift - is not used.

    Attributes
    ----------
    low, high : float, Hz
        Limited to one over the record's length and to the Nyquist frequency.

    References
    ----------
    E. A. Morelli, "High accuracy evaluation of the finite Fourier transform using sampled data",
    NASA TM-110340, 1997; V. Klein and E. A. Morelli, *Aircraft System Identification*, 2nd ed., chapter 7.
    """

    low: float = 0.1
    high: float = 2.0
    name: str = "frequency"
    keeps_constants: bool = False
    colored: bool = False

    @property
    def settings(self) -> dict[str, float]:
        """Ends of the band, Hz."""
        return {"low": self.low, "high": self.high}

    def frequencies(self, count: int, dt: float) -> FloatArray:
        """Return the frequencies, Hz, of a record of `count` samples."""
        step = 1.0 / (count * dt)
        first = max(self.low, step)
        last = min(self.high, 0.5 / dt - step)  # below the Nyquist frequency
        return np.asarray(first + step * np.arange(max(0, int((last - first) / step + 1e-9) + 1)))

    def rows(self, signals: FloatArray, dt: float) -> FloatArray:
        """Return real and imaginary parts (m, k), scaled such that white noise keeps its variance."""
        from scipy.signal import detrend
        from scipy.signal.windows import tukey

        f = self.frequencies(len(signals), dt)
        if len(f) < MIN_FREQUENCIES:
            return np.empty((0, signals.shape[1]))
        window = tukey(len(signals), 2.0 * TAPER)
        tapered = detrend(signals, axis=0) * window[:, None]
        found = fourier_transform(tapered, f, dt) * np.sqrt(2.0 / np.sum(window**2))
        return np.concatenate([found.real, found.imag])

    def scatter(self, X: FloatArray, v: FloatArray, dt: float) -> FloatArray:
        """Return the covariance for residuals that are white within the band."""
        return np.asarray(X.T @ X * float(np.mean(v**2)))


def fourier_transform(signals: FloatArray, frequencies: FloatArray, dt: float) -> ComplexArray:
    """Return the finite Fourier transform (f, k) of signals (n, k), a sum over samples, at equally spaced Hz (f,).

    By the chirp z-transform (L. Rabiner et al., IEEE Trans. Audio Electroacoust. 17(2), 1969).
    """
    from scipy.signal import czt

    step = float(frequencies[1] - frequencies[0]) if len(frequencies) > 1 else 0.0
    w, a = np.exp(-2j * np.pi * step * dt), np.exp(2j * np.pi * float(frequencies[0]) * dt)
    return np.asarray(czt(signals, len(frequencies), w, a, axis=0))
