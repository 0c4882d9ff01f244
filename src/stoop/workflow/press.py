"""PRESS of an output-error fit: the residuals of every piece, each second of it left out of the fit in turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stoop.assess.press import BLOCK, left_out
from stoop.base.arrays import FloatArray
from stoop.estimate.fit import Fit


def left_out_residuals(fit: Fit) -> list[FloatArray] | None:
    """Return measured minus simulated (n, n_y) of every piece, the channels' units; NaN where nothing was measured.

    None where the estimates do not rest on the residuals of a simulation, or the fit cannot be differentiated.
    """
    if fit.own_evidence is not None or fit.covariance is not None:
        return None
    problem = fit.problem
    rung = len(problem.prices) - 1
    r = problem.residuals(fit.z[None, :], rung)[0]
    J, _ = problem.jacobian(fit.z, rung, r)
    if not (np.isfinite(r).all() and np.isfinite(J).all()):
        return None
    J = J[:, _lasting(fit)]
    information, first, out = J.T @ J, 0, []
    for piece in problem.pieces:
        rows = slice(first, first + piece.measured.size)
        seen = np.isfinite(piece.measured)
        whitened = np.where(seen, -r[rows].reshape(seen.shape), np.nan)
        block = round(BLOCK / piece.dt)
        missed = left_out(whitened, J[rows].reshape(*seen.shape, -1), information, block)
        colored = problem.weights.colored(np.where(seen, missed, 0.0), seen)
        out.append(np.where(seen, colored, np.nan))
        first = rows.stop
    return out


def _lasting(fit: Fit) -> NDArray[np.intp]:
    """Return the unknowns that are not initial states."""
    nuisances = fit.problem.layout.nuisances
    biases = [fit.problem.dimension + i for i, n in enumerate(nuisances) if n.is_bias]
    return np.array([*range(fit.problem.dimension), *biases], dtype=np.intp)
