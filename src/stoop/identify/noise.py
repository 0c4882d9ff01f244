"""The measurement noise covariance by maximum likelihood.

For a given trajectory the likelihood is greatest at R = mean of the residuals' outer products; R then
changes the weights. The search runs with R frozen; afterwards dive and estimate alternate until the
logarithm of det R no longer falls (Klein and Morelli, Aircraft System Identification, 2nd ed., section 6.2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stoop.cost import Misfit

FloatArray = NDArray[np.float64]
FLOOR = 1e-4  #: of a channel's spread: no channel is trusted further than that


def channel_residuals(problem: Misfit, z: FloatArray) -> list[FloatArray]:
    """Return measured minus simulated (n, n_y) of every piece, NaN where nothing was measured."""
    out = []
    for i, piece in enumerate(problem.pieces):
        error = piece.measured - problem.outputs(z, i)
        for j, channel in enumerate(problem.layout.vehicle.outputs):
            if channel in ("phi", "psi"):
                error[:, j] -= 2.0 * np.pi * np.round(error[:, j] / (2.0 * np.pi))
        out.append(error)
    return out


def noise_variance(problem: Misfit, z: FloatArray) -> FloatArray:
    """Return the maximum-likelihood variance (n_y,) of each channel, kept above a floor."""
    errors = np.concatenate(channel_residuals(problem, z))
    measured = np.concatenate([p.measured for p in problem.pieces])
    out = np.empty(errors.shape[1])
    for i in range(errors.shape[1]):
        seen = np.isfinite(errors[:, i])
        floor = (FLOOR * float(np.std(measured[seen, i]))) ** 2 + 1e-20 if seen.any() else 1.0
        out[i] = max(float(np.mean(errors[seen, i] ** 2)), floor) if seen.any() else 1.0
    return out
