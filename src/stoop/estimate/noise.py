"""The measurement noise covariance by maximum likelihood.

For a given trajectory the likelihood is greatest at R = mean of the residuals' outer products; R then
changes the weights. The search runs with R frozen; afterwards dive and estimate alternate until the
logarithm of det R no longer falls (Klein and Morelli, Aircraft System Identification, 2nd ed., section 6.2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.autocorrelation import lagged_products
from stoop.problem import Misfit, on_circle

FLOOR = 1e-4  #: of a channel's spread: no channel is trusted further than that
SENSOR_FLOOR = 1e-3  #: of the noise that the vehicle file gives a sensor, likewise
FIRST_GUESS = 0.5  #: of a channel's spread: noise before anything is known, so that no channel rules
LONGEST = 2.0  #: s; residuals further apart are taken as independent


def channel_residuals(problem: Misfit, z: FloatArray) -> list[FloatArray]:
    """Return measured minus simulated (n, n_y) of every piece, NaN where nothing was measured."""
    outputs = problem.layout.vehicle.outputs
    return [
        on_circle(piece.measured - problem.outputs(z, i), outputs) for i, piece in enumerate(problem.pieces)
    ]


def noise_variance(problem: Misfit, z: FloatArray) -> FloatArray:
    """Return the maximum-likelihood variance (n_y,) of each channel, kept above a floor."""
    return variance_of(problem, channel_residuals(problem, z))


def variance_of(problem: Misfit, residuals: list[FloatArray]) -> FloatArray:
    """Return the variance (n_y,) of measured minus simulated (n, n_y) of each piece, kept above a floor."""
    errors = np.concatenate(residuals)
    measured = np.concatenate([p.measured for p in problem.pieces])
    sensors, outputs = problem.layout.vehicle.file.sensors, problem.layout.vehicle.outputs
    out = np.ones(errors.shape[1])
    for i, channel in enumerate(outputs):
        seen = np.isfinite(errors[:, i])
        if seen.any():
            spread = FLOOR * float(np.std(measured[seen, i]))
            floor = spread**2 + (SENSOR_FLOOR * getattr(sensors, channel).sigma) ** 2
            out[i] = max(float(np.mean(errors[seen, i] ** 2)), floor)
    return out


def first_variance(problem: Misfit) -> FloatArray:
    """Return a variance (n_y,) to begin with: a share of each channel's spread within its pieces."""
    columns = zip(*(p.measured.T for p in problem.pieces), strict=True)
    return FIRST_GUESS**2 * np.array([_typical_spread(pieces) for pieces in columns])


def _typical_spread(pieces: Sequence[FloatArray]) -> float:
    """Return the median variance of a channel over pieces; one where it was not measured or does not move."""
    spreads = [float(np.var(y[np.isfinite(y)])) for y in pieces if np.isfinite(y).any()]
    return float(np.median(spreads) if spreads else 0.0) or 1.0


def correlation_times(errors: list[FloatArray], dt: float) -> FloatArray:
    """Return how many residuals of each channel say as much as one independent residual (n_y,), at least 1.

    The integrated autocorrelation 1 + 2 sum r_k up to its first zero crossing. A channel whose neighbors
    are uncorrelated within chance counts as white.
    """
    count = errors[0].shape[1]
    return np.array([_correlation_time([e[:, i] for e in errors], round(LONGEST / dt)) for i in range(count)])


def _correlation_time(pieces: list[FloatArray], longest: int) -> float:
    seen = [np.isfinite(piece).astype(float)[:, None] for piece in pieces]
    filled = [np.nan_to_num(piece)[:, None] for piece in pieces]
    sums, counts = lagged_products(filled, seen, longest)
    total, pairs = sums[0], counts[0]
    if pairs[0] < 10 or total[0] <= 0.0:
        return 1.0
    r = (total / np.maximum(pairs, 1.0)) / (total[0] / pairs[0])
    if r[1] < 2.0 / np.sqrt(pairs[0]):
        return 1.0
    negative = np.flatnonzero(r <= 0.0)
    end = int(negative[0]) if negative.size else len(r)
    return max(1.0, 1.0 + 2.0 * float(np.sum(r[1:end])))


def effective_variance(problem: Misfit, z: FloatArray) -> FloatArray:
    """Return the variance (n_y,) with which a channel weighs: its noise times the common correlation time.

    Correlated residuals repeat themselves: counted as independent they would drown the priors. One number,
    the median over the channels, is used for all: the channels' weights among each other stay those of
    maximum likelihood, and a channel that fits badly is not given up for it. For white residuals it is 1.
    """
    return effective_variance_of(problem, channel_residuals(problem, z))


def effective_variance_of(problem: Misfit, errors: list[FloatArray]) -> FloatArray:
    """Return the variance (n_y,) as :func:`effective_variance`, of measured minus simulated (n, n_y) of each piece."""
    seen = [i for i in range(errors[0].shape[1]) if any(np.isfinite(e[:, i]).any() for e in errors)]
    common = float(np.median(correlation_times(errors, problem.pieces[0].dt)[seen]))
    return variance_of(problem, errors) * common
