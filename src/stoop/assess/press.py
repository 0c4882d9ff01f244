r"""PRESS: what the residuals would be, had their part of the record been left out of the fit.

A model with many parameters matches what it was fitted to, noise included. PRESS, the prediction error sum of
squares, leaves each part of the data out in turn and predicts it from the rest. For a fit that is linear in the
unknowns about its optimum nothing needs to be fitted again: with the whitened residuals e, sensitivities J and
information M = J'J + priors, leaving the samples B out moves the unknowns by
:math:`d = (M - J_B' J_B)^{-1} J_B' e_B` and their residuals to

.. math:: e_{(B)} = e_B + J_B d = (I - H_{BB})^{-1} e_B, \qquad H = J M^{-1} J'.

For single samples this is Allen's e / (1 - h). Residuals of real flights are correlated: the neighbors of a left-out
sample have its noise too, and single samples would flatter. Blocks of one second, all channels of the maneuver
together, are left out instead (Burman, Chow and Nolan).

Initial states are not among the unknowns: like the inputs they are given. Only the beginning of a segment knows
them, and to find them from what follows would be to run the clock backwards.

References
----------
D. M. Allen, "The relationship between variable selection and data augmentation and a method for prediction",
*Technometrics* 16(1), 1974, pp. 125-127.
P. Burman, E. Chow and D. Nolan, "A cross-validatory method for dependent data", *Biometrika* 81(2), 1994,
pp. 351-358.
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., 2016, chapter 5 (PRESS in
the choice of model terms).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.linalg import lstsq

from stoop.assess.covariance import data_information
from stoop.base.arrays import FloatArray
from stoop.estimate.fit import Fit

BLOCK: Final = 1.0  #: s that are left out together


def left_out(residual: FloatArray, jacobian: FloatArray, information: FloatArray, block: int) -> FloatArray:
    """Return the residuals (n, ny) as they would be without their block of samples.

    Parameters
    ----------
    residual : (n, ny)
        Whitened measured minus simulated; NaN where nothing was measured.
    jacobian : (n, ny, k)
        Whitened sensitivities of the simulated readings.
    information : (k, k)
        Of the whole fit: all segments and the priors.
    block : int
        Samples that are left out together.
    """
    out = np.full_like(residual, np.nan)
    for first in range(0, len(residual), block):
        part = slice(first, first + block)
        seen = np.isfinite(residual[part])
        out[part][seen] = _without(residual[part][seen], jacobian[part][seen], information)
    return out


def _without(e: FloatArray, J: FloatArray, information: FloatArray) -> FloatArray:
    """Return e + J d for the samples (m,) that are left out, with their sensitivities (m, k)."""
    used = np.flatnonzero(np.any(J != 0.0, axis=0))
    if not used.size:
        return e
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    rest = (information - J.T @ J) * np.outer(scale, scale)
    # What only these samples know is not determined by the rest: it stays where it is (minimum norm).
    d = scale * lstsq(rest, scale * (J.T @ e), cond=1e-12, check_finite=False)[0]
    return np.asarray(e + J @ d)


def left_out_residuals(fit: Fit) -> list[FloatArray] | None:
    """Return measured minus simulated (n, n_y) of every piece, each second left out of the fit in turn.

    They are in the channels' units, NaN where nothing was measured, and are the residuals that the method minimizes: of
    the simulation, of windows, or of a filter's predictions. None for a regression, or where the fit cannot be
    differentiated.
    """
    if fit.own_evidence is None and fit.covariance is not None:
        return None
    if fit.own_evidence is not None and fit.local_problem is None:
        return None
    evidence, nuisances = fit.evidence, fit.problem.layout.nuisances
    if not all(
        np.isfinite(p.filled()[0]).all() and np.isfinite(p.filled()[1]).all() for p in evidence.pieces
    ):
        return None
    d = fit.problem.dimension
    lasting = np.array([*range(d), *(d + i for i, n in enumerate(nuisances) if n.is_bias)], dtype=np.intp)
    pieces = [piece.of(lasting) for piece in evidence.pieces]
    information = data_information(pieces) + evidence.prior[np.ix_(lasting, lasting)]
    white = [
        left_out(own.residual, own.jacobian, information, round(BLOCK / piece.dt))
        for own, piece in zip(pieces, fit.problem.pieces, strict=True)
    ]
    present = [np.isfinite(p.measured) for p in fit.problem.pieces]
    filled = [np.where(np.isfinite(w), w, 0.0) for w in white]
    if fit.local_problem is not None:
        units = fit.local_problem().in_units(filled)
    else:
        units = [fit.problem.weights.colored(w, seen) for w, seen in zip(filled, present, strict=True)]
    return [np.where(seen, u, np.nan) for seen, u in zip(present, units, strict=True)]
