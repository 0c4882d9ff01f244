"""The weighting matrix Q of eq. (3), of noise that is white."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Weights:
    """The weighting matrix Q of eq. (3), the inverse of the measurement noise covariance."""

    covariance: FloatArray  #: (n_y, n_y), of the measurement noise, the channels' units
    root: FloatArray  #: (n_y, n_y), upper triangular, Q = root' root: whitens a residual

    @classmethod
    def of(cls, covariance: FloatArray) -> Weights:
        """Return the weights of a noise covariance (n_y, n_y), or of variances (n_y,)."""
        matrix = np.diag(covariance) if covariance.ndim == 1 else covariance
        return Weights(matrix, np.linalg.cholesky(np.linalg.inv(matrix)).T)

    @cached_property
    def diagonal(self) -> bool:
        """Whether channels are weighted one by one."""
        return not np.any(self.root - np.diag(np.diag(self.root)))

    @property
    def separable(self) -> bool:
        """Whether every reading is weighted alone, so that the cost is a weighted sum of squares."""
        return self.diagonal

    @property
    def logdet(self) -> float:
        """Logarithm of the determinant of the noise covariance."""
        return -2.0 * float(np.sum(np.log(np.diag(self.root))))

    def scaled(self, factors: Sequence[float]) -> Weights:
        """Return the weights for a noise whose standard deviations are larger by factors (n_y,)."""
        d = np.array(factors)
        return Weights(self.covariance * np.outer(d, d), self.root / d)

    def whiten(self, residuals: FloatArray, present: BoolArray, out: FloatArray | None = None) -> FloatArray:
        """Return residuals (..., n, n_y), zero where nothing was measured, with unit covariance.

        A sample that lacks channels has the covariance of those that are `present` (n, n_y). `out` may take the result
        and may be the residuals themselves.
        """
        if self.diagonal:
            return np.multiply(residuals, np.diag(self.root), out=out)
        white = np.zeros_like(residuals)
        for rows, root in self._roots(present):
            white[..., rows, :] = residuals[..., rows, :] @ root.T
        return white

    def whiten_back(self, left: FloatArray, present: BoolArray) -> FloatArray:
        """Return weights (n, n_y) of residuals whose sum of products is that of `left` (n, n_y) with the whitened ones.

        This is the transpose of :meth:`whiten`, zero where nothing was measured.
        """
        if self.diagonal:
            return np.where(present, left * np.diag(self.root), 0.0)
        weights = np.zeros_like(left)
        for rows, root in self._roots(present):
            weights[rows] = left[rows] @ root
        return weights

    def colored(self, whitened: FloatArray, present: BoolArray) -> FloatArray:
        """Return residuals (n, n_y) in the channels' units from whitened ones: the inverse of :meth:`whiten`."""
        if self.diagonal:
            return np.asarray(whitened / np.diag(self.root))
        residuals = np.zeros_like(whitened)
        for rows, root in self._roots(present):
            residuals[rows] = whitened[rows] @ np.linalg.pinv(root).T
        return residuals

    def innovations(self, residuals: FloatArray) -> FloatArray:
        """Return by how much residuals (n, n_y), NaN where there is none, miss what those before foretell, in their units."""
        return residuals

    def _roots(self, present: BoolArray) -> Iterator[tuple[BoolArray, FloatArray]]:
        """Yield samples (n,) that have the same channels, with the root of their inverse covariance, zero elsewhere."""
        patterns, which = np.unique(present, axis=0, return_inverse=True)
        for i, pattern in enumerate(patterns):
            index = np.flatnonzero(pattern)
            root = np.zeros_like(self.root)
            if index.size:
                part = self.covariance[np.ix_(index, index)]
                root[np.ix_(index, index)] = np.linalg.cholesky(np.linalg.inv(part)).T
            yield which.ravel() == i, root
