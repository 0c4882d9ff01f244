"""The posterior against closed forms: normal where the model is linear, by quadrature where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from naive.fitted import Fitted, line
from numpy.testing import assert_allclose

from stoop.assessment import sampling
from stoop.assessment.assessment import linearize
from stoop.assessment.posterior import Target, coordinates, stretch
from stoop.assessment.sampling import Chains, sample


def posterior(
    problem: Fitted, z: np.ndarray, covariance: np.ndarray | None = None, seed: int = 0
) -> tuple[Target, Chains]:
    optimum = linearize(problem, z, np.arange(len(z)))
    target = Target(optimum, np.eye(optimum.shared))
    if covariance is not None:
        target = Target(optimum, stretch(target.information, covariance))
    return target, sample(target, coordinates(target), seed)


def straight(extra: int = 0) -> tuple[Fitted, np.ndarray, np.ndarray]:
    """Return a linear problem, its optimum, and the exact covariance of its parameters."""
    random = np.random.default_rng(1)
    X = np.column_stack([np.ones(80), np.linspace(-1, 1, 80), np.exp(-np.linspace(0, 3, 80))])
    y = X @ np.array([0.5, 0.4, 0.5]) + 0.02 * random.normal(size=80)
    information = X.T @ X / 0.0004
    information[3 - extra :, 3 - extra :] += np.eye(extra)
    best = np.linalg.solve(information, X.T @ y / 0.0004)
    return line(X, y, 0.02, extra), best, np.linalg.inv(information)


@pytest.mark.parametrize("extra", [0, 1], ids=["parameters", "with a nuisance"])
def test_a_linear_model_has_the_normal_posterior(extra: int) -> None:
    problem, best, covariance = straight(extra)
    k = 3 - extra
    target, chains = posterior(problem, best)
    draws = chains.draws.reshape(-1, k)
    assert chains.converged
    error = np.sqrt(np.diag(covariance)[:k] / 1000.0)
    assert np.all(np.abs(draws.mean(axis=0) - best[:k]) < 5.0 * error)
    assert_allclose(np.cov(draws.T) / covariance[:k, :k], 1.0, atol=0.15)
    assert np.abs(target.error(draws[:3])).max() < 1e-5


def test_colored_residuals_give_the_corrected_covariance() -> None:
    problem, best, covariance = straight()
    wanted = covariance * np.outer([2.0, 1.0, 3.0], [2.0, 1.0, 3.0])
    _, chains = posterior(problem, best, wanted)
    assert_allclose(np.cov(chains.draws.reshape(-1, 3).T) / wanted, 1.0, atol=0.15)


def test_the_stretch_turns_one_curvature_into_the_other() -> None:
    random = np.random.default_rng(2)
    a, b = random.normal(size=(9, 4)), random.normal(size=(9, 4)) * np.array([1.0, 20.0, 0.1, 1.0])
    information, covariance = a.T @ a, np.linalg.inv(b.T @ b)
    M = stretch(information, covariance)
    assert_allclose(M.T @ information @ M @ covariance, np.eye(4), atol=1e-8)
    assert_allclose(stretch(information, np.linalg.inv(information)), np.eye(4), atol=1e-9)


def test_a_curved_posterior_is_that_of_quadrature(monkeypatch: pytest.MonkeyPatch) -> None:
    """The quantile of 8000 draws is known within 0.03 standard deviations, if they are independent."""
    monkeypatch.setattr(sampling, "SAMPLER", replace(sampling.SAMPLER, draws=2000))
    t = np.linspace(0.0, 1.0, 12)

    def curve(Z: np.ndarray) -> np.ndarray:
        return np.asarray(Z[:, :1] * np.exp(-6.0 * Z[:, 1:2] * t))

    y = curve(np.array([[0.6, 0.5]]))[0] + 0.08 * np.random.default_rng(7).normal(size=12)
    problem = Fitted(lambda Z: (curve(Z) - y) / 0.08, 2)
    a, b = np.meshgrid(*2 * [np.linspace(0.0, 1.0, 401)], indexing="ij")
    points = np.column_stack([a.ravel(), b.ravel()])
    weight = np.exp(-0.5 * np.sum(problem.residuals(points, 0) ** 2, axis=1))
    weight /= weight.sum()
    mean = weight @ points
    std = np.sqrt(weight @ (points - mean) ** 2)
    cumulated = np.cumsum(weight.reshape(401, 401).sum(axis=0))
    upper = np.interp(0.975, cumulated, np.linspace(0.0, 1.0, 401))
    best = points[np.argmax(weight)]
    _, chains = posterior(problem, best)
    draws = chains.draws.reshape(-1, 2)
    assert chains.converged
    assert_allclose(draws.mean(axis=0), mean, atol=0.1 * std.min())
    assert_allclose(draws.std(axis=0), std, rtol=0.05)
    assert np.quantile(draws[:, 1], 0.975) == pytest.approx(upper, abs=0.1 * std[1])
