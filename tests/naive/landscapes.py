"""Problems of which only the cost is known."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stoop.optimize.problem import ScalarProblem

PLACE = 0.3137  # of the optimum, in every variable


def sphere(X: np.ndarray) -> np.ndarray:
    return ((X - PLACE) ** 2).sum(axis=1)


def ellipsoid(X: np.ndarray) -> np.ndarray:
    return (10.0 ** np.linspace(0.0, 3.0, X.shape[1]) * (X - PLACE) ** 2).sum(axis=1)


def rosenbrock(X: np.ndarray) -> np.ndarray:
    Z = 4.0 * X - 2.0
    return (100.0 * (Z[:, 1:] - Z[:, :-1] ** 2) ** 2 + (1.0 - Z[:, :-1]) ** 2).sum(axis=1)


def rastrigin(X: np.ndarray) -> np.ndarray:
    Z = 10.0 * (X - PLACE)
    return (10.0 + Z**2 - 10.0 * np.cos(2.0 * np.pi * Z)).sum(axis=1)


@dataclass
class Only(ScalarProblem):
    """A cost and nothing else; remembers how much was asked of it, and how far outside the box."""

    cost: Callable[[np.ndarray], np.ndarray]
    dimension: int = 5
    asked: int = 0
    outside: float = 0.0

    def costs(self, X: np.ndarray, rung: int) -> np.ndarray:
        assert rung == 0
        self.asked += len(X)
        self.outside = max(self.outside, float(np.abs(X - 0.5).max(initial=0.0) - 0.5))
        return self.cost(X)
