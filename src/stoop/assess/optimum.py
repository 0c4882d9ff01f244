"""A fit's optimum as a linear problem: where every way of stating its uncertainty begins."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from stoop.assess.covariance import Inverse, invert
from stoop.base.arrays import FloatArray
from stoop.optimize import Problem


@dataclass(frozen=True, eq=False)
class Optimum:
    """The end of a search, linearized.

    Attributes
    ----------
    problem : Problem
        Weights as in the last fit, priors included; nuisances behind the parameters.
    z : (D + E,)
        The optimum in the problem's own units.
    free : (f,) int
        Entries that no bound holds; the others stay where they are.
    residual : (n_r,)
        Weighted residuals there, those of the priors last.
    jacobian : (n_r, f)
    """

    problem: Problem
    z: FloatArray
    free: npt.NDArray[np.intp]
    residual: FloatArray
    jacobian: FloatArray

    @property
    def rung(self) -> int:
        """The full record."""
        return len(self.problem.prices) - 1

    @property
    def shared(self) -> int:
        """How many of the free entries are parameters; they come first."""
        return int(np.sum(self.free < self.problem.dimension))

    @cached_property
    def information(self) -> FloatArray:
        """Of the weighted residuals, priors included, (f, f)."""
        product: FloatArray = self.jacobian.T @ self.jacobian
        return 0.5 * (product + product.T)

    @cached_property
    def inverse(self) -> Inverse:
        """Of the information."""
        return invert(self.information)

    def at(self, steps: FloatArray) -> FloatArray:
        """Return vectors (B, D + E) for steps (B, f) from the optimum; parameters stay in their box."""
        Z = np.repeat(self.z[None, :], len(steps), axis=0)
        Z[:, self.free] += steps
        d = self.problem.dimension
        Z[:, :d] = np.clip(Z[:, :d], 0.0, 1.0)
        return Z


def linearize(problem: Problem, z: FloatArray, free: npt.NDArray[np.intp]) -> Optimum:
    """Return the optimum with its residuals and their derivatives."""
    rung = len(problem.prices) - 1
    residual = problem.residuals(z[None, :], rung)[0]
    jacobian, _ = problem.jacobian(z, rung, residual)
    return Optimum(problem, z, free, residual, np.ascontiguousarray(jacobian[:, free]))
