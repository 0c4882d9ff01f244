import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from stoop.optimize import Ledger
from stoop.optimize.ledger import Evaluations
from stoop_studies.optimizers.local_search import SteepestDescent, forward_gradient, golden_section


def test_golden_section_finds_what_scipy_finds() -> None:
    for function in (
        lambda t: (t - 0.37) ** 2, lambda t: np.exp(8 * t) - 30 * t, lambda t: abs(t - 0.81), lambda t: -t, lambda t: t,
        lambda t: np.cos(4 * t),
    ):  # fmt: skip
        ours = golden_section(function, 0.0, 1.0, 1e-6)
        theirs = minimize_scalar(function, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9}).x
        assert ours == pytest.approx(theirs, abs=4e-6)


class Bowl:
    dimension, extra, prices = 3, 0, (0.5, 1.0)
    weights = np.array([1.0, 4.0, 0.5])

    def costs(self, X: np.ndarray, rung: int) -> np.ndarray:
        return ((X - 0.45) ** 2) @ self.weights


def test_a_search_goes_down_the_gradient_and_never_up() -> None:
    ledger = Ledger(Bowl(), Evaluations.none(Bowl()))
    for x in np.array([[0.2, 1.0, 0.9], [0.2, 0.3, 0.9]]):
        cost, before = float(Bowl().costs(x[None, :], 1)[0]), ledger.spent
        assert forward_gradient(ledger, x, cost) == pytest.approx(2 * Bowl.weights * (x - 0.45), abs=1e-5)
        assert ledger.spent == before + 3.0
    y, lower = SteepestDescent()(ledger, x, cost)
    direction = -Bowl.weights * (x - 0.45)
    step = y - x
    assert step @ direction == pytest.approx(np.linalg.norm(step) * np.linalg.norm(direction), rel=1e-6)
    assert np.linalg.norm(step) <= 0.1
    assert lower == Bowl().costs(y[None, :], 1)[0] < cost
    best = np.full(3, 0.45)
    assert SteepestDescent()(ledger, best, 0.0)[0] is best
