"""Rise of the log-likelihood from one fit to another of the same data, and from the start of a fit to its end."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.stats import chi2

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.estimate.estimate import Estimate
from stoop.estimate.filter_likelihood import SCORING
from stoop.estimate.instability import largest_growth
from stoop.estimate.noise import channel_residuals, common_time
from stoop.problem import Layout, Weights
from stoop.problem.prepare import Prepared
from stoop.vehicle import Vehicle

#: of a fall of the log-likelihood by chance
LEVEL: Final = 1e-3
WORSE: Final = (
    "simulated open loop, its end explains {windows} worse than its start (log-likelihood {fall:.0f} lower): "
    "what is wrong is not a free number; check data, units and what is held, or fit less (--fix) by --method output-error"
)


def log_likelihood_rise(before: Estimate, after: Estimate) -> tuple[float, float]:
    """Return the rise of the log-likelihood and the number of independent readings; correlated residuals count less.

    Where noise differs between maneuvers, each has variances of its own.
    """
    count, deviances = 0.0, []
    alike = not any(piece.relative_noise for fit in (before, after) for piece in fit.weighted_problem.pieces)
    for fit in (before, after):
        several: dict[int, list[FloatArray]] = {}
        for piece, residuals in zip(fit.weighted_problem.pieces, fit.residuals, strict=True):
            own = several.setdefault(0 if alike else piece.maneuver, [])
            own.append(fit.weighted_problem.weights.innovations(residuals))
        joined = [np.concatenate(own) for own in several.values()]
        counts = [np.isfinite(own).sum(axis=0) / before.inflation for own in joined]
        count = float(np.sum(counts))
        filtered = fit.outcome.optimizer == SCORING  # a cost is twice minus the log-likelihood
        deviances.append(fit.cost if filtered else sum(map(deviance, joined, counts)))
    return 0.5 * (deviances[0] - deviances[1]), count


def deviance(residuals: FloatArray, counts: FloatArray) -> float:
    """Return twice minus the log-likelihood of residuals (n, n_y), less constants, each channel's variance estimated.

    `counts` (n_y,) are the independent readings of each channel.
    """
    variance = np.nanmean(residuals[:, counts > 0.0] ** 2, axis=0)
    return float(counts[counts > 0.0] @ np.log(variance))


def penalized_rise(before: Estimate, after: Estimate) -> float:
    """Return the rise of the log-likelihood less Schwarz's penalty."""
    rise, count = log_likelihood_rise(before, after)
    more = after.problem.dimension - before.problem.dimension
    return rise - 0.5 * more * math.log(max(count, 2.0))


def simulated_residuals(fit: Estimate, vehicle: Vehicle, prepared: Prepared) -> list[FloatArray]:
    """Return the residuals (n, n_y) of each piece by a vehicle simulated open loop, its nuisances estimated anew."""
    layout = Layout(vehicle, (), prepared.nuisances(vehicle))
    whole = tuple(len(piece.time) for piece in prepared.pieces)
    weights = Weights(fit.problem.weights.covariance, fit.problem.weights.root)
    problem = replace(fit.problem, layout=layout, pieces=prepared.pieces, weights=weights, ladder=(whole,))
    return channel_residuals(problem, optimize.refine(problem, np.zeros(problem.extra), 0).z)


def rise_from_start(fit: Estimate, prepared: Prepared | None = None) -> float:
    """Return the rise of the log-likelihood of open-loop simulations from the start of a fit to its end.

    Of windows that are `prepared`, those that were fitted when absent. Neighboring residuals repeat themselves: readings count
    over the larger correlation time of both. Infinite where the start cannot be simulated.
    """
    prepared = prepared or fit.prepared
    vehicles = (fit.problem.layout.vehicle, fit.identified_vehicle)
    start, end = (simulated_residuals(fit, vehicle, prepared) for vehicle in vehicles)
    measured = np.isfinite(np.concatenate([p.measured for p in prepared.pieces]))
    if not np.isfinite(np.concatenate(start))[measured].all():
        return math.inf
    if not np.isfinite(np.concatenate(end))[measured].all():
        return -math.inf
    counts = measured.sum(axis=0) / max(common_time(one, fit.problem.pieces[0].dt) for one in (start, end))
    before, after = (deviance(np.concatenate(residuals), counts) for residuals in (start, end))
    return 0.5 * (before - after)


def against_start(fit: Estimate, ahead: Prepared | None = None) -> Estimate:
    """Return the estimate, its search not confirmed where the start explains the fitted windows, or those `ahead`, better.

    Twice a fall of the log-likelihood by chance has the chi-square distribution, with as many degrees of freedom as there are
    free numbers. A filter or short windows fit other residuals, weights change with the noise, and refits begin anew: what
    each of them lowers is not this. Nothing is said where errors of the state grow too much for open-loop simulations.
    """
    if fit.outcome.status != "converged" or largest_growth(fit.problem, fit.z).excessive:
        return fit
    judged = {"the fitted windows": fit.prepared} | ({"the windows held back": ahead} if ahead else {})
    for windows, prepared in judged.items():
        fall = -rise_from_start(fit, prepared)
        if 2.0 * fall > chi2.isf(LEVEL, fit.problem.dimension):
            advice = WORSE.format(windows=windows, fall=fall)
            return replace(fit, outcome=replace(fit.outcome, status="stalled", advice=advice))
    return fit
