r"""From information to covariance: for white residuals, and for windows that each begin anew.

With the information D, D^-1 is the Cramer-Rao bound of white noise, found from the sensitivities themselves, whose product
would cost half the digits; :mod:`stoop.assessment.coloring` has the covariance for colored noise.

Windows that begin anew leave residuals that grow along each window: not stationary, but alike from window to window. Their
covariance is the mean over all windows, every window's residuals with every window's sensitivities,

    C = D^-1 [ P + sum_w S_w' V S_w ] D^-1,    V = mean over v of r_v r_v'

with P the information of the priors. Covariances of neighbors are added with weights that fall to zero (Newey and West), and
the gap from a window's end to the next one's beginning counts among its residuals. A window's residuals are taken as a fit to
all the others would have left them, r + S (D - S'S)^-1 S' r (Bell and McCaffrey).

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

from stoop.base.arrays import BoolArray, FloatArray
from stoop.errors import IdentificationError
from stoop.problem.evidence import Inverse, PieceEvidence, invert_rows

NORMAL_95: Final = 1.959963984540054  #: two-sided 95 % quantile of the normal distribution
NEIGHBORS: Final = 3  #: windows whose residuals may still be correlated
MIN_WINDOWS: Final = 12  #: below which a mean over windows says little
#: of the information about a direction, in one window; of more, others foresee nothing
MAX_SHARE: Final = 0.5
ROWS: Final = 8192  #: that are triangulated at a time
DIVERGENT: Final = (
    "the simulation is all but divergent: its derivatives by the parameters are too large for error bars; "
    "check values, bounds and units, or shorten the maneuver"
)


def data_information(pieces: Sequence[PieceEvidence]) -> FloatArray:
    """Return Fisher's information (k, k) of the measurements alone, for white noise.

    Raises
    ------
    IdentificationError
        It is larger than numbers of 64 bits are.
    """
    count = pieces[0].jacobian.shape[2]
    total = np.zeros((count, count))
    for piece in pieces:
        rows = piece.filled()[1].reshape(-1, count)
        own = np.flatnonzero(rows.any(axis=0))  # not the initial states and biases of other maneuvers
        part = rows[:, own]
        with np.errstate(over="ignore"):
            total[np.ix_(own, own)] += part.T @ part
    if not np.isfinite(total).all():
        raise IdentificationError(DIVERGENT)
    return total


def inverse_information(
    pieces: Sequence[PieceEvidence], prior: FloatArray, inflation: float = 1.0
) -> Inverse:
    """Return the inverse of `inflation` times the information of the measurements, plus that of the priors (k, k).

    It is found from the QR factors of the sensitivities, piece by piece, not from their product.

    Raises
    ------
    IdentificationError
        The information is larger than numbers of 64 bits are.
    """
    count = len(prior)
    diagonal = np.sqrt(np.maximum(np.diag(prior), 0.0))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    values, vectors = np.linalg.eigh(prior / np.outer(scale, scale))
    triangles = [np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * scale]
    for piece in pieces:
        rows = piece.filled()[1].reshape(-1, count)
        own = np.flatnonzero(rows.any(axis=0))
        triangle = np.zeros((0, len(own)))
        for start in range(0, len(rows), ROWS):
            stretch = rows[start : start + ROWS, own]
            triangle = np.asarray(np.linalg.qr(np.concatenate([triangle, stretch]), mode="r"))
        part = np.zeros((len(triangle), count))
        part[:, own] = np.sqrt(inflation) * triangle
        triangles.append(part)
    found = np.concatenate(triangles)
    with np.errstate(over="ignore"):
        if not np.isfinite(np.einsum("nk,nk->k", found, found)).all():
            raise IdentificationError(DIVERGENT)
    return invert_rows(found)


def marked(covariance: FloatArray, determined: BoolArray) -> FloatArray:
    """Return `covariance` (k, k), symmetric, with infinite variance, and NaN covariances, for what is not determined."""
    result = 0.5 * (covariance + covariance.T)  # rounding of a matrix that is nearly singular
    result[~determined, :] = np.nan
    result[:, ~determined] = np.nan
    np.fill_diagonal(result, np.where(determined, np.diag(covariance), np.inf))
    return result


def standard_errors(covariance: FloatArray) -> FloatArray:
    """Return the square roots (k,) of the variances; infinite where nothing is known."""
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def correlation(covariance: FloatArray) -> FloatArray:
    """Return the correlation matrix (k, k); NaN for unknowns without a finite, positive variance."""
    sigma = standard_errors(covariance)
    sigma = np.where(np.isfinite(sigma) & (sigma > 0.0), sigma, np.nan)
    matrix = np.clip(covariance / sigma[:, None] / sigma, -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return matrix


def windowed_covariance(
    segments: Sequence[PieceEvidence],
    edges: Sequence[Sequence[int]],
    gaps: Sequence[tuple[FloatArray, FloatArray]],
    prior: FloatArray,
) -> FloatArray | None:
    """Return the covariance (k, k) of the estimates from the windows of each piece; None where they are too few.

    `edges` are the first sample of each window of a piece, then the number of its samples; `gaps` ((w - 1, e), (w - 1, e, k))
    from each window to the next, whitened, and their derivatives; `prior` (k, k) is the information of priors and gaps.
    """
    if sum(len(e) - 1 for e in edges) < MIN_WINDOWS:
        return None
    inverse = inverse_information(segments, prior)
    middle = prior.copy()
    for segment, own, (gap, gap_jacobian) in zip(segments, edges, gaps, strict=True):
        r, S = by_window(segment, own, gap, gap_jacobian)
        met = gap_jacobian.reshape(-1, gap_jacobian.shape[2])
        middle += window_scatter(leave_windows_out(r, S, inverse.factor), S) - met.T @ met
    return np.asarray(inverse.matrix @ middle @ inverse.matrix)


def by_window(
    segment: PieceEvidence, edges: Sequence[int], gap: FloatArray, gap_jacobian: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return each window's residuals (w, m) with the gap behind it, and their derivatives (w, m, k)."""
    residual, jacobian = segment.filled()
    length, starts = int(np.min(np.diff(edges))), edges[:-1]
    r = np.stack([residual[a : a + length].ravel() for a in starts])
    S = np.stack([jacobian[a : a + length].reshape(r.shape[1], -1) for a in starts])
    r = np.concatenate([r, np.pad(gap, [(0, 1), (0, 0)])], axis=1)
    return r, np.concatenate([S, np.pad(gap_jacobian, [(0, 1), (0, 0), (0, 0)])], axis=1)


def window_scatter(residuals: FloatArray, S: FloatArray) -> FloatArray:
    """Return the covariance (k, k) of the sum of scores: residuals (w, m) of any window with derivatives (w, m, k) of any."""
    count, k = len(residuals), S.shape[2]
    total, recent = np.zeros((k, k)), deque[FloatArray](maxlen=1 + max(0, min(NEIGHBORS, count - 2)))
    for S_w in S:  # the covariance of the scores' sum, and of neighbors
        recent.appendleft(residuals @ S_w)  # window of the residual, unknown
        for lag, before in enumerate(recent):
            pair = before[: count - lag].T @ recent[0][lag:]
            total += pair if lag == 0 else (1.0 - lag / (NEIGHBORS + 1.0)) * (pair + pair.T)
    return total / count  # of all lags alike: no variance is negative then


def leave_windows_out(r: FloatArray, S: FloatArray, factor: FloatArray) -> FloatArray:
    """Return :func:`leave_window_out` of every window, (w, m)."""
    return np.stack([leave_window_out(*one, factor) for one in zip(r, S, strict=True)])


def leave_window_out(r: FloatArray, S: FloatArray, factor: FloatArray) -> FloatArray:
    """Return the residuals (m,) of a window as a fit to all others leaves them; `factor` (k, d) is the inverse's."""
    own = S @ factor
    share, along = np.linalg.eigh(own.T @ own)
    others = np.where(share < MAX_SHARE, 1.0 / (1.0 - np.minimum(share, MAX_SHARE)), 0.0)
    return np.asarray(r + own @ (along @ (others * (along.T @ (own.T @ r)))))


def widened(covariance: FloatArray, other: FloatArray) -> FloatArray:
    """Return a covariance (k, k) with each standard error at least that of another; correlations stay."""
    own, least = (np.sqrt(np.diag(c)) for c in (covariance, other))
    with np.errstate(invalid="ignore", divide="ignore"):
        stretch = np.where(least > own, least / own, 1.0)
    stretch = np.where(np.isfinite(stretch) & (own > 0.0), stretch, 1.0)
    return np.asarray(covariance * np.outer(stretch, stretch))
