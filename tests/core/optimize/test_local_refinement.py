"""Both ways down: linear problems, bounds, nothing to stand on, more digits than a cost can show."""

import numpy as np
import pytest
from core.optimize.conftest import Residuals
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop import optimize
from stoop.optimize import Ledger, Settings, refine
from stoop.optimize.ledger import Evaluations
from stoop.optimize.local_refinement import FULL


class Quadratic(Residuals):
    """Residuals linear in z: A z - b; with one nuisance the least-squares answer is known in closed form."""

    dimension, extra, prices = 3, 1, (1.0,)

    def __init__(self, seed: int = 0, target: tuple[float, ...] = (0.3, 0.6, 0.5, 4.0)) -> None:
        generator = np.random.default_rng(seed)
        self.A = generator.standard_normal((20, 4)) * np.array([1.0, 1e3, 1e-3, 1.0])
        self.b = self.A @ np.array(target) + generator.standard_normal(20) * 1e-4

    def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
        return Z @ self.A.T - self.b

    def reference(self, rung: int) -> float:
        return float((self.b**2).sum())


TIGHT = Settings(iterations=200, gain=1e-15, predicted=0.0, stall=200, stall_damping=0.0)


def test_a_linear_problem_is_solved_whatever_its_units() -> None:
    problem = Quadratic()
    end = refine(problem, np.full(4, 0.5), 0, TIGHT)
    assert end.converged
    assert end.z == pytest.approx(np.linalg.lstsq(problem.A, problem.b, rcond=None)[0], rel=1e-4)


def test_bounds_hold_the_parameters_but_not_the_nuisances() -> None:
    problem = Quadratic(target=(1.4, 0.6, 0.5, -7.0))
    ledger = Ledger(problem, Evaluations.none(problem))
    end = refine(ledger, np.array([0.5, 0.5, 0.5, 0.0]), 0, TIGHT)
    assert ((end.z[:3] >= 0.0) & (end.z[:3] <= 1.0)).all()
    assert end.z[0] == 1.0
    assert end.z[3] < -1.0
    gradient = problem.A.T @ (problem.A @ end.z - problem.b)
    free = (end.z > 0.0) & (end.z < 1.0) | (np.arange(4) == 3)
    scale = np.linalg.norm(problem.A, axis=0) * np.sqrt(end.cost)
    assert (np.abs(gradient / scale)[free] < 1e-3).all()


def test_a_start_outside_the_box_is_taken_inside_and_one_that_diverges_is_reported() -> None:
    problem = Quadratic()
    end = refine(problem, np.array([-3.0, 9.0, 0.5, 0.0]), 0, TIGHT)
    assert end.converged
    assert ((end.z[:3] >= 0.0) & (end.z[:3] <= 1.0)).all()
    problem.b[0] = np.nan
    end = refine(problem, np.full(4, 0.5), 0)
    assert (end.ending, end.cost, end.iterations) == ("diverged", np.inf, 0)


def test_steps_into_divergence_are_rejected(oscillation, near):
    problem = oscillation(noise=0.0, bias=0.0)
    free = refine(problem, near(0.95), 2, FULL)
    fence = max(free.z[0], near(0.95)[0]) + 0.05
    problem = oscillation(noise=0.0, bias=0.0, broken=lambda Z: Z[:, 0] > fence)
    fenced = refine(problem, near(0.95), 2, FULL)
    assert free.converged
    assert fenced.converged
    assert fenced.z == pytest.approx(free.z, abs=1e-6)


def test_a_dive_agrees_with_a_known_optimum_instead_of_converging(oscillation, least, near):
    problem, z = oscillation(), near(0.97)
    alone, with_optimum = (Ledger(problem, Evaluations.none(problem)) for _ in range(2))
    whole = refine(alone, z, 2, FULL)
    short = refine(with_optimum, z, 2, FULL, optimum=whole.cost)
    assert (whole.ending, whole.cost) == ("converged", pytest.approx(least(problem), rel=1e-6))
    assert short.ending == "agreed"
    assert whole.cost <= short.cost <= whole.cost * 1.002
    assert with_optimum.spent < alone.spent


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_a_dive_never_rises_and_survives_any_garbage(seed: int) -> None:
    class Garbage(Quadratic):
        generator = np.random.default_rng(seed)

        def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
            R = super().residuals(Z, rung)
            R[self.generator.random(R.shape) < 0.01] = self.generator.choice([np.nan, np.inf, -np.inf, 1e300])
            return R

        def jacobian(self, z: np.ndarray, rung: int, r: np.ndarray) -> tuple[np.ndarray, float]:
            J, spent = super().jacobian(z, rung, r)
            J[self.generator.random(J.shape) < 0.02] = np.nan
            return J, spent

    problem = Garbage()
    start = np.array([0.5, 0.5, 0.5, 0.0])
    end = refine(problem, start, 0, FULL)
    clean = Quadratic().residuals(np.array([start, end.z]), 0)
    if end.ending != "diverged":
        assert np.isfinite(end.z).all()
        assert (clean[1] ** 2).sum() <= (clean[0] ** 2).sum()
        assert ((end.z[:3] >= 0.0) & (end.z[:3] <= 1.0)).all()


class Unexplained(Residuals):
    """Two residuals of which much remains at the minimum x = 0: a Gauss-Newton step leaves 95 % of the way (Fletcher)."""

    def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
        x = Z[:, 0] - 0.5
        return np.column_stack([x + 1.0, 0.95 * x**2 + x - 1.0])


def test_what_a_model_leaves_unexplained_does_not_slow_the_end() -> None:
    """Gauss-Newton alone takes 39 steps here, and stops at 0.005."""
    end = refine(Unexplained(), np.array([0.9]), 0, FULL)
    assert end.converged
    assert end.iterations <= 15
    assert end.z[0] == pytest.approx(0.5, abs=1e-3)


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
