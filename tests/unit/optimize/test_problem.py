from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stoop.optimize import forward_jacobian

PLACES = np.array([[0.3, 0.6], [1.0, 0.0], [0.0, 1.0], [1.0 - 1e-9, 0.5]])


def _problem(residuals: Callable[[np.ndarray], np.ndarray], extra: int = 0) -> Any:
    asked: list[np.ndarray] = []

    def counted(Z: np.ndarray, rung: int) -> np.ndarray:
        asked.extend(Z)
        return residuals(Z)

    return SimpleNamespace(dimension=2, extra=extra, prices=(0.25, 1.0), residuals=counted, asked=asked)


def _smooth(Z: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(Z[:, 0]) * Z[:, 1], np.exp(Z[:, 1]), Z[:, 0] ** 2], axis=1)


def test_forward_jacobian_agrees_with_the_derivative_and_stays_in_the_box() -> None:
    for z in PLACES:
        problem = _problem(_smooth)
        jacobian, spent = forward_jacobian(problem, z, 0, _smooth(z[None, :])[0])
        a, b = z
        exact = np.array([[np.cos(a) * b, np.sin(a)], [0.0, np.exp(b)], [2.0 * a, 0.0]])
        assert jacobian == pytest.approx(exact, abs=1e-6)
        assert spent == pytest.approx(2 * 0.25)
        assert all((x >= 0).all() and (x <= 1).all() for x in problem.asked)


def test_a_nuisance_has_no_upper_bound() -> None:
    problem = _problem(lambda Z: Z**2, extra=1)
    z = np.array([0.5, 0.5, 7.0])
    jacobian, _ = forward_jacobian(problem, z, 1, z**2)
    assert jacobian == pytest.approx(np.diag(2.0 * z), abs=1e-5)
    assert max(x[2] for x in problem.asked) > 7.0


def test_a_column_that_diverges_is_taken_backward_and_paid_for_or_is_zero() -> None:
    z = np.array([0.5, 0.5])
    for bad, expected in ((lambda x: x > 0.5, np.eye(2)), (lambda x: x != 0.5, np.diag([0.0, 1.0]))):
        problem = _problem(lambda Z, bad=bad: np.where(bad(Z[:, :1]), np.nan, Z))
        jacobian, spent = forward_jacobian(problem, z, 1, z)
        assert jacobian == pytest.approx(expected, abs=1e-6)
        assert spent == 3.0
