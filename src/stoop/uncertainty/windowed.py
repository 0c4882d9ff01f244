"""Covariance of estimates from windows that each begin in a state of their own.

Where windows begin anew, gusts and whatever else the model lacks leave residuals that grow along each window: no
stationary noise, but noise whose covariance is the same from window to window. It is taken as the mean over all windows,
every window's residuals with every window's sensitivities, so that few windows already tell it:

    C = D^-1 [ P + sum_w S_w' V S_w ] D^-1,    V = mean over v of r_v r_v'

with D the information, P that of the priors, and covariances of neighbors added with weights that fall to zero. How far a
window's end is from the next one's beginning counts among its residuals: what blows through a window moves both.

References
----------
W. K. Newey and K. D. West, "A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance
matrix", *Econometrica* 55(3), 1987, pp. 703-708.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.uncertainty.covariance import invert, marked
from stoop.uncertainty.sensitivity import FloatArray, Sensitivity

NEIGHBORS: Final = 3  #: windows whose residuals may still be correlated
FEWEST: Final = 12  #: windows, below which a mean over them says little


def windowed_covariance(
    segments: Sequence[Sensitivity],
    edges: Sequence[Sequence[int]],
    gaps: Sequence[tuple[FloatArray, FloatArray]],
    prior: FloatArray,
) -> FloatArray | None:
    """Return the covariance (k, k) of the estimates; None where there are too few windows.

    Parameters
    ----------
    segments : sequence of Sensitivity
        One per piece.
    edges : sequence of sequence of int
        First sample of each window of a piece, then the number of its samples.
    gaps : sequence of ((w - 1, e), (w - 1, e, k))
        Of each piece, whitened: from each window to the next, and its derivatives.
    prior : (k, k)
        Information of the priors and of the gaps.
    """
    if sum(len(e) - 1 for e in edges) < FEWEST:
        return None
    information, middle = prior.copy(), prior.copy()
    for segment, own, gap in zip(segments, edges, gaps, strict=True):
        residual, jacobian = segment.filled()
        rows, met = (a.reshape(-1, a.shape[2]) for a in (jacobian, gap[1]))
        information += rows.T @ rows
        middle += _scores(residual, jacobian, own, gap) - met.T @ met
    inverse = invert(information)
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


def _scores(
    residual: FloatArray, jacobian: FloatArray, edges: Sequence[int], gap: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Return the covariance (k, k) of the sum of the scores of one piece."""
    length, count = int(np.min(np.diff(edges))), len(edges) - 1
    starts = edges[:-1]
    r = np.stack([residual[a : a + length].ravel() for a in starts])
    S = np.stack([jacobian[a : a + length].reshape(r.shape[1], -1) for a in starts])
    r = np.concatenate([r, np.pad(gap[0], [(0, 1), (0, 0)])], axis=1)
    S = np.concatenate([S, np.pad(gap[1], [(0, 1), (0, 0), (0, 0)])], axis=1)
    crossed = np.matmul(r, S)  # window of the sensitivity, window of the residual, unknown
    total = _products(crossed, crossed) / count
    for apart in range(1, min(NEIGHBORS, count - 2) + 1):
        pair = _products(crossed[:-apart, :-apart], crossed[apart:, apart:]) / (count - apart)
        total += (1.0 - apart / (NEIGHBORS + 1.0)) * (pair + pair.T)
    return total


def _products(a: FloatArray, b: FloatArray) -> FloatArray:
    k = a.shape[-1]
    product: FloatArray = a.reshape(-1, k).T @ b.reshape(-1, k)
    return product
