"""The error bars of a fit by the method that made it, as the result has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from stoop.estimate import methods
from stoop.estimate.fit import Fit, Options
from stoop.estimate.noise import noise_variance
from stoop.workflow.errorbars import ErrorBars


def judged(fit: Fit, options: Options) -> ErrorBars:
    """Return the error bars; on one BLAS thread, as more would round differently."""
    with threadpool_limits(limits=1, user_api="blas"):
        bars: ErrorBars = methods.find(options.method).judge()(fit, residual_color(fit, options))
    return bars


def declined(bars: ErrorBars, reason: str) -> ErrorBars:
    """Return error bars of which none is a confident statement, for one reason; doubts of their own stay."""
    told = {
        n: replace(j, identifiable=False, reason=reason) if j.identifiable else j
        for n, j in bars.judged.items()
    }
    return replace(bars, judged=told)


def residual_color(fit: Fit, options: Options) -> float:
    """Return by how much the weights were reduced for the correlation of the residuals."""
    if options.covariance is not None or fit.noise is not None:
        return 1.0
    return float(np.median(np.diag(fit.problem.weights.covariance) / noise_variance(fit.problem, fit.z)))
