"""The weighting matrix Q of eq. (3): the inverse of the measurement noise covariance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Weights:
    """Q, with its triangular root.

    Attributes
    ----------
    covariance : (n_y, n_y) array
        Of the measurement noise, the channels' units; Q is its inverse.
    root : (n_y, n_y) array
        Upper triangular, Q = root' root: whitens a residual.
    """

    covariance: FloatArray
    root: FloatArray

    @classmethod
    def of(cls, covariance: FloatArray) -> Weights:
        """Return the weights of a noise covariance (n_y, n_y), or of variances (n_y,)."""
        matrix = np.diag(covariance) if covariance.ndim == 1 else covariance
        return cls(matrix, np.linalg.cholesky(np.linalg.inv(matrix)).T)

    @cached_property
    def diagonal(self) -> bool:
        """Whether channels are weighted one by one."""
        return not np.any(self.root - np.diag(np.diag(self.root)))

    @property
    def logdet(self) -> float:
        """Logarithm of the determinant of the noise covariance."""
        return -2.0 * float(np.sum(np.log(np.diag(self.root))))

    def whiten(self, residuals: FloatArray, present: BoolArray, out: FloatArray | None = None) -> FloatArray:
        """Return residuals (..., n, n_y) with unit covariance.

        Parameters
        ----------
        residuals : (..., n, n_y)
            Zero where nothing was measured.
        present : (n, n_y)
            Where something was: a sample that lacks channels has the covariance of those it has.
        out : (..., n, n_y), optional
            May take the result; may be the residuals themselves.
        """
        if self.diagonal:
            return np.multiply(residuals, np.diag(self.root), out=out)
        white = np.zeros_like(residuals)
        for rows, root in self._roots(present):
            white[..., rows, :] = residuals[..., rows, :] @ root.T
        return white

    def colored(self, whitened: FloatArray, present: BoolArray) -> FloatArray:
        """Return residuals (n, n_y) in the channels' units from whitened ones: the inverse of :meth:`whiten`."""
        if self.diagonal:
            return np.asarray(whitened / np.diag(self.root))
        residuals = np.zeros_like(whitened)
        for rows, root in self._roots(present):
            residuals[rows] = whitened[rows] @ np.linalg.pinv(root).T
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
