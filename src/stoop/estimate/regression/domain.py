"""Where regressions are done: on filtered samples, or on Fourier coefficients of a band.

A domain is a linear operation on a signal. It is applied to the coefficients and to the terms alike, so it
weighs samples but cannot bias.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray

LONGEST: Final = 2.0  #: s; residuals further apart are taken as independent
SPAN: Final = 0.2  #: s, of the smoothing window
ROWS_PER_WINDOW: Final = 4
TAPER: Final = 0.1  #: share of the record that is faded in and out
FEWEST: Final = 4  #: frequencies below which a stretch says nothing


class Domain(Protocol):
    """A linear operation from samples to rows of a regression."""

    @property
    def holds_constants(self) -> bool:
        """Whether a constant survives the operation."""

    @property
    def sees_color(self) -> bool:
        """Whether error bars follow from the color that residuals show, or take them as white."""

    def rows(self, signals: FloatArray, dt: float) -> FloatArray:
        """Return the rows (m, k) that signals (n, k) give; none where they are too short.

        Parameters
        ----------
        signals : (n, k)
        dt : float, s
        """

    def spread(self, X: FloatArray, v: FloatArray, dt: float) -> FloatArray:
        """Return the covariance (k, k) of X' v for noise of the color that the residuals show.

        Parameters
        ----------
        X : (m, k)
            Rows of one stretch.
        v : (m,)
            Their residuals.
        dt : float, s
        """


@dataclass(frozen=True)
class Time:
    """Samples, smoothed by a window, four a window; residuals are colored, by that and by what the model lacks.

    Attributes
    ----------
    span : float, s
        Length of the Hann window.
    """

    span: float = SPAN
    holds_constants: bool = True
    sees_color: bool = True

    def rows(self, signals: FloatArray, dt: float) -> FloatArray:
        """Return smoothed samples (m, k); in between there is nothing new."""
        from scipy.signal import oaconvolve
        from scipy.signal.windows import hann

        size = 2 * round(0.5 * self.span / dt) + 1
        if len(signals) < 2 * size:
            return np.empty((0, signals.shape[1]))
        window = hann(size + 2)[1:-1]
        smooth = oaconvolve(signals, (window / window.sum())[:, None], mode="valid", axes=0)
        return np.asarray(smooth[:: self._apart(dt)])

    def _apart(self, dt: float) -> int:
        """Return how many samples lie from one row to the next."""
        return max(1, round(self.span / dt / ROWS_PER_WINDOW))

    def spread(self, X: FloatArray, v: FloatArray, dt: float) -> FloatArray:
        """Return the double sum of the rows with the residuals' autocovariance.

        It is read off the residuals up to a lag of 2 s and tapered to zero there, which keeps the result
        positive (W. K. Newey and K. D. West, Econometrica 55(3), 1987).
        """
        lags = min(round(LONGEST / (dt * self._apart(dt))), len(v) // 5)
        size = 2 * len(v)
        sampled = np.fft.irfft(np.abs(np.fft.rfft(v, size)) ** 2)[: lags + 1] / len(v)
        tapered = sampled * (1.0 - np.arange(lags + 1) / (lags + 1.0))
        kernel = np.concatenate([tapered, np.zeros(size - 2 * lags - 1), tapered[:0:-1]])
        spectrum = np.fft.rfft(kernel).real
        X_f = np.fft.rfft(X, size, axis=0)
        colored = np.fft.irfft(spectrum[:, None] * X_f, size, axis=0)[: len(X)]
        product = X.T @ colored
        return np.asarray(0.5 * (product + product.T))


@dataclass(frozen=True)
class Band:
    """Fourier coefficients of a band, real and imaginary parts stacked.

    Trends are taken off first and the ends are faded: a record is no period of anything. Frequencies lie one
    over the record's length apart: closer ones would say the same again. Within the band residuals count
    as white; what lies beyond - rate noise, which a derivative amplifies, vibration, drift - is not looked at.

    Attributes
    ----------
    low, high : float, Hz
        No frequency below one over the length of the record is used, and none that samples do not tell.

    References
    ----------
    E. A. Morelli, "High accuracy evaluation of the finite Fourier transform using sampled data",
    NASA TM-110340, 1997; V. Klein and E. A. Morelli, *Aircraft System Identification*, 2nd ed., chapter 7.
    """

    low: float = 0.1
    high: float = 2.0
    holds_constants: bool = False
    sees_color: bool = False

    def frequencies(self, count: int, dt: float) -> FloatArray:
        """Return the frequencies, Hz, for a record of so many samples."""
        step = 1.0 / (count * dt)
        first, last = (
            max(self.low, step),
            min(self.high, 0.5 / dt - step),
        )  # beyond, the same comes again mirrored
        return np.asarray(first + step * np.arange(max(0, int((last - first) / step + 1e-9) + 1)))

    def rows(self, signals: FloatArray, dt: float) -> FloatArray:
        """Return real and imaginary parts, one below the other, scaled such that noise keeps its variance."""
        from scipy.signal import detrend

        f = self.frequencies(len(signals), dt)
        if len(f) < FEWEST:
            return np.empty((0, signals.shape[1]))
        window = fade(len(signals))
        faded = detrend(signals, axis=0) * window[:, None]
        found = transform(faded, f, dt) * np.sqrt(2.0 / np.sum(window**2))
        return np.concatenate([found.real, found.imag])

    def spread(self, X: FloatArray, v: FloatArray, dt: float) -> FloatArray:
        """Return the covariance for residuals that are white within the band."""
        return np.asarray(X.T @ X * float(np.mean(v**2)))


def fade(count: int) -> FloatArray:
    """Return a window (count,) that fades both ends in and out."""
    from scipy.signal.windows import tukey

    return np.asarray(tukey(count, 2.0 * TAPER))


def transform(signals: FloatArray, frequencies: FloatArray, dt: float) -> NDArray[np.complex128]:
    """Return the finite Fourier transform (f, k) of signals (n, k) by sums over samples.

    Frequencies, Hz, are equally spaced; the chirp z-transform (L. Rabiner et al., IEEE Trans. Audio
    Electroacoust. 17(2), 1969) makes any band of any spacing cost as much as an FFT.
    """
    from scipy.signal import czt

    step = float(frequencies[1] - frequencies[0]) if len(frequencies) > 1 else 0.0
    w, a = np.exp(-2j * np.pi * step * dt), np.exp(2j * np.pi * float(frequencies[0]) * dt)
    return np.asarray(czt(signals, len(frequencies), w, a, axis=0))
