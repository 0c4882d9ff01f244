"""Goodness of fit: figures of merit of a simulated curve against a measured one, and the whiteness of its residuals.

Whiteness is tested by the portmanteau statistic of Ljung and Box, over segments with holes,

    Q = n (n + 2) sum_k r_k^2 / (n - k),  k = 1 ... m,

chi-square with m degrees of freedom for white residuals. Where the record has holes, n - k is the number of
pairs that are there; a lag without any, as between the samples of a slow sensor, is no degree of freedom. The mean is
not taken off: an offset that is left over is not white. A model that leaves colored residuals has not explained
everything, and its plain Cramer-Rao bound is too small.

References
----------
H. Theil, *Economic Forecasts and Policy*, 2nd ed., North-Holland, 1961 (the coefficient and its parts).
R. V. Jategaonkar, *Flight Vehicle System Identification: A Time-Domain Methodology*, 2nd ed., AIAA, 2015,
chapter 11 (the coefficient as the field uses it; 0.25 to 0.3 is commonly taken as good agreement).
G. M. Ljung and G. E. P. Box, "On a measure of lack of fit in time series models", *Biometrika* 65(2), 1978,
pp. 297-303, eq. (1.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import butter, sosfiltfilt
from scipy.stats import chi2

from stoop.base.arrays import FloatArray, runs
from stoop.estimate.noise import lagged_products
from stoop.results.result import BaselineFit, GoodnessOfFit, TheilShares, Whiteness

NAN: Final = float("nan")
WHITENESS_LAGS: Final = (
    20  #: autocorrelations that are summed: 0.2 s at 100 Hz, the fastest motion that a model explains
)
SAMPLES_PER_LAG: Final = 5  #: samples for each of them at least
WHITENESS_LEVEL: Final = 0.05  #: chance of calling white residuals colored
CUTOFF: Final = 10.0  #: Hz; above it there is no rigid-body motion worth matching, only vibration
FILTER_ORDER: Final = 4  #: of the Butterworth filter, which runs forward and backward


@dataclass(frozen=True)
class TheilParts:
    """Where the inequality comes from; the three shares add up to 1 (NaN for a perfect match).

    Attributes
    ----------
    coefficient : float
        rms(z - y) / (rms(z) + rms(y)); 0 perfect, 1 worst.
    bias : float
        Share of the difference of the means: an offset.
    variance : float
        Share of the difference of the standard deviations: a wrong amplitude.
    covariance : float
        Share of what does not correlate: noise, phase, missing physics; ideally all of it.
    """

    coefficient: float
    bias: float
    variance: float
    covariance: float


def theil(measured: FloatArray, simulated: FloatArray) -> float:
    """Return Theil's inequality coefficient over the samples (n,) where both are finite; NaN without any.

    Unlike the coefficient of determination it is bounded, and an output that hardly moves does not blow it
    up; but it depends on the origin: an angle far from zero looks better than it is.
    """
    z, y = _common(measured, simulated)
    scale = _rms(z) + _rms(y)
    if z.size == 0:
        return NAN
    return _rms(z - y) / scale if scale > 0.0 else 0.0


def theil_parts(measured: FloatArray, simulated: FloatArray) -> TheilParts:
    """Return Theil's coefficient with the shares of bias, variance and covariance in the squared error."""
    z, y = _common(measured, simulated)
    error = _rms(z - y)
    if error == 0.0:
        return TheilParts(theil(measured, simulated), NAN, NAN, NAN)
    bias = (float(np.mean(z / error)) - float(np.mean(y / error))) ** 2
    variance = (float(np.std(z / error)) - float(np.std(y / error))) ** 2
    return TheilParts(theil(measured, simulated), bias, variance, max(0.0, 1.0 - bias - variance))


def rmse(measured: FloatArray, simulated: FloatArray) -> float:
    """Return the root mean square of the difference where both are finite; NaN without any sample."""
    z, y = _common(measured, simulated)
    return _rms(z - y) if z.size else NAN


def r2(measured: FloatArray, simulated: FloatArray) -> float:
    """Return the coefficient of determination; negative when the mean of the data does better.

    NaN without samples, or when the measured curve does not vary.
    """
    z, y = _common(measured, simulated)
    spread = _rms(z - np.mean(z)) if z.size else 0.0
    left = _rms(z - y) / spread if spread > 0.0 else NAN
    return 1.0 - left * left


@dataclass(frozen=True, eq=False)
class Match:
    """What one model makes of one channel of one maneuver.

    Attributes
    ----------
    simulated : (n,), the channel's unit
        Uniform samples; NaN between segments.
    left_out : (n,), the channel's unit, optional
        Residuals had their part of the record been left out, see `stoop.assessment.press`; None where nothing was
        fitted.
    """

    simulated: FloatArray
    left_out: FloatArray | None = None


def channel_figures(
    measured: FloatArray, model: Match, rate: float, baseline: Match | None = None
) -> GoodnessOfFit:
    """Return the figures of one channel of one maneuver.

    Parameters
    ----------
    measured : (n,), the channel's unit
        Uniform samples; NaN where there is none and between segments. An angle that wraps must be unwrapped as in
        the simulated curve.
    model : Match
    rate : float, Hz
        Sample rate.
    baseline : Match, optional
        The trivial model's.

    Returns
    -------
    GoodnessOfFit
        Theil's coefficients of the curves low-passed at 10 Hz with zero phase, stretch by stretch; all else of the
        curves as they are.
    """
    return GoodnessOfFit(
        rmse=rmse(measured, model.simulated),
        theil=filtered_theil(measured, model.simulated, rate),
        r2=r2(measured, model.simulated),
        baseline_theil=NAN if baseline is None else filtered_theil(measured, baseline.simulated, rate),
        press=_press(model),
        theil_shares=_shares(measured, model),
        whiteness=whiteness(measured - model.simulated),
        baseline=BaselineFit() if baseline is None else _baseline_figures(measured, baseline),
    )


def _baseline_figures(measured: FloatArray, baseline: Match) -> BaselineFit:
    return BaselineFit(
        rmse=rmse(measured, baseline.simulated),
        r2=r2(measured, baseline.simulated),
        press=_press(baseline),
        theil_shares=_shares(measured, baseline),
        whiteness=whiteness(measured - baseline.simulated),
    )


def _shares(measured: FloatArray, match: Match) -> TheilShares:
    parts = theil_parts(measured, match.simulated)
    return TheilShares(parts.bias, parts.variance, parts.covariance)


def _press(match: Match) -> float:
    """Return the root mean square of the left-out residuals; NaN where nothing was fitted."""
    there = np.isfinite(match.left_out) if match.left_out is not None else np.zeros(0, dtype=bool)
    return _rms(match.left_out[there]) if match.left_out is not None and there.any() else NAN


def filtered_theil(measured: FloatArray, simulated: FloatArray, rate: float) -> float:
    """Return Theil's coefficient of both curves low-passed over the stretches that they share."""
    z, y = shared_stretches(measured, simulated)
    return theil(low_pass(z, rate), low_pass(y, rate))


def shared_stretches(measured: FloatArray, simulated: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both curves (n,) with NaN wherever either has one, so that a filter treats them alike."""
    missing = ~(np.isfinite(measured) & np.isfinite(simulated))
    return np.where(missing, np.nan, measured), np.where(missing, np.nan, simulated)


def _common(measured: FloatArray, simulated: FloatArray) -> tuple[FloatArray, FloatArray]:
    both = np.isfinite(measured) & np.isfinite(simulated)
    return measured[both], simulated[both]


def _rms(values: FloatArray) -> float:
    # In parts of the greatest value: a diverged simulation may not overflow, its coefficient is 1.
    peak = float(np.max(np.abs(values), initial=0.0))
    return peak * float(np.sqrt(np.mean((values / peak) ** 2))) if peak > 0.0 else 0.0


def whiteness(residual: FloatArray) -> Whiteness:
    """Test the residuals (n,) of one channel; NaN where missing and between segments."""
    lags = min(WHITENESS_LAGS, int(np.isfinite(residual).sum()) // SAMPLES_PER_LAG)
    if lags < 1:
        return Whiteness()
    r, pairs = _autocorrelation(residual, lags)
    if not np.isfinite(r).all():
        return Whiteness()
    degrees = int(np.count_nonzero(pairs[1:]))
    if not degrees:
        return Whiteness()
    statistic = ljung_box(r, pairs)
    p_value = float(chi2.sf(statistic, degrees))
    neighbors = float(r[1]) if pairs[1] > 0.0 else float("nan")
    return Whiteness(
        neighbors, statistic, degrees, p_value, "white" if p_value >= WHITENESS_LEVEL else "colored"
    )


def ljung_box(r: FloatArray, pairs: FloatArray) -> float:
    """Return Q of autocorrelations (m + 1,), the first at lag 0, and the numbers of their pairs (m + 1,)."""
    n = float(pairs[0])
    there = pairs[1:] > 0.0
    return n * (n + 2.0) * float(np.sum(r[1:][there] ** 2 / pairs[1:][there]))


def _autocorrelation(residual: FloatArray, lags: int) -> tuple[FloatArray, FloatArray]:
    """Return r_k and the number of its pairs, (lags + 1,) each; segments that a NaN parts still have their time."""
    filled: Sequence[FloatArray] = [np.nan_to_num(_scaled(residual))[:, None]]
    present: Sequence[FloatArray] = [np.isfinite(residual).astype(np.float64)[:, None]]
    sums, pairs = lagged_products(filled, present, lags)
    power = float(sums[0, 0])
    return (sums[0] / power if power > 0.0 else np.full(lags + 1, np.nan)), pairs[0]


def _scaled(residual: FloatArray) -> FloatArray:
    # In parts of the greatest: a simulation that left for infinity may not overflow its square.
    peak = float(np.nanmax(np.abs(residual)))
    return residual / peak if 0.0 < peak < np.inf else residual


def join(pieces: Sequence[ArrayLike]) -> FloatArray:
    """Return the pieces (n_i,) as one curve, a NaN between neighbors, so that a plot breaks there."""
    parts: list[FloatArray] = []
    for piece in pieces:
        parts += [np.full(1, np.nan), np.asarray(piece, dtype=np.float64)]
    return np.concatenate(parts[1:]) if parts else np.empty(0)


def low_pass(values: FloatArray, rate: float, cutoff: float = CUTOFF) -> FloatArray:
    """Return `values` (n,) without what lies above `cutoff`, without phase shift, each stretch for itself.

    Parameters
    ----------
    values : (n,)
        Uniform samples; NaN separates the stretches and stays.
    rate : float, Hz
        Sample rate. At or below twice the cutoff there is nothing to remove.
    cutoff : float, Hz
        Where the two passes together have lost 6 dB.
    """
    filtered = np.array(values, dtype=np.float64)
    if rate <= 2.0 * cutoff:
        return filtered
    sections = butter(FILTER_ORDER, cutoff, fs=rate, output="sos")
    natural = 3 * (2 * len(sections) + 1)
    for start, stop in runs(np.isfinite(filtered)).tolist():
        # The filter starts on a reflection of the data; a stretch shorter than that reflects what it has.
        padding = min(natural, stop - start - 1)
        filtered[start:stop] = sosfiltfilt(sections, filtered[start:stop], padlen=padding)
    return filtered
