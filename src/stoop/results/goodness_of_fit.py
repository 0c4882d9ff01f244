"""Goodness of fit of one channel: errors, Theil's coefficient, whiteness; `stoop.assessment` computes them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

NAN: Final = math.nan


@dataclass(frozen=True)
class TheilShares:
    """Where Theil's inequality comes from; the three shares of the squared error add up to 1."""

    bias: float = NAN  #: an offset: the means differ
    variance: float = NAN  #: a wrong amplitude: the standard deviations differ
    covariance: float = NAN  #: what does not correlate: noise, phase, missing physics; ideally all of it


@dataclass(frozen=True)
class Whiteness:
    """Whether residuals are white, by the statistic of Ljung and Box.

    Attributes
    ----------
    autocorrelation : float
        Between neighboring samples (lag 1); NaN where no two are neighbors.
    statistic : float
        Q; chi-square with `lags` degrees of freedom if the residuals are white.
    lags : int
        How many autocorrelations it sums, those of lags that occur; 0 where there are too few residuals.
    p_value : float
        Chance of a statistic as large from white residuals.
    verdict : str
        ``"white"`` (not rejected at 5 %) or ``"colored"``; empty where there is none.
    """

    autocorrelation: float = NAN
    statistic: float = NAN
    lags: int = 0
    p_value: float = NAN
    verdict: str = ""


@dataclass(frozen=True)
class BaselineFit:
    """The figures of the trivial model, a first-order lag; its Theil coefficient is `GoodnessOfFit.baseline_theil`."""

    rmse: float = NAN
    r2: float = NAN
    press: float = NAN
    theil_shares: TheilShares = TheilShares()
    whiteness: Whiteness = Whiteness()


@dataclass(frozen=True)
class GoodnessOfFit:
    """Goodness of fit of one channel in one maneuver.

    Attributes
    ----------
    rmse : float, the channel's unit
        Root mean square of measured minus simulated.
    theil : float
        Theil's inequality coefficient, 0 perfect, 1 worst; channels low-passed at 10 Hz, zero phase.
    r2 : float
        Coefficient of determination; at most 1, negative when the mean of the data does better.
    baseline_theil : float
        The same coefficient of a first-order lag, NaN where no lag applies.
    press : float, the channel's unit
        Root mean square of the residuals had each second of the record been left out of the fit in turn (PRESS
        over the number of samples); NaN where nothing was fitted.
    theil_shares : TheilShares
        Bias, variance and covariance in the squared error of the curves as they are.
    whiteness : Whiteness
        Of the residuals.
    baseline : BaselineFit
        The same figures of the first-order lag.
    """

    rmse: float
    theil: float
    r2: float
    baseline_theil: float = NAN
    press: float = NAN
    theil_shares: TheilShares = TheilShares()
    whiteness: Whiteness = Whiteness()
    baseline: BaselineFit = BaselineFit()

    @property
    def lost(self) -> bool:
        """Whether a first-order lag does as well; not where residuals are white: only noise is left, and chance decides."""
        compared = math.isfinite(self.baseline_theil)
        return compared and not self.theil < self.baseline_theil and self.whiteness.verdict != "white"
