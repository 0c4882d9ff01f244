"""Least squares over several coefficients at once: a term may be tied to one of another coefficient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.domain import Domain

ROUNDS: Final = 3  #: of weighing coefficients by their residuals
TINY: Final = 1e-9  #: a column below this share of the largest says nothing
SINGULAR: Final = 1e-13  #: of the greatest scaled eigenvalue; below it is rounding, not information
TOUCHED: Final = 1e-3  #: a parameter with a larger component in a direction without information is not told


@dataclass(frozen=True, eq=False)
class Block:
    """The rows of one coefficient from one stretch.

    Attributes
    ----------
    coefficient : str
    y : (m,)
    X : (m, k)
        Over all k parameters; zero where the coefficient has none of them.
    dt : float, s
    """

    coefficient: str
    y: FloatArray
    X: FloatArray
    dt: float

    @property
    def own(self) -> NDArray[np.bool_]:
        """Which parameters this coefficient has (k,)."""
        return np.asarray(np.any(self.X != 0.0, axis=0))


@dataclass(frozen=True, eq=False)
class Priors:
    """What is known before: value and standard deviation of each parameter, infinite where nothing is."""

    value: FloatArray
    sigma: FloatArray

    @property
    def precision(self) -> FloatArray:
        """One over the variances (k,)."""
        return np.asarray(1.0 / self.sigma**2)


@dataclass(frozen=True, eq=False)
class Solved:
    """Estimates of k parameters.

    Attributes
    ----------
    values : (k,)
    covariance : (k, k)
        Corrected for the color of the residuals; NaN for what no row tells, alone or in combination.
    white : (k, k)
        As if the residuals were white.
    sigma : mapping of str to float
        Standard deviation of the residuals of each coefficient.
    r2 : mapping of str to float
        Share of each coefficient's motion, about its mean, that the terms explain.
    """

    values: FloatArray
    covariance: FloatArray
    white: FloatArray
    sigma: dict[str, float]
    r2: dict[str, float]


def solve(
    blocks: Sequence[Block], bounds: tuple[FloatArray, FloatArray], priors: Priors, domain: Domain
) -> Solved:
    """Estimate parameters; coefficients weigh by their residuals, found in a few rounds.

    Parameters
    ----------
    blocks : sequence of Block
    bounds : lower, upper (k,)
    priors : Priors
    domain : Domain
        It knows what noise does to a sum of rows.
    """
    small = [_triangular(b) for b in blocks]
    sigma = {b.coefficient: 1.0 for b in blocks}
    sigma = {c: float(np.std(np.concatenate([b.y for b in blocks if b.coefficient == c]))) for c in sigma}
    values = priors.value
    for _ in range(ROUNDS):
        values = _weighted(small, bounds, priors, _kept_above_zero(sigma, blocks))
        sigma = {c: _residual_sigma(blocks, c, values) for c in sigma}
    sigma = _kept_above_zero(sigma, blocks)
    white, covariance = _covariances(blocks, values, priors, sigma, domain)
    return Solved(values, covariance, white, sigma, {c: _r2(blocks, c, values) for c in sigma})


def _triangular(block: Block) -> Block:
    """Return few rows with the same sums of squares: the triangle of a QR decomposition."""
    own = np.flatnonzero(block.own)
    triangle = np.asarray(np.linalg.qr(np.column_stack([block.X[:, own], block.y]), mode="r"))
    X = np.zeros((len(triangle), block.X.shape[1]))
    X[:, own] = triangle[:, :-1]
    return Block(block.coefficient, triangle[:, -1], X, block.dt)


def _kept_above_zero(sigma: dict[str, float], blocks: Sequence[Block]) -> dict[str, float]:
    size = {
        c: max((float(np.max(np.abs(b.y))) for b in blocks if b.coefficient == c), default=1.0) for c in sigma
    }
    return {c: max(s, 1e-9 * size[c], 1e-12) for c, s in sigma.items()}


def _weighted(
    blocks: Sequence[Block], bounds: tuple[FloatArray, FloatArray], priors: Priors, sigma: dict[str, float]
) -> FloatArray:
    from scipy.optimize import lsq_linear

    believed = np.isfinite(priors.sigma)
    A = np.concatenate([*(b.X / sigma[b.coefficient] for b in blocks), np.diag(1.0 / priors.sigma)[believed]])
    y = np.concatenate(
        [*(b.y / sigma[b.coefficient] for b in blocks), (priors.value / priors.sigma)[believed]]
    )
    size = np.linalg.norm(A, axis=0)
    told = size > TINY * size.max(initial=0.0)
    scale = size[told]
    lower, upper = (side[told] * scale for side in bounds)
    held = priors.value[told] * scale
    lost = _unseen(A[:, told] / scale)  # along these the numbers stay where they were
    rows, wanted = np.concatenate([A[:, told] / scale, lost]), np.concatenate([y, lost @ held])
    out = priors.value.copy()
    out[told] = lsq_linear(rows, wanted, bounds=(lower, upper)).x / scale
    return out


def _unseen(A: FloatArray) -> FloatArray:
    """Return the directions (m, k) that no row tells, of columns of length 1."""
    if not A.size:
        return np.empty((0, A.shape[1]))
    values, vectors = np.linalg.eigh(A.T @ A)
    return np.asarray(vectors[:, values <= SINGULAR * values[-1]].T)


def _residuals(blocks: Sequence[Block], coefficient: str, values: FloatArray) -> FloatArray:
    return np.concatenate([b.y - b.X @ values for b in blocks if b.coefficient == coefficient])


def _residual_sigma(blocks: Sequence[Block], coefficient: str, values: FloatArray) -> float:
    v = _residuals(blocks, coefficient, values)
    own = np.any([b.own for b in blocks if b.coefficient == coefficient], axis=0)
    return float(np.sqrt(np.sum(v**2) / max(len(v) - int(own.sum()), 1)))


def _r2(blocks: Sequence[Block], coefficient: str, values: FloatArray) -> float:
    y = np.concatenate([b.y for b in blocks if b.coefficient == coefficient])
    about = float(np.sum((y - y.mean()) ** 2))
    return (
        1.0 - float(np.sum(_residuals(blocks, coefficient, values) ** 2)) / about if about > 0.0 else np.nan
    )


def _covariances(
    blocks: Sequence[Block], values: FloatArray, priors: Priors, sigma: dict[str, float], domain: Domain
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance of white and of colored residuals, M^-1 and M^-1 [sum X' V X] M^-1."""
    M, middle = np.diag(priors.precision), np.diag(priors.precision)
    for b in blocks:
        weight = 1.0 / sigma[b.coefficient] ** 2
        own, v = np.flatnonzero(b.own), b.y - b.X @ values
        X, square = b.X[:, own], np.ix_(own, own)
        degrees = len(v) / max(len(v) - len(own), 1)
        M[square] += weight * (X.T @ X)
        middle[square] += weight**2 * degrees * domain.spread(X, v, b.dt)
    inverse, told = _inverted(M)
    both = np.outer(told, told)
    return np.where(both, inverse, np.nan), np.where(both, inverse @ middle @ inverse, np.nan)


def _inverted(M: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the inverse (k, k) without the directions that no row tells, and which parameters those leave alone.

    A pseudo-inverse gives what moves along such a direction an error of zero there: the opposite of the truth.
    """
    diagonal = np.diag(M)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(M / np.outer(scale, scale))
    kept = values > SINGULAR * max(float(values[-1]), 0.0)
    factor = vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None]
    told = (diagonal > 0.0) & (np.linalg.norm(vectors[:, ~kept], axis=1) <= TOUCHED)
    return factor @ factor.T, told
