"""Figures of merit of a simulated curve against a measured one.

References
----------
H. Theil, *Economic Forecasts and Policy*, 2nd ed., North-Holland, 1961 (the coefficient and its parts).
R. V. Jategaonkar, *Flight Vehicle System Identification: A Time-Domain Methodology*, 2nd ed., AIAA, 2015,
chapter 11 (the coefficient as the field uses it; 0.25 to 0.3 is commonly taken as good agreement).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.assess.runs import low_pass
from stoop.assess.whiteness import whiteness
from stoop.base.arrays import FloatArray
from stoop.results.goodness_of_fit import BaselineFit, GoodnessOfFit, TheilShares

NAN: Final = float("nan")


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
        Residuals had their part of the record been left out, see `stoop.assess.press`; None where nothing was
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
