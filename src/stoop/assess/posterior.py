"""The posterior of the parameters, by an ensemble of walkers on the batched likelihood.

Sampled are the parameters alone. Initial states and biases enter the readings almost linearly, so they are marginalized in
closed form (Laplace): at each point they stand where a linear model puts them, one projection takes off what is left, and
`Target.error` measures what this neglects.

The fit weighs colored residuals as so many times fewer independent ones, one factor for all. That makes the likelihood
about right in size but not in shape: some parameters live where the noise is strong, others where it is not. So the
likelihood is stretched about its maximum (curvature adjustment) until its curvature is the inverse of the covariance
corrected for color. A linear model then has exactly the corrected covariance as its posterior, and what the posterior shows
beyond that is the model's own: skewness, bounds, ridges. Whitening the residuals by an autoregression instead would move the
maximum away from the estimate, and onto the high frequencies, where a flight-dynamics model knows least.

References
----------
M. Ribatet, D. Cooley and A. C. Davison, "Bayesian inference from composite likelihoods, with an application to spatial
extremes", *Statistica Sinica* 22, 2012, pp. 813-845, section 2 (curvature adjustment).
S. L. Cotter, G. O. Roberts, A. M. Stuart and D. White, "MCMC methods for functions: modifying old algorithms to make them
faster", *Statistical Science* 28(3), 2013, pp. 424-446 (the preconditioned Crank-Nicolson proposal).
D. Foreman-Mackey, D. W. Hogg, D. Lang and J. Goodman, "emcee: the MCMC hammer", *Publications of the Astronomical Society of
the Pacific* 125, 2013, pp. 306-312.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from stoop.assess.optimum import Optimum
from stoop.base.arrays import FloatArray

BOX_STD: Final = 0.29  #: of a value thrown blindly into a box of width 1
BLENDED: Final = 0.05  #: of the spread of a reference that stays when it is fitted to draws
SMALLEST: Final = 1e-12  #: of the greatest eigenvalue; what is below is taken as that


@dataclass(frozen=True, eq=False)
class Target:
    """Logarithm of the posterior density of the parameters in the unit box, up to a constant.

    Attributes
    ----------
    optimum : Optimum
        With all entries free.
    stretch : (k, k)
        Takes a step of the posterior to one of the likelihood, see :func:`stretch`.
    """

    optimum: Optimum
    stretch: FloatArray

    @property
    def size(self) -> int:
        """Number k of parameters."""
        return self.optimum.shared

    @property
    def center(self) -> FloatArray:
        """The estimate (k,)."""
        return self.optimum.z[: self.size]

    def __call__(self, X: FloatArray) -> FloatArray:
        """Return the log density (W,) of points (W, k); minus infinity outside of the box."""
        inside = ((X >= 0.0) & (X <= 1.0)).all(axis=1)
        out = np.full(len(X), -np.inf)
        if inside.any():
            out[inside] = self._densities((X[inside] - self.center) @ self.stretch.T)
        return out

    def _densities(self, steps: FloatArray) -> FloatArray:
        with np.errstate(invalid="ignore", over="ignore"):
            residuals = self.optimum.problem.residuals(self._followed(steps), self.optimum.rung)
            density = -0.5 * (np.sum(residuals**2, axis=1) - self._taken(residuals))
        return np.where(np.isfinite(density), density, -np.inf)

    def _taken(self, residuals: FloatArray) -> FloatArray:
        """Return by how much the nuisances lower the cost (W,) from where they stand."""
        if not self._any:
            return np.zeros(len(residuals))
        gradient = residuals @ self._nuisances
        return np.asarray(
            np.sum(gradient * cho_solve(self._factor, gradient.T, check_finite=False).T, axis=1)
        )

    def _followed(self, steps: FloatArray) -> FloatArray:
        """Return vectors (W, D + E) with the nuisances where the linear model puts them."""
        Z = np.repeat(self.optimum.z[None, :], len(steps), axis=0)
        Z[:, : self.size] += steps
        Z[:, self.size :] += steps @ self._follow.T
        return Z

    @property
    def _any(self) -> bool:
        return self.size < len(self.optimum.z)

    @cached_property
    def _nuisances(self) -> FloatArray:
        return np.ascontiguousarray(self.optimum.jacobian[:, self.size :])

    @cached_property
    def _factor(self) -> tuple[FloatArray, bool]:
        return cho_factor(self.optimum.information[self.size :, self.size :])  # their priors make it definite

    @cached_property
    def _follow(self) -> FloatArray:
        """How the nuisances follow the parameters, (E, k)."""
        if not self._any:
            return np.empty((0, self.size))
        return np.asarray(-cho_solve(self._factor, self.optimum.information[self.size :, : self.size]))

    @cached_property
    def information(self) -> FloatArray:
        """Of the parameters with the nuisances unknown, as the weights have it, (k, k)."""
        whole, k = self.optimum.information, self.size
        return np.asarray(whole[:k, :k] + whole[:k, k:] @ self._follow)

    def error(self, X: FloatArray) -> FloatArray:
        """Return by how much the marginalization misses the log density (W,) at points (W, k).

        What is compared is the least cost over the nuisances: by one projection, and by Gauss-Newton steps.
        """
        steps = (X - self.center) @ self.stretch.T
        found = np.array([self._conditional(z) for z in self._followed(steps)])
        return np.asarray(found - self._densities(steps))

    def _conditional(self, z: FloatArray, rounds: int = 4) -> float:
        """Return the log density at the best nuisances."""
        problem, rung, k = self.optimum.problem, self.optimum.rung, self.size
        for _ in range(rounds if self._any else 0):
            r = problem.residuals(z[None, :], rung)[0]
            jacobian = problem.jacobian(z, rung, r)[0][:, k:]
            z = z.copy()
            z[k:] -= np.linalg.lstsq(jacobian, r, rcond=None)[0]
        r = problem.residuals(z[None, :], rung)[0]
        return -0.5 * float(r @ r)


def stretch(information: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the matrix M (k, k) with M' `information` M the inverse of `covariance`: the most even one.

    Among all such it is the symmetric one, in coordinates in which the information has a unit diagonal: the
    optimal transport between the two normal distributions.
    """
    scale = np.sqrt(np.diag(information))
    root, inverse = _roots(information / np.outer(scale, scale))
    turned = root @ _inverse(covariance * np.outer(scale, scale)) @ root
    middle, _ = _roots(turned)
    return np.asarray((inverse @ middle @ inverse) / scale[:, None] * scale[None, :])


def _roots(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the symmetric square root of a positive matrix, and its inverse."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    values = np.sqrt(np.maximum(values, SMALLEST * values[-1]))
    return (vectors * values) @ vectors.T, (vectors / values) @ vectors.T


def _inverse(matrix: FloatArray) -> FloatArray:
    _, inverse = _roots(matrix)
    return inverse @ inverse


@dataclass(frozen=True, eq=False)
class Reference:
    """The normal distribution that the posterior would be if the model were linear and the box wide.

    Attributes
    ----------
    center : (k,)
    factor : (k, k)
        Its product with its own transpose is the covariance.
    """

    center: FloatArray
    factor: FloatArray

    def draw(self, count: int, random: np.random.RandomState) -> FloatArray:
        """Return points (count, k) of the box."""
        points = self.center + random.standard_normal((count, len(self.center))) @ self.factor.T
        return np.asarray(np.abs(points) - 2.0 * np.maximum(np.abs(points) - 1.0, 0.0)).clip(0.0, 1.0)

    def propose(self, X: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """Return new points (W, k) and what the acceptance owes to the proposal (W,): emcee's `MHMove`.

        The preconditioned Crank-Nicolson step leaves this distribution as it is, whatever its length. Long and
        short ones are mixed: near a normal posterior the long ones are accepted, elsewhere the short ones.
        """
        reach = random.choice(REACHES, size=(len(X), 1))
        before = np.linalg.solve(self.factor, (X - self.center).T).T
        after = np.sqrt(1.0 - reach**2) * before + reach * random.standard_normal(X.shape)
        owed = 0.5 * (np.sum(after**2, axis=1) - np.sum(before**2, axis=1))
        return self.center + after @ self.factor.T, owed


REACHES: Final = (1.0, 0.7, 0.4, 0.2, 0.1)  #: of a proposal; 1 forgets where it came from


def reference(target: Target) -> Reference:
    """Return the normal distribution beside a target; what the data do not see is as wide as the box."""
    information = target.stretch.T @ target.information @ target.stretch
    values, vectors = np.linalg.eigh(0.5 * (information + information.T) + np.eye(target.size) / BOX_STD**2)
    return Reference(target.center, vectors / np.sqrt(values))


def fitted(before: Reference, draws: FloatArray) -> Reference:
    """Return a reference with center and spread of draws (m, k), kept definite by a little of the one before."""
    spread: FloatArray = (1.0 - BLENDED) * np.cov(draws.T).reshape(
        draws.shape[1], -1
    ) + BLENDED * before.factor @ before.factor.T
    return Reference(np.asarray(draws.mean(axis=0)), np.asarray(np.linalg.cholesky(spread)))
