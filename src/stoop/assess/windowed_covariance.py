"""Covariance of estimates from windows that each begin in a state of their own.

Where windows begin anew, gusts and whatever else the model lacks leave residuals that grow along each window: no
stationary noise, but noise whose covariance is the same from window to window. It is taken as the mean over all windows,
every window's residuals with every window's sensitivities, so that few windows already tell it:

    C = D^-1 [ P + sum_w S_w' V S_w ] D^-1,    V = mean over v of r_v r_v'

with D the information, P that of the priors, and covariances of neighbors added with weights that fall to zero. How far a
window's end is from the next one's beginning counts among its residuals: what blows through a window moves both.

A fit takes up part of the noise, and most where few windows tell much, so a window's residuals are taken as a fit to all
the others would have left them, r + S (D - S'S)^-1 S' r (Bell and McCaffrey's correction, in the form of the jackknife).

References
----------
R. M. Bell and D. F. McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples", *Survey
Methodology* 28(2), 2002, pp. 169-181.
W. K. Newey and K. D. West, "A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance
matrix", *Econometrica* 55(3), 1987, pp. 703-708.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.assess.covariance import invert, marked
from stoop.base.arrays import FloatArray
from stoop.problem.evidence import PieceEvidence

NEIGHBORS: Final = 3  #: windows whose residuals may still be correlated
MIN_WINDOWS: Final = 12  #: windows, below which a mean over them says little
ALONE: Final = (
    0.5  #: of the information about a direction; of what one window tells so much of, others foresee nothing
)


def windowed_covariance(
    segments: Sequence[PieceEvidence],
    edges: Sequence[Sequence[int]],
    gaps: Sequence[tuple[FloatArray, FloatArray]],
    prior: FloatArray,
) -> FloatArray | None:
    """Return the covariance (k, k) of the estimates; None where there are too few windows.

    Parameters
    ----------
    segments : sequence of PieceEvidence
        One per piece.
    edges : sequence of sequence of int
        First sample of each window of a piece, then the number of its samples.
    gaps : sequence of ((w - 1, e), (w - 1, e, k))
        Of each piece, whitened: from each window to the next, and its derivatives.
    prior : (k, k)
        Information of the priors and of the gaps.
    """
    if sum(len(e) - 1 for e in edges) < MIN_WINDOWS:
        return None
    filled = [segment.filled() for segment in segments]
    inverse = invert(prior + sum(_gram(j.reshape(-1, j.shape[2])) for _, j in filled))
    middle = prior.copy()
    for (residual, jacobian), own, gap in zip(filled, edges, gaps, strict=True):
        met = gap[1].reshape(-1, gap[1].shape[2])
        r, S = _stacked(residual, jacobian, own, gap)
        middle += _scores(
            np.stack([leave_window_out(*one, inverse.factor) for one in zip(r, S, strict=True)]), S
        ) - _gram(met)
    return marked(inverse.matrix @ middle @ inverse.matrix, inverse.determined)


def widened(covariance: FloatArray, other: FloatArray) -> FloatArray:
    """Return a covariance (k, k) with each standard error at least that of another; correlations stay.

    A mean over few windows may be too small by chance, and stationary noise has many samples to tell it.
    """
    own, least = (np.sqrt(np.diag(c)) for c in (covariance, other))
    with np.errstate(invalid="ignore", divide="ignore"):
        stretch = np.where(least > own, least / own, 1.0)
    stretch = np.where(np.isfinite(stretch) & (own > 0.0), stretch, 1.0)
    wide: FloatArray = covariance * np.outer(stretch, stretch)
    return wide


def _stacked(
    residual: FloatArray, jacobian: FloatArray, edges: Sequence[int], gap: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return residuals (w, m) of the windows of a piece, with how they meet, and their derivatives (w, m, k)."""
    length, starts = int(np.min(np.diff(edges))), edges[:-1]
    r = np.stack([residual[a : a + length].ravel() for a in starts])
    S = np.stack([jacobian[a : a + length].reshape(r.shape[1], -1) for a in starts])
    r = np.concatenate([r, np.pad(gap[0], [(0, 1), (0, 0)])], axis=1)
    return r, np.concatenate([S, np.pad(gap[1], [(0, 1), (0, 0), (0, 0)])], axis=1)


def leave_window_out(r: FloatArray, S: FloatArray, factor: FloatArray) -> FloatArray:
    """Return the residuals (m,) of a window as a fit to all other windows leaves them.

    With `factor` (k, d) the unknowns are d such that the whole information is the unit matrix.
    """
    own = S @ factor
    share, along = np.linalg.eigh(_gram(own))
    others = np.where(share < ALONE, 1.0 / (1.0 - np.minimum(share, ALONE)), 0.0)
    whole: FloatArray = r + own @ (along @ (others * (along.T @ (own.T @ r))))
    return whole


def _scores(r: FloatArray, S: FloatArray) -> FloatArray:
    """Return the covariance (k, k) of the sum of the scores of one piece, of residuals (w, m) and derivatives (w, m, k)."""
    lags = min(NEIGHBORS, len(r) - 2)
    total: FloatArray = np.zeros((S.shape[2], S.shape[2]))
    recent: deque[FloatArray] = deque(maxlen=1 + max(0, lags))
    for own in S:
        crossed = r @ own  # window of the residual, unknown
        recent.appendleft(crossed)
        for apart, before in enumerate(recent):
            pair = before[: len(r) - apart].T @ crossed[apart:]
            total += pair if apart == 0 else (1.0 - apart / (NEIGHBORS + 1.0)) * (pair + pair.T)
    mean: FloatArray = total / len(r)  # of all lags alike: no variance is negative then
    return mean


def _gram(rows: FloatArray) -> FloatArray:
    product: FloatArray = rows.T @ rows
    return product
