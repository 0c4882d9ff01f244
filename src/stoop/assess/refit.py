"""Refits from one optimum: the same problem with other noise, or with a parameter held, solved from where the fit ended.

All refits share model, weights and start, so the derivatives at the optimum serve them all: a step costs one
trajectory per refit, flown in lanes. Where that has come to rest, each refit takes derivatives of its own for the last
few Gauss-Newton steps; the length of the last one decides that it has converged. One that does not converge so is given
to the local refinement of the optimizer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np

from stoop.assess.covariance import Inverse, invert
from stoop.base.arrays import FloatArray, IntArray
from stoop.optimize import Problem, refine

SHARED_STEPS: Final = 6  #: at most, with the derivatives at the optimum
OWN_STEPS: Final = 8  #: at most, with the refit's own
NEAR: Final = 0.5  #: standard errors left to go when the shared derivatives have done their work
ARRIVED: Final = 0.05  #: standard errors of the last step; what is left after it is smaller still
SLOW: Final = 0.2  #: a step not shorter than so much of the one before asks for a curvature of its own

Ending = Literal["arrived", "dived", "lost"]


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
    free: IntArray
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


def linearize(problem: Problem, z: FloatArray, free: IntArray) -> Optimum:
    """Return the optimum with its residuals and their derivatives."""
    rung = len(problem.prices) - 1
    residual = problem.residuals(z[None, :], rung)[0]
    jacobian, _ = problem.jacobian(z, rung, residual)
    return Optimum(problem, z, free, residual, np.ascontiguousarray(jacobian[:, free]))


@dataclass(frozen=True, eq=False)
class Derived:
    """A problem made from another; a child changes what differs."""

    problem: Problem

    @property
    def dimension(self) -> int:
        """Number of variables in the unit box."""
        return self.problem.dimension

    @property
    def extra(self) -> int:
        """Number of nuisances."""
        return self.problem.extra

    @property
    def prices(self) -> tuple[float, ...]:
        """Price of one trajectory on each rung."""
        return self.problem.prices

    def reference(self, rung: int) -> float:
        """Return the trivial model's cost."""
        return self.problem.reference(rung)


@dataclass(frozen=True, eq=False)
class Shifted(Derived):
    """A problem whose measurements have moved: the residuals are shifted by (n_r,), nothing else changes."""

    shift: FloatArray

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return shifted residuals (B, n_r) on the full record."""
        return self.problem.residuals(Z, rung) + self.shift

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return costs (B,) with the nuisances at their start."""
        Z = np.concatenate([X, np.zeros((len(X), self.extra))], axis=1)
        return np.asarray(np.sum(self.residuals(Z, rung) ** 2, axis=1))

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return the derivative, which the shift does not change, and the trajectories it took."""
        return self.problem.jacobian(z, rung, r - self.shift)


@dataclass(frozen=True, eq=False)
class Pinned(Derived):
    """A problem with one of its parameters held."""

    entry: int
    value: float

    @property
    def dimension(self) -> int:
        """Number of variables left in the unit box."""
        return self.problem.dimension - 1

    def whole(self, Z: FloatArray) -> FloatArray:
        """Return vectors of the whole problem."""
        return np.insert(Z, self.entry, self.value, axis=1)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted residuals (B, n_r)."""
        return self.problem.residuals(self.whole(Z), rung)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return costs (B,) with the nuisances at their start."""
        return self.problem.costs(self.whole(X), rung)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return the derivative by what is left, and the trajectories it took."""
        jacobian, spent = self.problem.jacobian(self.whole(z[None, :])[0], rung, r)
        return np.delete(jacobian, self.entry, axis=1), spent


def stationary(optimum: Optimum) -> Optimum:
    """Return the optimum of the same problem without the part of its residuals that the unknowns still explain.

    A likelihood with further terms (the size of innovations) has its maximum beside that of the sum of squares; taken
    off, the estimate is the least-squares optimum.
    """
    factor, J = optimum.inverse.factor, optimum.jacobian
    explained = J @ (factor @ (factor.T @ (J.T @ optimum.residual)))
    shifted = Shifted(optimum.problem, -explained)
    return replace(optimum, problem=shifted, residual=optimum.residual - explained)


@dataclass(frozen=True, eq=False)
class Refits:
    """Where refits ended.

    Attributes
    ----------
    z : (B, D + E)
        NaN for those that were lost.
    endings : tuple of str
        How each ended.
    """

    z: FloatArray
    endings: tuple[Ending, ...]


def refit(optimum: Optimum, shifts: FloatArray) -> Refits:
    """Refit problems whose residuals are those of `optimum.problem` plus `shifts` (B, n_r)."""
    Z = _approach(optimum, shifts)
    ends = [_finish(optimum, z, shift) for z, shift in zip(Z, shifts, strict=True)]
    return Refits(np.array([z for z, _ in ends]), tuple(ending for _, ending in ends))


def _approach(optimum: Optimum, shifts: FloatArray) -> FloatArray:
    """Return vectors (B, D + E) near the refits' optima, by the derivatives at the common one."""
    factor, sensitivities = optimum.inverse.factor, optimum.jacobian
    Z = optimum.at(np.zeros((len(shifts), len(optimum.free))))
    residuals = np.repeat(optimum.residual[None, :], len(shifts), axis=0)
    for _ in range(SHARED_STEPS):
        with np.errstate(invalid="ignore", over="ignore"):
            steps = -((residuals + shifts) @ sensitivities) @ factor  # (B, r), standard errors
        length = np.sqrt(np.sum(steps**2, axis=1))
        moving = np.isfinite(length) & (length > NEAR)
        if not moving.any():
            break
        Z[moving] = optimum.at(
            Z[moving][:, optimum.free] - optimum.z[optimum.free] + steps[moving] @ factor.T
        )
        residuals[moving] = optimum.problem.residuals(Z[moving], optimum.rung)
    return Z


def _finish(optimum: Optimum, z: FloatArray, shift: FloatArray) -> tuple[FloatArray, Ending]:
    """Return a refit's optimum by its own gradients; by local refinement where they do not lead there."""
    there = _walk(optimum, z, shift)
    if there is not None:
        return there, "arrived"
    end = refine(Shifted(optimum.problem, shift), optimum.z, optimum.rung)
    if end.converged:
        return end.z, "dived"
    return np.full(len(z), np.nan), "lost"


def _walk(optimum: Optimum, z: FloatArray, shift: FloatArray) -> FloatArray | None:
    """Take Gauss-Newton steps with the refit's own derivatives; None where they do not arrive."""
    problem, rung, free = optimum.problem, optimum.rung, optimum.free
    information, before = optimum.information, 0.0
    for _ in range(OWN_STEPS):
        r = problem.residuals(z[None, :], rung)[0]
        if not np.isfinite(r).all():
            return None
        jacobian = np.ascontiguousarray(problem.jacobian(z, rung, r)[0][:, free])
        gradient = (r + shift) @ jacobian
        step, left = _step(optimum, z, gradient, information)
        if left > SLOW * before:
            information = jacobian.T @ jacobian
            step, left = _step(optimum, z, gradient, information)
        before = left
        z = optimum.at((z[free] - optimum.z[free] + step)[None, :])[0]
        if left < ARRIVED:
            return z
    return None


def _step(
    optimum: Optimum, z: FloatArray, gradient: FloatArray, information: FloatArray
) -> tuple[FloatArray, float]:
    """Return the step (f,) and its length in standard errors; bounds that it would cross hold."""
    boxed = optimum.free < optimum.problem.dimension
    at = z[optimum.free]
    held = boxed & (((at <= 0.0) & (gradient > 0.0)) | ((at >= 1.0) & (gradient < 0.0)))
    moves = np.flatnonzero(~held)
    factor = invert(information[np.ix_(moves, moves)]).factor
    inner = -gradient[moves] @ factor
    step = np.zeros(len(gradient))
    step[moves] = factor @ inner
    return step, float(np.sqrt(inner @ inner))
