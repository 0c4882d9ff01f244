"""Posterior draws against quadrature and densities that are known."""

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from naive.fitted import Fitted, line
from numpy.testing import assert_allclose

from stoop.assessment.assessment import linearize
from stoop.errors import IdentificationError
from stoop_analysis import sampling
from stoop_analysis.posterior import Target, coordinates, stretch
from stoop_analysis.sampling import SAMPLER, Chains, Coordinates, check_libraries, hamiltonian, sample

SIZE, SIGMA = 48, 0.02


def posterior(problem: Fitted, z: np.ndarray, covariance: Any = None) -> tuple[Target, Chains, np.ndarray]:
    optimum = linearize(problem, z, np.arange(len(z)))
    target = Target(optimum, np.eye(optimum.shared))
    if covariance is not None:
        target = Target(optimum, stretch(target.information, covariance))
    chains = sample(target, coordinates(target), 0)
    return target, chains, chains.draws.reshape(-1, optimum.shared)


def straight(extra: int = 0) -> tuple[Fitted, np.ndarray, np.ndarray]:
    random = np.random.default_rng(1)
    X = np.column_stack([np.ones(80), np.linspace(-1, 1, 80), np.exp(-np.linspace(0, 3, 80))])
    y, information = X @ np.array([0.5, 0.4, 0.5]) + 0.02 * random.normal(size=80), X.T @ X / 0.0004
    information[3 - extra :, 3 - extra :] += np.eye(extra)
    return line(X, y, 0.02, extra), np.linalg.solve(information, X.T @ y / 0.0004), np.linalg.inv(information)


@pytest.mark.parametrize("extra", [0, 1], ids=["parameters", "with a nuisance"])
def test_a_linear_model_has_the_normal_posterior(extra: int) -> None:
    problem, best, covariance = straight(extra)
    k = 3 - extra
    target, chains, draws = posterior(problem, best)
    assert chains.converged
    assert np.all(np.abs(draws.mean(axis=0) - best[:k]) < 5.0 * np.sqrt(np.diag(covariance)[:k] / 1000.0))
    assert_allclose(np.cov(draws.T) / covariance[:k, :k], 1.0, atol=0.15)
    assert np.abs(target.error(draws[:3])).max() < 1e-5


def test_colored_residuals_give_the_corrected_covariance() -> None:
    problem, best, covariance = straight()
    wanted = covariance * np.outer([2.0, 1.0, 3.0], [2.0, 1.0, 3.0])
    assert_allclose(np.cov(posterior(problem, best, wanted)[2].T) / wanted, 1.0, atol=0.15)


def test_the_stretch_turns_one_curvature_into_the_other() -> None:
    random = np.random.default_rng(2)
    a, b = random.normal(size=(9, 4)), random.normal(size=(9, 4)) * np.array([1.0, 20.0, 0.1, 1.0])
    information, covariance = a.T @ a, np.linalg.inv(b.T @ b)
    M = stretch(information, covariance)
    assert_allclose(M.T @ information @ M @ covariance, np.eye(4), atol=1e-8)
    assert_allclose(stretch(information, np.linalg.inv(information)), np.eye(4), atol=1e-9)


def test_a_curved_posterior_is_that_of_quadrature(monkeypatch: pytest.MonkeyPatch) -> None:
    """The quantile of 8000 draws is known within 0.03 standard deviations, if they are independent."""
    monkeypatch.setattr(sampling, "SAMPLER", replace(SAMPLER, draws=2000))
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
    upper = np.interp(0.975, np.cumsum(weight.reshape(401, 401).sum(axis=0)), np.linspace(0.0, 1.0, 401))
    _, chains, draws = posterior(problem, points[np.argmax(weight)])
    assert chains.converged
    assert_allclose(draws.mean(axis=0), mean, atol=0.1 * std.min())
    assert_allclose(draws.std(axis=0), std, rtol=0.05)
    assert np.quantile(draws[:, 1], 0.975) == pytest.approx(upper, abs=0.1 * std[1])


def chained(bend: float) -> Target:
    """Return a density in which each pair of coordinates, 24 of 48, is a banana.

    With a and b standard normal, x = 1/2 + sigma a and y = 1/2 + sigma / 10 (b + bend (a^2 - 1)); the variance of y is
    (sigma / 10)^2 (1 + 2 bend^2), and both means are 1/2.
    """

    def residuals(Z: np.ndarray) -> np.ndarray:
        a, b = (Z[:, ::2] - 0.5) / SIGMA, (Z[:, 1::2] - 0.5) / (0.1 * SIGMA)
        return np.hstack([a, b - bend * (a**2 - 1.0)])

    z = np.full(SIZE, 0.5)
    z[1::2] -= 0.1 * bend * SIGMA
    return Target(linearize(Fitted(residuals, SIZE), z, np.arange(SIZE)), np.eye(SIZE))


def test_a_banana_in_48_dimensions_has_its_standard_deviations() -> None:
    """The kurtosis of y, 8.3, leaves 2 % of error to the standard deviation of 4000 independent draws."""
    target = chained(1.0)
    chains = sample(target, coordinates(target), 0)
    spread, found = SIGMA * np.tile([1.0, 0.1 * np.sqrt(3.0)], SIZE // 2), chains.draws.reshape(-1, SIZE)
    assert chains.converged
    assert np.sqrt(np.mean((found.std(axis=0) / spread - 1.0) ** 2)) < 0.03
    assert_allclose((found.mean(axis=0) - 0.5) / spread, 0.0, atol=0.1)


@pytest.mark.parametrize("tails", [3.0, 9.0])
def test_the_error_of_standard_deviations_is_their_scatter(tails: float) -> None:
    """Of independent draws of a gamma distribution, whose kurtosis is 3 + 6 / shape."""
    random, size = np.random.default_rng(8), (200, 4, 500, 1)
    drawn = random.gamma(6.0 / (tails - 3.0), size=size) if tails > 3.0 else random.standard_normal(size)
    scatter = np.std([x.std() for x in drawn]) / np.mean([x.std() for x in drawn])
    found = np.mean([Chains.of(x, x[..., 0]).figures["std_error"] for x in drawn])
    assert found == pytest.approx(scatter, rel=0.15)


def test_the_gradient_is_that_of_the_density_at_and_off_the_bounds() -> None:
    target = chained(0.7)
    fitted, random = coordinates(target), np.random.default_rng(3)
    for center in (fitted.center, np.where(np.arange(SIZE) < 4, 0.0, fitted.center)):
        growth = 0.1 * np.tril(random.standard_normal((SIZE, SIZE)), -1)
        chosen = replace(fitted, center=center, growth=growth)
        xi, step = random.standard_normal(SIZE), 1e-5
        value, gradient = chosen.density(target, xi)
        points, volume = chosen.points(np.vstack([xi, xi + step * np.eye(SIZE), xi - step * np.eye(SIZE)]))
        heights = volume - 0.5 * np.sum(target.optimum.problem.residuals(points, 0) ** 2, axis=1)
        assert value == pytest.approx(heights[0], rel=1e-12)
        differences = (heights[1 : SIZE + 1] - heights[SIZE + 1 :]) / (2.0 * step)
        assert_allclose(gradient, differences, rtol=1e-4, atol=1e-4)


def test_the_volume_is_the_determinant_of_the_map() -> None:
    random, k, step = np.random.default_rng(4), 5, 1e-6
    chosen = Coordinates.straight(random.uniform(0.0, 1.0, k), 0.2 * random.standard_normal((k, k)))
    chosen, xi = chosen.bent(random.standard_normal((k, k, k))), random.standard_normal(k)
    ends, _ = chosen.points(np.vstack([xi + step * np.eye(k), xi - step * np.eye(k)]))
    jacobian = (ends[:k] - ends[k:]).T / (2.0 * step)
    constant = np.linalg.slogdet(chosen.factor)[1] + np.sum(np.log1p(-np.exp(-1.0 / chosen.corner)))
    assert chosen.points(xi[None])[1][0] + constant == pytest.approx(np.linalg.slogdet(jacobian)[1], abs=1e-6)


def test_the_same_seed_gives_the_same_draws_on_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sampling, "SAMPLER", replace(SAMPLER, draws=50, tuning=50))
    target, draws = chained(0.4), []
    for threads, seed in ((1, 3), (4, 3), (4, 4)):
        monkeypatch.setattr(sampling, "thread_count", lambda threads=threads: threads)
        draws.append(next(hamiltonian(target, coordinates(target), seed, print)).draws)
    assert np.array_equal(draws[0], draws[1])
    assert not np.array_equal(draws[0], draws[2])


def test_the_posterior_says_how_to_install_nutpie_and_arviz(monkeypatch: pytest.MonkeyPatch) -> None:
    check_libraries()
    for name in ("nutpie", "arviz"):
        with monkeypatch.context() as without:
            without.setitem(sys.modules, name, None)
            with pytest.raises(IdentificationError, match=r"pip install '\.\[posterior\]'"):
                check_libraries()
