r"""Do maneuvers that were fitted alone agree? Weighted mean, and the chi-square of the scatter about it.

With estimates :math:`\theta_i` and standard errors :math:`s_i` of m maneuvers,

.. math:: \bar\theta = \frac{\sum \theta_i / s_i^2}{\sum 1 / s_i^2}, \qquad
          \chi^2 = \sum \frac{(\theta_i - \bar\theta)^2}{s_i^2},

which is chi-square with m - 1 degrees of freedom if the error bars are right. More, and something differs between the
maneuvers that the error bars do not know: the model, the air, the loading.

Estimates that share a prior agree because of it. Each one's own prior is therefore taken out: with f the prior's share
in the estimate, the rest is :math:`(\theta - f \theta_0) / (1 - f)`.

References
----------
R. T. Birge, "The calculation of errors by the method of least squares", *Physical Review* 40, 1932, pp. 207-227 (internal
against external consistency).
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., 2016, chapter 6 (repeated
maneuvers as the test of error bars).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.stats import chi2

from stoop.assess.error_bars import ErrorBars, error_bars
from stoop.errors import StoopError
from stoop.estimate import methods
from stoop.estimate.fit import Fit, Options
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.results.result import Result
from stoop.results.uncertainty import ParameterRepeatability, Repeatability, SingleEstimate

LEVEL: Final = 0.05  #: chance of calling a scatter too large that is not
MOST_PRIOR: Final = 0.5  #: of an estimate: where the prior knows more than the maneuver, it is the prior's


def without_prior(
    estimate: float, std_error: float, share: float, mean: float, prior: float
) -> SingleEstimate:
    """Return an estimate with its own prior taken out.

    Parameters
    ----------
    estimate, std_error : float
        With the prior.
    share : float
        The prior's share in the estimate: its variance in the fit over that of the prior; 0 without one.
    mean, prior : float
        The prior and its standard deviation; not used where the share is 0.
    """
    if not share > 0.0:
        return SingleEstimate(estimate, std_error, math.isfinite(std_error) and std_error > 0.0)
    if share > MOST_PRIOR:
        return SingleEstimate(estimate, std_error, counted=False)
    rest = 1.0 - share
    variance = (std_error**2 - (share * prior) ** 2) / rest**2
    value = (estimate - share * mean) / rest
    return SingleEstimate(value, math.sqrt(max(variance, 0.0)), math.isfinite(variance) and variance > 0.0)


def scatter(singles: Sequence[SingleEstimate]) -> ParameterRepeatability:
    """Return whether the estimates that are counted agree."""
    counted = [one for one in singles if one.counted]
    if not counted:
        return ParameterRepeatability(tuple(singles))
    weights = np.array([one.std_error**-2.0 for one in counted])
    values = np.array([one.estimate for one in counted])
    mean = float(weights @ values / weights.sum())
    error = float(weights.sum() ** -0.5)
    degrees = len(counted) - 1
    if not degrees:
        return ParameterRepeatability(tuple(singles), mean, error)
    square = float(weights @ (values - mean) ** 2)
    p_value = float(chi2.sf(square, degrees))
    verdict = "agree" if p_value >= LEVEL else "scatter"
    return ParameterRepeatability(tuple(singles), mean, error, square, degrees, p_value, verdict)


@dataclass(frozen=True, eq=False)
class SingleFit:
    """Estimates of one maneuver fitted alone; none where it could not be fitted, and why."""

    window: Window
    estimates: dict[str, SingleEstimate]
    remark: str = ""


def fit_each(
    fit: Fit, flights: Mapping[str, Flight], options: Options, watch: Callable[[str], None]
) -> list[SingleFit]:
    """Fit every maneuver of a finished fit by itself.

    The vehicle is as it was given: the same numbers are free, from the same start, within the same bounds and priors.
    What a maneuver does not determine stays at its prior and is not counted. Ctrl-C ends the fit at hand and leaves the
    rest.

    Parameters
    ----------
    fit : Fit
    flights : mapping of str to Flight
    options : Options
    watch : callable
        Receives the maneuver at hand.
    """
    out: list[SingleFit] = []
    stopped = False
    for window in fit.prepared.windows:
        watch(f"repeatability: {window}")
        left_out = SingleFit(window, {}, f"{window}: left out, stopped by the user")
        one = left_out if stopped else _fit_alone(fit, flights, options, window)
        stopped = stopped or one is None
        out.append(left_out if one is None else one)
    return out


def with_repeatability(result: Result, singles: Sequence[SingleFit]) -> Result:
    """Return the result with the agreement of its maneuvers."""
    nothing = SingleEstimate(math.nan, math.nan, counted=False)
    parameters = {n: scatter([one.estimates.get(n, nothing) for one in singles]) for n in result.parameters}
    remarks = tuple(one.remark for one in singles if one.remark)
    return replace(result, repeatability=Repeatability(tuple(range(len(singles))), parameters, remarks))


def _fit_alone(fit: Fit, flights: Mapping[str, Flight], options: Options, window: Window) -> SingleFit | None:
    """Return the fit of one window; None where the user stopped it."""
    vehicle, fitter = fit.problem.layout.vehicle, methods.find(options.method).fitter()
    try:
        own = fitter(vehicle, flights, [window], options, None, None)
        bars = error_bars(own)
    except (StoopError, np.linalg.LinAlgError) as error:
        return SingleFit(window, {}, f"{window}: could not be fitted alone: {error}")
    status = own.outcome.status
    if status == "interrupted":
        return None
    confirmed = status in ("converged", "target")
    remark = "" if confirmed else f"{window}: no confirmed optimum: {own.outcome.advice}"
    return SingleFit(window, _estimates(own, bars), remark)


def _estimates(fit: Fit, bars: ErrorBars) -> dict[str, SingleEstimate]:
    """Return the estimates by name, each without its own prior."""
    parameters, shares = fit.problem.layout.parameters, np.zeros(len(fit.z))
    if bars.uncertainty is not None:
        entry = dict(zip(bars.free.tolist(), np.diag(bars.uncertainty.cramer_rao).tolist(), strict=True))
        prior = [np.inf if p.prior is None else p.prior for p in parameters]
        shares = np.nan_to_num([entry.get(i, np.nan) / s**2 for i, s in enumerate(prior)])
    out = {}
    for i, p in enumerate(parameters):
        value, std = fit.estimates[p.name], float(bars.std[i])
        one = without_prior(value, std, float(shares[i]), p.value, p.prior or np.nan)
        counted = one.counted and not bars.at_bound[i] and bars.identifiability[p.name].identifiable
        out[p.name] = replace(one, counted=bool(counted))
    return out
