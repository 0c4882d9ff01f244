"""From information to covariance, intervals and correlation; directions without information stay unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from stoop.base.arrays import BoolArray, FloatArray
from stoop.problem.evidence import PieceEvidence

NORMAL_95: Final = 1.959963984540054  #: two-sided 95 % quantile of the normal distribution
SINGULAR: Final = 1e-13  #: of the greatest scaled eigenvalue; below it is rounding, not information
TOUCHED: Final = 1e-3  #: an unknown with a larger component in a null direction is not determined


@dataclass(frozen=True, eq=False)
class Inverse:
    """Inverse of an information matrix on the directions that it determines.

    Attributes
    ----------
    factor : (k, r)
        Its product with its own transpose is the pseudo-inverse, in the unknowns' units; r directions are
        determined.
    determined : (k,) bool
        Which unknowns have no part in a direction without information.
    eigenvalues : (k,)
        Of the information scaled to a unit diagonal, ascending; their ratio is the condition.
    """

    factor: FloatArray
    determined: BoolArray
    eigenvalues: FloatArray

    @property
    def matrix(self) -> FloatArray:
        """Pseudo-inverse (k, k)."""
        product: FloatArray = self.factor @ self.factor.T
        return product


def invert(information: FloatArray) -> Inverse:
    """Invert an information matrix (k, k), scaled to a unit diagonal so that units do not matter.

    Directions without information are left out (pseudo-inverse), and the unknowns that they touch are named.
    """
    diagonal = np.sqrt(np.maximum(np.diag(information), 0.0))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    kept = values > SINGULAR * max(float(values[-1]), 0.0) if values.size else values > 0.0
    factor = vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None]
    determined = np.sqrt(np.sum(vectors[:, ~kept] ** 2, axis=1)) <= TOUCHED
    return Inverse(factor, determined & (diagonal > 0.0), values)


def data_information(pieces: Sequence[PieceEvidence]) -> FloatArray:
    """Return Fisher's information (k, k) of the measurements alone, for white noise."""
    count = pieces[0].jacobian.shape[2]
    total = np.zeros((count, count))
    for piece in pieces:
        rows = piece.filled()[1].reshape(-1, count)
        seen = np.flatnonzero(rows.any(axis=0))  # not the initial states and biases of other maneuvers
        part = rows[:, seen]
        total[np.ix_(seen, seen)] += part.T @ part
    return total


def prior_information(std: ArrayLike) -> FloatArray:
    """Return the information (k, k) of independent priors; an infinite or NaN `std` (k,) is no prior."""
    spread = np.asarray(std, dtype=np.float64)
    known = np.isfinite(spread) & (spread > 0.0)
    return np.diag(np.where(known, np.where(known, spread, 1.0) ** -2.0, 0.0))


def marked(covariance: FloatArray, determined: BoolArray) -> FloatArray:
    """Return `covariance` (k, k) with infinite variance, and NaN covariances, for what is not determined."""
    result = np.array(covariance)
    result[~determined, :] = np.nan
    result[:, ~determined] = np.nan
    lost = np.flatnonzero(~determined)
    result[lost, lost] = np.inf
    return result


def standard_errors(covariance: FloatArray) -> FloatArray:
    """Return the square roots (k,) of the variances; infinite where nothing is known."""
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def correlation(covariance: FloatArray) -> FloatArray:
    """Return the correlation matrix (k, k); NaN for unknowns without a finite, positive variance."""
    sigma = standard_errors(covariance)
    sigma = np.where(np.isfinite(sigma) & (sigma > 0.0), sigma, np.nan)
    matrix = np.clip(covariance / np.outer(sigma, sigma), -1.0, 1.0)
    matrix[np.diag_indices_from(matrix)] = 1.0
    return matrix


def intervals_95(estimate: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the lower and upper ends (k, 2) of the 95 % intervals of a normal distribution."""
    return np.column_stack([estimate - NORMAL_95 * sigma, estimate + NORMAL_95 * sigma])
