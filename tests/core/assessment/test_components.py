"""Components of the covariance, against draws, Kalman's update and what each is defined by."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import toeplitz

from stoop.assessment.clusters import Scatter
from stoop.assessment.components import beyond_chance, excess, of_scatter, within_priors


def drawn(rng: np.random.Generator, count: int, rank: int) -> np.ndarray:
    """Return a covariance of numbers whose units differ by decades."""
    rows = rng.standard_normal((count, rank)) * 10.0 ** rng.uniform(-4.0, 4.0, (count, 1))
    return rows @ rows.T


def correlation(covariance: np.ndarray) -> np.ndarray:
    scale = np.sqrt(np.diag(covariance))
    return covariance / np.outer(scale, scale)


@pytest.mark.parametrize("seed", range(5))
def test_the_sum_with_an_excess_is_no_smaller_than_either(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, other = drawn(rng, 6, 8), drawn(rng, 6, 8)
    other *= np.outer(*[np.sqrt(np.diag(before) / np.diag(other))] * 2)
    more = excess(other, before)
    scale = np.outer(*[np.sqrt(np.diag(before))] * 2)
    for least in (before, other):
        assert np.linalg.eigvalsh((before + more - least) / scale).min() > -1e-9
    assert np.linalg.matrix_rank(more / scale, tol=1e-9) < 6  # no larger than it has to be
    assert_allclose(excess(0.5 * before, before) / scale, 0.0, atol=1e-12)
    assert_allclose(excess(3.0 * before, before), 2.0 * before, rtol=1e-6)


def test_shifts_within_priors_are_those_that_measurements_of_zero_leave() -> None:
    """Kalman's update, one prior at a time; and Bayes, by weights of draws."""
    rng = np.random.default_rng(1)
    shifts, priors = drawn(rng, 4, 3), np.array([np.inf, 1.0, np.inf, 1.0])
    priors[[1, 3]] = np.sqrt(np.diag(shifts))[[1, 3]] * [0.5, 2.0]
    found, expected = within_priors(shifts, priors, np.ones(4, dtype=np.bool_)), shifts.copy()
    for i in (1, 3):
        gain = expected[:, i] / (expected[i, i] + priors[i] ** 2)
        expected = expected - np.outer(gain, expected[i])
    assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
    scale = np.sqrt(np.diag(shifts))
    values, vectors = np.linalg.eigh(correlation(shifts))
    draws = (rng.standard_normal((200_000, 4)) * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    weights = np.exp(-0.5 * np.sum((draws * scale / priors) ** 2, axis=1))
    scatter = (draws * weights[:, None]).T @ draws / weights.sum()
    assert_allclose(scatter, found / np.outer(scale, scale), atol=0.01)
    assert np.all(np.diag(found) <= np.minimum(np.diag(shifts), priors**2))


def test_a_prior_that_is_not_joint_limits_its_own_shift_and_no_other() -> None:
    """Variances are those of two independent measurements; what is at most as wide as its prior stays correlated as it was."""
    shifts = drawn(np.random.default_rng(3), 4, 3)
    priors = np.sqrt(np.diag(shifts)) * [np.inf, 0.1, np.inf, 3.0]
    found = within_priors(shifts, priors, np.zeros(4, dtype=np.bool_))
    assert_allclose(np.diag(found), 1.0 / (1.0 / np.diag(shifts) + priors**-2.0), rtol=1e-9)
    assert_allclose(correlation(found), correlation(shifts), atol=1e-9)


def test_scatter_of_maneuvers_multiplies_standard_errors() -> None:
    rng = np.random.default_rng(2)
    before, factors = drawn(rng, 5, 7), np.array([1.0, 1.5, 2.0])
    total = before + of_scatter(Scatter(3, 3, 1.5, factors), before)
    assert_allclose(np.sqrt(np.diag(total) / np.diag(before)), [1.0, 1.5, 2.0, 1.0, 1.0])
    assert_allclose(of_scatter(Scatter(3, 5, 1.5, np.full(5, 2.0)), before), 3.0 * before)
    assert np.linalg.eigvalsh(correlation(total)).min() > 0.0


@pytest.mark.parametrize(("lacking", "least", "most"), [(0.0, 0.0, 0.2), (3.0, 0.5, 1.0)])
def test_two_weightings_of_a_right_model_differ_by_chance(lacking: float, least: float, most: float) -> None:
    """Least squares, and generalized least squares by the true color, of a regression that may lack a product."""
    rng, n = np.random.default_rng(4), 300
    color = toeplitz(0.9 ** np.arange(n))
    root, shares = np.linalg.cholesky(color), []
    for _ in range(60):
        X = np.cumsum(rng.standard_normal((n, 10)), axis=0) / 5.0
        y = root @ rng.standard_normal(n) + lacking * np.tanh(X[:, 0] * X[:, 1])
        plain, G = np.linalg.pinv(X), np.linalg.solve(root, X)
        efficient = np.linalg.inv(G.T @ G)
        difference = plain @ y - efficient @ G.T @ np.linalg.solve(root, y)
        counted = beyond_chance(difference, plain @ color @ plain.T, efficient)
        shares.append(np.sum(counted**2) / np.sum(difference**2))
    assert least <= np.mean(shares) <= most
    nothing = np.zeros(10)
    assert_allclose(beyond_chance(nothing, 2.0 * efficient, efficient), nothing)
