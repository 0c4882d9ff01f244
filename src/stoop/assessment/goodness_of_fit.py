r"""Goodness of fit: Theil's coefficient, R2, PRESS, and the whiteness of residuals.

The portmanteau statistic of Ljung and Box, Q = n (n + 2) sum_k r_k^2 / (n - k) for k = 1 ... m, is chi-square with m degrees of
freedom for white residuals. With holes, n - k is the number of pairs, and a lag without any is no degree of freedom. The mean is
not taken off: an offset is not white.

PRESS, the prediction error sum of squares, leaves each part of the data out in turn and predicts it from the rest. With the
whitened residuals e, sensitivities J and information M = J'J + priors, leaving the samples B out changes their residuals to

.. math:: e_{(B)} = e_B + J_B (M - J_B' J_B)^{-1} J_B' e_B = (I - H_{BB})^{-1} e_B, \qquad H = J M^{-1} J'.

Of single samples this is Allen's e / (1 - h). Neighbors share noise: blocks of one second, all channels together, are left out
(Burman, Chow and Nolan). Initial states, like inputs, are given.

References
----------
H. Theil, *Economic Forecasts and Policy*, 2nd ed., North-Holland, 1961 (the coefficient and its parts).
R. V. Jategaonkar, *Flight Vehicle System Identification: A Time-Domain Methodology*, 2nd ed., AIAA, 2015,
chapter 11 (the coefficient as the field uses it; 0.25 to 0.3 is commonly taken as good agreement).
G. M. Ljung and G. E. P. Box, "On a measure of lack of fit in time series models", *Biometrika* 65(2), 1978,
pp. 297-303, eq. (1.2).
D. M. Allen, "The relationship between variable selection and data augmentation and a method for prediction",
*Technometrics* 16(1), 1974, pp. 125-127.
P. Burman, E. Chow and D. Nolan, "A cross-validatory method for dependent data", *Biometrika* 81(2), 1994, pp. 351-358.
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., 2016, chapter 5 (PRESS).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lstsq
from scipy.signal import butter, sosfiltfilt
from scipy.stats import chi2

from stoop.assessment.covariance import NORMAL_95, data_information
from stoop.base.arrays import FloatArray, runs
from stoop.base.notices import Notice, notice
from stoop.base.robust import robust_std
from stoop.estimate.estimate import Estimate
from stoop.estimate.noise import lagged_products
from stoop.results.result import BaselineFit, GoodnessOfFit, InnovationFigures, TheilShares, Whiteness

WHITENESS_LAGS: Final = 20  #: that are summed: 0.2 s at 100 Hz, the fastest motion that a model explains
SAMPLES_PER_LAG: Final = 5  #: samples for each of them at least
WHITENESS_LEVEL: Final = 0.05  #: chance of calling white residuals colored
OUTLIER: Final = 8.0  #: standard deviations by the median; Gaussian residuals have none beyond
CUTOFF: Final = 10.0  #: Hz; above it there is no rigid-body motion worth matching, only vibration
#: in place of a reading that a simulation did not reach: it counts as an error, not as missing
DIVERGED: Final = 1e100
BLOCK: Final = 1.0  #: s that are left out together
NAN: Final = math.nan


def theil(measured: FloatArray, simulated: FloatArray, rate: float | None = None) -> float:
    """Return Theil's coefficient rms(z - y) / (rms(z) + rms(y)) where both are finite, 0 perfect, 1 worst; NaN without any.

    With a sample `rate`, Hz, of both curves low-passed over the stretches that they share.
    """
    if rate is not None:
        both, curves = np.isfinite(measured) & np.isfinite(simulated), (measured, simulated)
        measured, simulated = (low_pass(np.where(both, curve, np.nan), rate) for curve in curves)
    z, y = _common(measured, simulated)
    scale = _rms(z) + _rms(y)
    return np.nan if z.size == 0 else _rms(z - y) / scale if scale > 0.0 else 0.0


def theil_shares(measured: FloatArray, simulated: FloatArray) -> TheilShares:
    """Return the shares of bias, variance and covariance in the squared error; NaN for a perfect match.

    An offset, a wrong amplitude, and what does not correlate (noise, phase, missing physics), ideally all of it.
    """
    z, y = _common(measured, simulated)
    error = _rms(z - y)
    if error == 0.0:
        return TheilShares()
    bias = (float(np.mean(z / error)) - float(np.mean(y / error))) ** 2
    variance = (float(np.std(z / error)) - float(np.std(y / error))) ** 2
    return TheilShares(bias, variance, max(0.0, 1.0 - bias - variance))


def rmse(measured: FloatArray, simulated: FloatArray) -> float:
    """Return the root mean square of the difference where both are finite; NaN without any sample."""
    z, y = _common(measured, simulated)
    return _rms(z - y) if z.size else NAN


def r2(measured: FloatArray, simulated: FloatArray) -> float:
    """Return the coefficient of determination; NaN without samples, or when the measured curve does not vary."""
    z, y = _common(measured, simulated)
    spread = _rms(z - np.mean(z)) if z.size else 0.0
    left = _rms(z - y) / spread if spread > 0.0 else np.nan
    return 1.0 - left * left


def _common(measured: FloatArray, simulated: FloatArray) -> tuple[FloatArray, FloatArray]:
    both = np.isfinite(measured) & np.isfinite(simulated)
    return measured[both], simulated[both]


def _rms(values: FloatArray) -> float:
    # In parts of the greatest value: a diverged simulation may not overflow, its coefficient is 1.
    peak = float(np.max(np.abs(values), initial=0.0))
    return peak * float(np.sqrt(np.mean((values / peak) ** 2))) if peak > 0.0 else 0.0


def _rms_of_known(values: FloatArray) -> float:
    """Return the rms of the values that are known; NaN without any."""
    known = values[np.isfinite(values)]
    return _rms(known) if known.size else NAN


@dataclass(frozen=True, eq=False)
class Match:
    """What one model makes of one channel of one maneuver."""

    simulated: FloatArray  #: (n,), the channel's unit; uniform samples; NaN between segments
    left_out: FloatArray | None = None  #: (n,), residuals by :func:`left_out`; None where nothing was fitted


def unexplained(curves: Sequence[tuple[FloatArray, FloatArray]], rate: float) -> float:
    """Return the rms of measured minus simulated curves (n_i,), below 10 Hz, over all of them; NaN without any sample."""
    return _rms_of_known(np.concatenate([low_pass(z - y, rate) for z, y in curves]))


def noise_floor(
    measured: FloatArray, rate: float, sigma: float, left: float = NAN, deviation: FloatArray | None = None
) -> tuple[float, float]:
    """Return the noise of a channel (n,) below 10 Hz, in its unit, and the rms of its motion over that noise.

    White noise is at most `sigma`, what the fit leaves, and at most the record's own, by its third differences: those of smooth
    motion vanish, those of white noise have 1 + 9 + 9 + 1 = 20 times its variance. Slow errors of the sensors, gusts and
    vibration are noise, too: `left`, what the better of model and lag leaves :func:`unexplained` in the fitted maneuvers. So is
    the uncertainty of a prediction: its `deviation` (n,) without the fit's noise. The motion is about its mean, without noise.
    """
    own = _rms_of_known(np.diff(measured, 3)) / math.sqrt(20.0)
    white = float(np.fmin(sigma, own)) * math.sqrt(min(1.0, 2.0 * CUTOFF / rate))
    unknown = np.empty(0) if deviation is None else deviation[np.isfinite(deviation)] ** 2 - sigma**2
    ahead = math.sqrt(max(float(np.mean(unknown)), 0.0)) if unknown.size else 0.0
    noise = math.hypot(np.fmax(white, left), ahead)
    motion = math.sqrt(max(float(np.nanvar(low_pass(measured, rate))) - noise**2, 0.0))
    return noise, motion / noise if noise > 0.0 else math.inf if motion > 0.0 else NAN


def channel_figures(
    measured: FloatArray,
    model: Match,
    rate: float,
    baseline: Match | None = None,
    sigma: float = NAN,
    deviation: FloatArray | None = None,
    innovations: FloatArray | None = None,
    left: float = NAN,
) -> GoodnessOfFit:
    """Return the figures of one channel of one maneuver, beside those of the trivial model where there is one.

    `measured` (n,), the channel's unit, are samples at `rate`, Hz, NaN where there is none and between segments; an angle
    that wraps is unwrapped as in the simulated curve. Theil's coefficients are of the curves low-passed at 10 Hz with zero
    phase, stretch by stretch; all else of the curves as they are. `sigma` is the standard deviation of the noise that the fit
    leaves, `deviation` (n,) that of a prediction, noise included; `innovations` (n,) are over their standard deviation;
    `left` is that of :func:`noise_floor`. A reading that the simulation did not reach is an error.
    """
    gone = np.isfinite(measured) & ~np.isfinite(model.simulated)
    model = replace(model, simulated=np.where(gone, DIVERGED, model.simulated))
    noise, ratio = noise_floor(measured, rate, sigma, left, deviation)
    shared = _shared_figures(measured, model)
    found = GoodnessOfFit(
        theil=theil(measured, model.simulated, rate),
        **shared,
        fit_percent=100.0 * (1.0 - math.sqrt(1.0 - shared["r2"])),
        noise=noise,
        signal_to_noise=ratio,
        inside=NAN if deviation is None else inside_band(measured - model.simulated, deviation),
    )
    if innovations is not None:
        inside = inside_band(innovations, np.ones_like(innovations))
        expected = InnovationFigures(_rms_of_known(innovations), inside, whiteness(innovations))
        found = replace(found, innovations=expected)
    if baseline is None:
        return found
    lag = theil(measured, baseline.simulated, rate)
    return replace(found, baseline_theil=lag, baseline=BaselineFit(**_shared_figures(measured, baseline)))


def _shared_figures(measured: FloatArray, match: Match) -> dict[str, Any]:
    """Return the figures that the model and the baseline have alike."""
    simulated, press = match.simulated, NAN if match.left_out is None else _rms_of_known(match.left_out)
    found = {"rmse": rmse(measured, simulated), "r2": r2(measured, simulated), "press": press}
    shares = theil_shares(measured, simulated)
    return found | {"theil_shares": shares, "whiteness": whiteness(measured - simulated)}


def inside_band(residual: FloatArray, deviation: FloatArray) -> float:
    """Return the share of residuals (n,) within their 95 % band; NaN without any."""
    there = np.isfinite(residual) & np.isfinite(deviation)
    within = np.abs(residual[there]) <= NORMAL_95 * deviation[there]
    return float(np.mean(within)) if there.any() else NAN


def whiteness(residual: FloatArray) -> Whiteness:
    """Test the residuals (n,) of one channel; NaN where missing and between segments, which still have their time."""
    present = np.isfinite(residual)
    lags = min(WHITENESS_LAGS, int(present.sum()) // SAMPLES_PER_LAG)
    if lags < 1:
        return Whiteness()
    # A simulation that left for infinity is all in its last samples, which correlate with nothing: limited, they show it.
    limit = OUTLIER * robust_std(residual[present])
    limited = np.clip(residual, -limit, limit) if limit > 0.0 else residual
    peak = float(np.max(np.abs(limited[present])))
    scaled = np.nan_to_num(limited / peak if peak > 0.0 else limited)
    sums, pairs = lagged_products([scaled[:, None]], [present.astype(np.float64)[:, None]], lags)
    power, n, counts = float(sums[0, 0]), float(pairs[0, 0]), pairs[0, 1:]
    seen = counts > 0.0
    degrees = int(np.count_nonzero(seen))
    if not power > 0.0 or not np.isfinite(sums).all() or not degrees:
        return Whiteness()
    r = sums[0, 1:] / power
    statistic = n * (n + 2.0) * float(np.sum(r[seen] ** 2 / counts[seen]))
    p_value = float(chi2.sf(statistic, degrees))
    verdict = "white" if p_value >= WHITENESS_LEVEL else "colored"
    return Whiteness(float(r[0]) if seen[0] else np.nan, statistic, degrees, p_value, verdict)


def join(pieces: Sequence[ArrayLike]) -> FloatArray:
    """Return the pieces (n_i,) as one curve, a NaN between neighbors, so that a plot breaks there."""
    parts = [part for piece in pieces for part in ([np.nan], piece)]
    return np.concatenate(parts[1:], dtype=np.float64) if parts else np.empty(0)


def low_pass(values: FloatArray, rate: float, cutoff: float = CUTOFF) -> FloatArray:
    """Return `values` (n,) sampled at `rate`, Hz, without what lies above `cutoff`, Hz, without phase shift.

    Each stretch between NaN for itself. At the cutoff the two passes together have lost 6 dB.
    """
    filtered = np.array(values, dtype=np.float64)
    if rate <= 2.0 * cutoff:
        return filtered
    sections = butter(4, cutoff, fs=rate, output="sos")
    natural = 3 * (2 * len(sections) + 1)
    for start, stop in runs(np.isfinite(filtered)).tolist():
        # The filter starts on a reflection of the data; a stretch shorter than that reflects what it has.
        padding = min(natural, stop - start - 1)
        filtered[start:stop] = sosfiltfilt(sections, filtered[start:stop], padlen=padding)
    return filtered


def left_out(residual: FloatArray, jacobian: FloatArray, information: FloatArray, block: int) -> FloatArray:
    """Return the residuals (n, ny) as they would be without their `block` of samples.

    `residual` (n, ny) is whitened measured minus simulated, NaN where nothing was measured, `jacobian` (n, ny, k) that of the
    simulated readings, `information` (k, k) of the whole fit: all segments and the priors.
    """
    out = residual.copy()
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    for first in range(0, len(residual), block):
        part = slice(first, first + block)
        seen = np.isfinite(residual[part])
        e, J = residual[part][seen], jacobian[part][seen]
        if J.any():
            rest = (information - J.T @ J) * np.outer(scale, scale)
            # What only these samples know is not determined by the rest: it stays where it is (minimum norm).
            d = scale * lstsq(rest, scale * (J.T @ e), cond=1e-12, check_finite=False)[0]
            out[part][seen] = e + J @ d
    return np.where(np.isfinite(residual), out, np.nan)


def left_out_residuals(fit: Estimate) -> list[FloatArray] | None:
    """Return measured minus simulated (n, n_y) of every piece, each second left out of the fit in turn; channel units.

    NaN where nothing was measured. None for a regression, or where the fit cannot be differentiated.
    """
    problem = fit.refit_problem
    if problem.equations:
        return None
    evidence, d = fit.evidence, fit.problem.dimension
    if not all(np.isfinite(values).all() for p in evidence.pieces for values in p.filled()):
        return None
    biases = (d + i for i, n in enumerate(fit.problem.layout.nuisances) if n.is_bias)
    lasting = np.array([*range(d), *biases], dtype=np.intp)
    own = [piece.of(lasting) for piece in evidence.pieces]
    information = data_information(own) + evidence.prior[np.ix_(lasting, lasting)]
    pairs = zip(own, fit.problem.pieces, strict=True)
    missed = [left_out(e.residual, e.jacobian, information, round(BLOCK / p.dt)) for e, p in pairs]
    present = [np.isfinite(w) for w in missed]
    white = [np.where(seen, w, 0.0) for w, seen in zip(missed, present, strict=True)]
    return [np.where(seen, u, np.nan) for seen, u in zip(present, problem.in_units(white), strict=True)]


def press_notices(fit: Estimate) -> list[Notice]:
    """Return the errors of each equation of a regression, each second left out of the fit in turn; none of other methods.

    Of Fourier coefficients each is left out. A mean that gave a constant predicts nothing.
    """
    problem = fit.refit_problem
    if not problem.equations:
        return []
    free, block = fit.evidence.free, max(1, round(BLOCK / problem.spacing))
    own = [stretch.of(free) for stretch in fit.evidence.pieces]
    information = data_information(own) + fit.evidence.prior[np.ix_(free, free)]
    own = [stretch for stretch in own if len(stretch.residual) > 1]
    errors = [left_out(stretch.residual, stretch.jacobian, information, block) for stretch in own]
    both = (problem.in_units(e) for e in ([stretch.residual for stretch in own], errors))
    rms, press = (np.sqrt(np.mean(np.concatenate(e) ** 2, axis=0)).tolist() for e in both)
    code = "regression-press" if np.isfinite(problem.spacing) else "regression-press-band"
    return [notice(code, "", equations=problem.equations, rms=tuple(rms), press=tuple(press))]
