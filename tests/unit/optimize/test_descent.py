"""The long way down: linear problems, bounds, nothing to stand on, more digits than a cost can show."""

from __future__ import annotations

import numpy as np
from unit.optimize.conftest import Residuals

from stoop import optimize


class Curve(Residuals):
    """Residuals exp(a t) + c - y with the box of the first D variables."""

    def __init__(self, dimension: int, noise: float = 0.1) -> None:
        self.dimension, self.extra = dimension, 3 - dimension
        self.t = np.linspace(0.0, 2.0, 40)
        generator = np.random.default_rng(3)
        self.y = self.model(np.array([0.9, 0.7, -0.2])) + noise * generator.standard_normal(40)

    def model(self, z: np.ndarray) -> np.ndarray:
        return z[1] * np.exp(z[0] * self.t) + z[2]

    def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.array([self.model(z) - self.y for z in Z])

    def costs(self, X: np.ndarray, rung: int) -> np.ndarray:
        raise AssertionError("a descent asks for residuals alone")

    def jacobian(self, z: np.ndarray, rung: int, r: np.ndarray) -> tuple[np.ndarray, float]:
        e = np.exp(z[0] * self.t)
        return np.column_stack([z[1] * self.t * e, e, np.ones_like(e)]), 3.0

    def reference(self, rung: int) -> float:
        return float(((self.y - self.y[0]) ** 2).sum())


def gradient(problem: Curve, z: np.ndarray) -> np.ndarray:
    """Return the cosine between residuals and each column."""
    r, (J, _) = problem.residuals(z[None], 0)[0], problem.jacobian(z, 0, z)
    return J.T @ r / np.linalg.norm(J, axis=0) / np.linalg.norm(r)


def test_the_gradient_vanishes_to_the_last_digits() -> None:
    problem = Curve(dimension=0)
    for start in ((0.5, 0.5, 0.0), (3.0, 0.01, 5.0), (-2.0, 1.0, 0.0)):
        end = optimize.descend(problem, np.array(start), 0)
        assert end.converged
        assert np.abs(gradient(problem, end.z)).max() < 1e-12


def test_bounds_hold() -> None:
    problem = Curve(dimension=2)
    problem.y = 3.0 * problem.y
    end = optimize.descend(problem, np.array([0.5, 0.5, 0.0]), 0)
    assert end.converged
    assert ((end.z[:2] >= 0.0) & (end.z[:2] <= 1.0)).all()
    at_bound = (end.z[:2] == 0.0) | (end.z[:2] == 1.0)
    assert at_bound.any()
    slope = gradient(problem, end.z)
    assert np.abs(slope[np.concatenate([~at_bound, [True]])]).max() < 1e-6
    assert (slope[:2][end.z[:2] == 1.0] < 0.0).all()


def test_starts_that_say_nothing() -> None:
    end = optimize.descend(Curve(dimension=0), np.array([0.7, 0.0, 0.0]), 0, iterations=1)
    assert end.ending == "limit"
    assert end.z[0] == 0.7, "without an amplitude the exponent has no effect, and stays"
    end = optimize.descend(Curve(dimension=0), np.array([1e4, 1.0, 0.0]), 0)
    assert (end.ending, end.cost, end.iterations) == ("diverged", np.inf, 0)
