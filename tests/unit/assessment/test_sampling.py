"""Samplers against densities in 48 dimensions whose moments are known; coordinates against differences of themselves."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from naive.fitted import Fitted
from numpy.testing import assert_allclose

from stoop.assessment import sampling
from stoop.assessment.assessment import linearize
from stoop.assessment.posterior import Target, coordinates
from stoop.assessment.sampling import SAMPLER, Chains, Coordinates, ensemble, hamiltonian, libraries
from stoop.errors import IdentificationError

Sampler = Callable[..., Any]
SIZE = 48
SIGMA = 0.02


def silent(_: str) -> None:
    pass


def converged(sampler: Sampler, target: Any, chosen: Coordinates, seed: int = 0) -> Any:
    """Return the first chains that have converged, else the last."""
    for chains in sampler(target, chosen, seed, silent):
        if chains.converged:
            break
    return chains


def chained(bend: float, size: int = SIZE) -> Target:
    """Return a density in which each pair of coordinates, 24 of 48, is a banana.

    With a and b standard normal, x = 1/2 + sigma a and y = 1/2 + sigma / 10 (b + bend (a^2 - 1)); the variance of y is
    (sigma / 10)^2 (1 + 2 bend^2), and both means are 1/2.
    """

    def residuals(Z: np.ndarray) -> np.ndarray:
        a, b = (Z[:, ::2] - 0.5) / SIGMA, (Z[:, 1::2] - 0.5) / (0.1 * SIGMA)
        return np.hstack([a, b - bend * (a**2 - 1.0)])

    z = np.full(size, 0.5)
    z[1::2] -= 0.1 * bend * SIGMA
    return Target(linearize(Fitted(residuals, size), z, np.arange(size)), np.eye(size))


def spread(bend: float, size: int = SIZE) -> np.ndarray:
    """Return the standard deviations (size,) of such a density."""
    return SIGMA * np.tile([1.0, 0.1 * np.sqrt(1.0 + 2.0 * bend**2)], size // 2)


def test_a_banana_in_48_dimensions_has_its_standard_deviations() -> None:
    """The kurtosis of y, 8.3, leaves 2 % of error to the standard deviation of 4000 independent draws."""
    target = chained(1.0)
    chains = converged(hamiltonian, target, coordinates(target))
    found = chains.draws.reshape(-1, SIZE)
    assert chains.converged
    assert np.sqrt(np.mean((found.std(axis=0) / spread(1.0) - 1.0) ** 2)) < 0.03
    assert_allclose((found.mean(axis=0) - 0.5) / spread(1.0), 0.0, atol=0.1)


@pytest.mark.parametrize("tails", [3.0, 9.0])
def test_the_error_of_standard_deviations_is_their_scatter(tails: float) -> None:
    """Of independent draws of a gamma distribution, whose kurtosis is 3 + 6 / shape."""
    random, shape = np.random.default_rng(8), 6.0 / (tails - 3.0) if tails > 3.0 else np.inf
    size = (200, 4, 500, 1)
    drawn = random.standard_normal(size) if np.isinf(shape) else random.gamma(shape, size=size)
    scatter = np.std([x.std() for x in drawn]) / np.mean([x.std() for x in drawn])
    found = np.mean([Chains.of("none", x, x[..., 0]).figures["std_error"] for x in drawn])
    assert found == pytest.approx(scatter, rel=0.15)


def test_walkers_in_12_dimensions_have_the_standard_deviations() -> None:
    half = np.full(12, 0.5)
    problem = Fitted(lambda Z: (Z - half) / SIGMA, 12)
    target = Target(linearize(problem, half, np.arange(12)), np.eye(12))
    chains = converged(ensemble, target, coordinates(target))
    ratio = chains.draws.reshape(-1, 12).std(axis=0) / SIGMA
    assert chains.library == "emcee"
    assert np.sqrt(np.mean((ratio - 1.0) ** 2)) < 0.03


def test_the_gradient_is_that_of_the_density_at_and_off_the_bounds() -> None:
    target = chained(0.7)
    fitted = coordinates(target)
    random = np.random.default_rng(3)
    for center in (fitted.center, np.where(np.arange(SIZE) < 4, 0.0, fitted.center)):
        growth = 0.1 * np.tril(random.standard_normal((SIZE, SIZE)), -1)
        chosen = replace(fitted, center=center, growth=growth)
        xi, step = random.standard_normal(SIZE), 1e-5
        value, gradient = chosen.density(target, xi)
        points, volume = chosen.points(np.vstack([xi, xi + step * np.eye(SIZE), xi - step * np.eye(SIZE)]))
        heights = target(points) + volume
        assert value == pytest.approx(heights[0], rel=1e-12)
        differences = (heights[1 : SIZE + 1] - heights[SIZE + 1 :]) / (2.0 * step)
        assert_allclose(gradient, differences, rtol=1e-4, atol=1e-4)


def test_the_volume_is_the_determinant_of_the_map() -> None:
    random, k, step = np.random.default_rng(4), 5, 1e-6
    chosen = Coordinates.straight(random.uniform(0.0, 1.0, k), 0.2 * random.standard_normal((k, k)))
    chosen = chosen.bent(random.standard_normal((k, k, k)))
    xi = random.standard_normal(k)
    ends, _ = chosen.points(np.vstack([xi + step * np.eye(k), xi - step * np.eye(k)]))
    jacobian = (ends[:k] - ends[k:]).T / (2.0 * step)
    constant = np.linalg.slogdet(chosen.factor)[1] + np.sum(np.log1p(-np.exp(-1.0 / chosen.corner)))
    assert chosen.points(xi[None])[1][0] + constant == pytest.approx(np.linalg.slogdet(jacobian)[1], abs=1e-6)


def test_the_same_seed_gives_the_same_draws_on_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sampling, "SAMPLER", replace(SAMPLER, draws=50, tuning=50))
    target = chained(0.4)
    draws = []
    for threads, seed in ((1, 3), (4, 3), (4, 4)):
        monkeypatch.setattr(sampling, "thread_count", lambda threads=threads: threads)
        draws.append(next(hamiltonian(target, coordinates(target), seed, silent)).draws)
    assert np.array_equal(draws[0], draws[1])
    assert not np.array_equal(draws[0], draws[2])


@pytest.mark.parametrize(
    ("missing", "drawn"), [({"nutpie"}, "emcee"), (set(), "nutpie"), ({"nutpie", "emcee"}, "")]
)
def test_walkers_stand_in_where_nutpie_is_not_installed(
    missing: set[str], drawn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = importlib.import_module

    def without(name: str, *others: Any) -> Any:
        if name in missing:
            raise ImportError(name)
        return real(name, *others)

    monkeypatch.setattr(importlib, "import_module", without)
    if drawn:
        assert libraries() == drawn
    else:
        with pytest.raises(IdentificationError, match=r"pip install '\.\[posterior\]'"):
            libraries()
