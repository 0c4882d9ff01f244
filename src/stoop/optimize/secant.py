"""Curvature that the information of a likelihood or the Gauss-Newton matrix lacks, from changes of the gradient.

References
----------
J. E. Dennis, D. M. Gay and R. E. Welsch, "An adaptive nonlinear least-squares algorithm", *ACM Transactions on Mathematical
Software* 7(3), 1981, pp. 348-368: section 3, the update and its sizing.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Self

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Secant:
    """The correction of a curvature, and the point and gradient from which the next one follows."""

    #: (n,), NaN before the first
    point: FloatArray
    #: (n,)
    gradient: FloatArray
    #: (n, n), symmetric
    correction: FloatArray

    @classmethod
    def none(cls, size: int) -> Self:
        """Return no correction."""
        unknown = np.full(size, np.nan)
        return cls(unknown, unknown, np.zeros((size, size)))

    @property
    def packed(self) -> FloatArray:
        """Point, gradient and correction in one vector, (2 n + n^2,)."""
        return np.concatenate([self.point, self.gradient, self.correction.ravel()])

    @classmethod
    def unpacked(cls, memory: FloatArray, size: int) -> Self:
        """Return what `packed` held."""
        return cls(memory[:size], memory[size : 2 * size], memory[2 * size :].reshape(size, size))

    def at(self, point: FloatArray, gradient: FloatArray, known: FloatArray) -> Self:
        """Return the correction at the next point, where the curvature without it is `known`, (n, n).

        The corrected curvature times the step is the change of the gradient. The correction is reduced first where it exceeds
        what the step shows of it, and stays as it was where the gradient does not grow along the step.
        """
        step, change = point - self.point, gradient - self.gradient
        growth, C = np.float64(change @ step), self.correction  # its square may be infinite
        if not growth > 0.0:
            return type(self)(point, gradient, C)
        missing, along = change - known @ step, float(step @ C @ step)
        if along != 0.0:
            C = C * min(1.0, abs(float(step @ missing) / along))
        w = missing - C @ step
        outer = np.outer(w, change) / growth
        C = C + outer + outer.T - float(w @ step) / growth**2 * np.outer(change, change)
        return type(self)(point, gradient, C if np.isfinite(C).all() else self.correction)

    def corrected(self, curvature: FloatArray, chosen: IntArray | BoolArray) -> FloatArray:
        """Return the curvature of chosen variables with the correction, or without where that is not positive definite."""
        rows = np.ix_(chosen, chosen)
        known: FloatArray = curvature[rows]
        whole: FloatArray = known + self.correction[rows]
        with suppress(np.linalg.LinAlgError):
            if np.isfinite(np.linalg.cholesky(whole)).all():
                return whole
        return known
