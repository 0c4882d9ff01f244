"""Rise of the log-likelihood from one fit to another of the same data."""

from __future__ import annotations

import math

import numpy as np

from stoop.estimate.estimate import Estimate
from stoop.estimate.filter_likelihood import SCORING


def log_likelihood_rise(before: Estimate, after: Estimate) -> tuple[float, float]:
    """Return the rise of the log-likelihood and the number of independent readings; correlated residuals count less."""
    count, deviances = 0.0, []
    for fit in (before, after):
        residuals = np.concatenate(fit.residuals)
        counts = np.isfinite(residuals).sum(axis=0) / before.inflation
        count = float(counts.sum())
        variance = np.nanmean(residuals[:, counts > 0.0] ** 2, axis=0)
        filtered = fit.outcome.optimizer == SCORING  # a cost is twice minus the log-likelihood
        deviances.append(fit.cost if filtered else float(counts[counts > 0.0] @ np.log(variance)))
    return 0.5 * (deviances[0] - deviances[1]), count


def penalized_rise(before: Estimate, after: Estimate) -> float:
    """Return the rise of the log-likelihood less Schwarz's penalty."""
    rise, count = log_likelihood_rise(before, after)
    more = after.problem.dimension - before.problem.dimension
    return rise - 0.5 * more * math.log(max(count, 2.0))
