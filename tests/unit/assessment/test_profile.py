"""Profile likelihood against closed forms and against a profile computed by brute force."""

from __future__ import annotations

import numpy as np
import pytest
from naive.fitted import Fitted, line
from scipy.optimize import brentq, minimize_scalar

from stoop.assessment.assessment import linearize
from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.profile import ProfileLikelihood

T = np.linspace(0.0, 1.0, 25)


def test_a_linear_model_has_the_interval_of_the_normal_distribution() -> None:
    random = np.random.default_rng(0)
    X = np.column_stack([np.ones(60), np.linspace(-1.0, 1.0, 60), random.normal(size=60)])
    y = X @ np.array([0.5, 0.4, 0.6]) + 0.05 * random.normal(size=60)
    best = np.linalg.lstsq(X, y, rcond=None)[0]
    sigma = 0.05 * np.sqrt(np.diag(np.linalg.inv(X.T @ X)))
    optimum = linearize(line(X, y, 0.05), best, np.arange(3))
    for entry, factor in ((0, 1.0), (1, 2.5), (2, 0.7)):
        found = ProfileLikelihood(optimum, entry, factor)
        half = NORMAL_95 * factor * sigma[entry]
        assert found.lower == pytest.approx(best[entry] - half, abs=0.011 * half)
        assert found.upper == pytest.approx(best[entry] + half, abs=0.011 * half)
        assert found.better < 1e-6


def michaelis(z: np.ndarray) -> np.ndarray:
    """Return a curve whose two parameters are strongly bent together: 2 a t / (b + t)."""
    return np.asarray(2.0 * z[..., :1] * T / (z[..., 1:2] + T))


@pytest.fixture(scope="module")
def bent() -> tuple[Fitted, np.ndarray, np.ndarray]:
    y = michaelis(np.array([0.4, 0.3])) + 0.06 * np.random.default_rng(3).normal(size=len(T))
    problem = Fitted(lambda Z: (michaelis(Z) - y) / 0.06, 2)
    grid = np.linspace(0.02, 1.0, 99)
    start = min(
        ((a, b) for a in grid for b in grid), key=lambda p: float(np.sum((michaelis(np.array(p)) - y) ** 2))
    )
    z = np.array(start)
    for _ in range(50):
        r = problem.residuals(z[None], 0)[0]
        J = problem.jacobian(z, 0, r)[0]
        z = z - np.linalg.solve(J.T @ J, J.T @ r)
    return problem, z, y


def brute(y: np.ndarray, best: float, value: float) -> float:
    """Return the likelihood-ratio statistic of b = value: a is linear, so its best is known exactly."""
    basis = 2.0 * T / (value + T)
    a = np.clip(float(basis @ y / (basis @ basis)), 0.0, 1.0)
    return float(np.sum((a * basis - y) ** 2)) / 0.06**2 - best


def test_a_curved_problem_has_the_interval_found_by_brute_force(
    bent: tuple[Fitted, np.ndarray, np.ndarray],
) -> None:
    problem, z, y = bent
    best = float(np.sum(problem.residuals(z[None], 0) ** 2))
    lower = brentq(lambda b: brute(y, best, b) - NORMAL_95**2, 0.01, z[1])
    upper = brentq(lambda b: brute(y, best, b) - NORMAL_95**2, z[1], 1.0)
    found = ProfileLikelihood(linearize(problem, z, np.arange(2)), 1)
    assert found.lower == pytest.approx(lower, abs=0.02 * (z[1] - lower))
    assert found.upper == pytest.approx(upper, abs=0.02 * (upper - z[1]))
    assert (found.upper - z[1]) / (z[1] - found.lower) > 1.3  # the normal interval would be symmetric
    for value, root in found.points:
        assert root**2 == pytest.approx(max(brute(y, best, value), 0.0), abs=1e-3 + 1e-3 * root**2)


def test_an_end_that_the_data_leave_open_is_none(bent: tuple[Fitted, np.ndarray, np.ndarray]) -> None:
    """Few readings and much noise: no b up to the bound can be refused, a least one can."""
    sparse = np.array([0.3, 0.6, 1.0])
    y = 2.0 * 0.3 * sparse / (0.6 + sparse)
    problem = Fitted(lambda Z: (2.0 * Z[:, :1] * sparse / (Z[:, 1:2] + sparse) - y) / 0.05, 2)
    found = ProfileLikelihood(linearize(problem, np.array([0.3, 0.6]), np.arange(2)), 1)
    assert np.isnan(found.upper)
    rise = minimize_scalar(
        lambda a: float(np.sum(problem.residuals(np.array([[a, 1.0]]), 0) ** 2)),
        bounds=(0, 1),
        method="bounded",
    ).fun
    assert rise < NORMAL_95**2
    assert 0.0 < found.lower < 0.6


def test_at_a_bound_the_other_side_still_has_a_limit() -> None:
    y = np.full(25, -0.01)
    problem = Fitted(lambda Z: (Z[:, :1] - y) / 0.1, 1)
    found = ProfileLikelihood(linearize(problem, np.array([0.0]), np.empty(0, dtype=np.intp)), 0)
    assert np.isnan(found.lower)
    # J rises by 25 ((x + 0.01)^2 - 0.01^2) / 0.1^2
    assert found.upper == pytest.approx(np.sqrt(NORMAL_95**2 * 0.01 / 25 + 1e-4) - 0.01, rel=0.02)


def test_a_better_optimum_is_reported() -> None:
    problem = Fitted(lambda Z: np.column_stack([10.0 * (Z[:, 0] - 0.6), 10.0 * (Z[:, 1] - 0.5)]), 2)
    found = ProfileLikelihood(linearize(problem, np.array([0.6, 0.45]), np.arange(2)), 0)
    assert found.better > 0.1
