"""Least squares over several equations at once; a parameter may stand in more than one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.estimate.regression.domain import Domain

Bounds = tuple[FloatArray, FloatArray]
WEIGHT_ROUNDS: Final = 3  #: alternations of estimates and residual variances
ZERO_COLUMN: Final = 1e-9  #: norm, of the largest column's, below which a column counts as zero
SINGULAR: Final = 1e-13  #: of the largest scaled eigenvalue; smaller ones are rounding
NULL_COMPONENT: Final = 1e-3  #: a parameter with a larger component in the null space is not identifiable


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of one equation from one stretch of record without a hole.

    Attributes
    ----------
    equation : str
        ``"Cm"``, ``"roll"``, ...
    y : (m,)
        Response.
    X : (m, k)
        Regressors of all k parameters; zero columns for those that the equation lacks.
    dt : float, s
        Sample period of the record.
    """

    equation: str
    y: FloatArray
    X: FloatArray
    dt: float

    @property
    def used(self) -> BoolArray:
        """Which parameters stand in the equation (k,)."""
        return np.asarray(np.any(self.X != 0.0, axis=0))

    def transformed(self, domain: Domain) -> Rows:
        """Return the rows in a domain; columns that the transform removes are exactly zero."""
        both = domain.rows(np.column_stack([self.y, self.X]), self.dt)
        X = both[:, 1:]
        if not domain.keeps_constants:
            X[:, np.linalg.norm(X, axis=0) <= ZERO_COLUMN * np.linalg.norm(self.X, axis=0)] = 0.0
        return Rows(self.equation, both[:, 0], X, self.dt)


@dataclass(frozen=True, eq=False)
class Priors:
    """Prior mean and standard deviation of each parameter (k,); infinite where there is none."""

    mean: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, eq=False)
class Estimates:
    """Least-squares estimates of k parameters.

    Attributes
    ----------
    values : (k,)
    covariance : (k, k)
        Corrected for the color of the residuals; NaN for parameters that are not identifiable.
    white : (k, k)
        As if the residuals were white.
    sigma : mapping of str to float
        Standard deviation of the residuals of each equation.
    r2 : mapping of str to float
        Coefficient of determination of each equation.
    rows : tuple of Rows
        That were solved, in their domain: stretch by stretch, equation by equation.
    """

    values: FloatArray
    covariance: FloatArray
    white: FloatArray
    sigma: dict[str, float]
    r2: dict[str, float]
    rows: tuple[Rows, ...]


def solve(rows: Sequence[Rows], bounds: Bounds, priors: Priors, domain: Domain) -> Estimates:
    """Estimate parameters; the equations are weighted by the variances of their residuals.

    Parameters
    ----------
    rows : sequence of Rows
        In `domain`.
    bounds : lower, upper (k,)
    priors : Priors
    domain : Domain
        Gives the color correction of the covariance.
    """
    reduced = [_triangular(r) for r in rows]
    of = {name: [r for r in rows if r.equation == name] for name in dict.fromkeys(r.equation for r in rows)}
    floor = {c: max(1e-9 * max(float(np.max(np.abs(r.y))) for r in own), 1e-12) for c, own in of.items()}
    sigma = {c: float(np.std(np.concatenate([r.y for r in own]))) for c, own in of.items()}
    values = priors.mean
    for _ in range(WEIGHT_ROUNDS):
        values = _weighted(reduced, bounds, priors, {c: max(s, floor[c]) for c, s in sigma.items()})
        left = {c: np.concatenate([r.y - r.X @ values for r in own]) for c, own in of.items()}
        used = {c: int(np.any([r.used for r in own], axis=0).sum()) for c, own in of.items()}
        sigma = {c: float(np.sqrt(np.sum(v**2) / max(len(v) - used[c], 1))) for c, v in left.items()}
    sigma = {c: max(s, floor[c]) for c, s in sigma.items()}
    white, covariance = _covariances(rows, values, priors, sigma, domain)
    r2 = {c: r_squared(np.concatenate([r.y for r in own]), left[c]) for c, own in of.items()}
    return Estimates(values, covariance, white, sigma, r2, tuple(rows))


def r_squared(y: FloatArray, residual: FloatArray) -> float:
    """Return the coefficient of determination of a response (m,) about its mean; NaN where it is constant."""
    total = float(np.sum((y - y.mean()) ** 2))
    return 1.0 - float(np.sum(residual**2)) / total if total > 0.0 else np.nan


def _triangular(rows: Rows) -> Rows:
    """Return few rows with the same normal equations: the triangle of a QR decomposition."""
    own = np.flatnonzero(rows.used)
    triangle = np.asarray(np.linalg.qr(np.column_stack([rows.X[:, own], rows.y]), mode="r"))
    X = np.zeros((len(triangle), rows.X.shape[1]))
    X[:, own] = triangle[:, :-1]
    return Rows(rows.equation, triangle[:, -1], X, rows.dt)


def _weighted(rows: Sequence[Rows], bounds: Bounds, priors: Priors, sigma: dict[str, float]) -> FloatArray:
    """Return the bounded weighted estimates; in the null space parameters keep their prior mean."""
    from scipy.optimize import lsq_linear

    stated = np.isfinite(priors.sigma)
    A = np.concatenate([*(r.X / sigma[r.equation] for r in rows), np.diag(1.0 / priors.sigma)[stated]])
    y = np.concatenate([*(r.y / sigma[r.equation] for r in rows), (priors.mean / priors.sigma)[stated]])
    size = np.linalg.norm(A, axis=0)
    free = size > ZERO_COLUMN * size.max(initial=0.0)
    scale = size[free]
    lower, upper = (side[free] * scale for side in bounds)
    scaled = A[:, free] / scale
    null = np.empty((0, len(scale)))
    if scaled.size:
        values, vectors = np.linalg.eigh(scaled.T @ scaled)
        null = vectors[:, values <= SINGULAR * values[-1]].T
    target = np.concatenate([y, null @ (priors.mean[free] * scale)])
    out = priors.mean.copy()
    out[free] = lsq_linear(np.concatenate([scaled, null]), target, bounds=(lower, upper)).x / scale
    return out


def _covariances(
    rows: Sequence[Rows], values: FloatArray, priors: Priors, sigma: dict[str, float], domain: Domain
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance for white and for colored residuals: M^-1 and M^-1 [sum X' V X] M^-1."""
    M = np.diag(1.0 / priors.sigma**2)
    middle = M.copy()
    for r in rows:
        weight = 1.0 / sigma[r.equation] ** 2
        own, v = np.flatnonzero(r.used), r.y - r.X @ values
        X, square = r.X[:, own], np.ix_(own, own)
        freedom = len(v) / max(len(v) - len(own), 1)
        M[square] += weight * (X.T @ X)
        middle[square] += weight**2 * freedom * domain.scatter(X, v, r.dt)
    inverse, known = _inverse(M)
    both = np.outer(known, known)
    return np.where(both, inverse, np.nan), np.where(both, inverse @ middle @ inverse, np.nan)


def _inverse(M: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the inverse (k, k) without the null space, and which parameters have no component in it.

    A pseudo-inverse gives a parameter in the null space zero variance there: the opposite of the truth.
    """
    diagonal = np.diag(M)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(M / np.outer(scale, scale))
    kept = values > SINGULAR * max(float(values[-1]), 0.0)
    factor = vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None]
    known = (diagonal > 0.0) & (np.linalg.norm(vectors[:, ~kept], axis=1) <= NULL_COMPONENT)
    return factor @ factor.T, known
