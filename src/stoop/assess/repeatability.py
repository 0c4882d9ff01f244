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
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.stats import chi2

from stoop.results.uncertainty import ParameterRepeatability, SingleEstimate

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


def agreement(singles: Sequence[SingleEstimate]) -> ParameterRepeatability:
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
