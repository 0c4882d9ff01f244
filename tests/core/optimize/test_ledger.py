from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from core.optimize.conftest import Residuals

from stoop.optimize import forward_jacobian
from stoop.optimize.ladder import GATE, Optima, explains, passes
from stoop.optimize.ledger import Evaluations, Halt, Ledger, sum_of_squares
from stoop.optimize.local_refinement import Refinement


class Line(Residuals):
    """Cost x, residual sqrt(x)."""

    extra, prices = 1, (0.25, 1.0)

    def costs(self, X: np.ndarray, rung: int) -> np.ndarray:
        return X[:, 0].copy()

    def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
        return np.sqrt(Z[:, :1])

    def jacobian(self, z: np.ndarray, rung: int, r: np.ndarray) -> tuple[np.ndarray, float]:
        return np.ones((1, 2)), 0.7

    def reference(self, rung: int) -> float:
        return np.nan


def column(*values: float) -> np.ndarray:
    return np.array(values)[:, None]


def ledger(**limits: float) -> Ledger:
    return Ledger(Line(), Evaluations.none(Line()), **limits)


def test_every_call_is_booked_at_its_price() -> None:
    pen = ledger()
    pen.costs(column(3.0, 2.0), 1)
    pen.costs(column(1.0, 1.0, 1.0, 1.0), 0)
    pen.residuals(np.array([[4.0, 0.0]]), 1)
    pen.jacobian(np.array([4.0, 0.0]), 1, np.ones(1))
    assert pen.evaluations.trajectories == pytest.approx(2.0 + 1.0 + 1.0 + 0.7)


def test_only_the_full_record_counts_for_the_best() -> None:
    pen = ledger()
    pen.costs(column(0.1), 0)
    assert pen.evaluations.cost == np.inf
    pen.costs(column(3.0, 2.0, 2.5), 1)
    pen.residuals(np.array([[1.0, 5.0], [9.0, 6.0]]), 1)
    assert pen.evaluations.best.tolist() == [1.0, 5.0]
    assert pen.evaluations.history == pytest.approx(np.array([[1.25, 3.0], [2.25, 2.0], [4.25, 1.0]]))


def test_whatever_is_not_finite_costs_infinity() -> None:
    pen = ledger()
    assert pen.costs(column(np.nan, 2.0, -np.inf, np.inf), 1).tolist() == [np.inf, 2.0, np.inf, np.inf]
    assert pen.evaluations.cost == 2.0
    assert sum_of_squares(np.array([1.0, np.nan])) == np.inf
    assert (sum_of_squares(np.array([1e200, 1.0])), pen.reference(0)) == (np.inf, np.inf)


def test_the_target_is_booked_at_the_candidate_that_reaches_it() -> None:
    pen = ledger(target=1.0)
    with pytest.raises(Halt) as halt:
        pen.costs(column(5.0, 0.9, 0.1, 3.0), 1)
    assert halt.value.status == "target"
    assert (pen.evaluations.trajectories, pen.evaluations.cost) == (2.0, 0.9)


def test_the_budget_is_used_up_and_never_exceeded() -> None:
    pen = ledger(budget=3.6)
    with pytest.raises(Halt) as halt:
        pen.costs(column(5.0, 4.0, 3.0, 0.1), 1)
    assert (halt.value.status, pen.evaluations.trajectories, pen.evaluations.cost) == ("budget", 3.0, 3.0)
    pen.costs(column(1.0, 1.0), 0)
    for ask in (lambda: pen.costs(column(0.1), 0), lambda: pen.jacobian(np.ones(2), 0, np.ones(1))):
        with pytest.raises(Halt):
            ask()
    assert pen.evaluations.trajectories == 3.5
    cheap = Line()
    cheap.prices = (0.1, 1.0)
    pen = Ledger(cheap, Evaluations.none(cheap), budget=1.0)
    for _ in range(10):  # prices that sum to the budget are all spent
        pen.costs(column(1.0), 0)
    assert pen.evaluations.trajectories == pytest.approx(1.0)


def test_evaluations_are_a_page_to_go_back_to() -> None:
    pen, X = ledger(), column(3.0)
    pen.costs(X, 1)
    page = pen.evaluations
    X[0] = 9.0
    pen.costs(column(1.0), 1)
    assert (page.best.tolist(), len(page.history)) == ([3.0, 0.0], 1)
    assert Ledger.at(pen, page) is pen
    for one in (pen, Ledger.at(Line(), page)):
        assert (one.spent, one.cost, len(one.evaluations.history)) == (1.0, 3.0, 1)


def _problem(residuals: Callable[[np.ndarray], np.ndarray], extra: int = 0) -> Any:
    asked: list[np.ndarray] = []

    def counted(Z: np.ndarray, rung: int) -> np.ndarray:
        asked.extend(Z)
        return residuals(Z)

    return SimpleNamespace(dimension=2, extra=extra, prices=(0.25, 1.0), residuals=counted, asked=asked)


def _smooth(Z: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(Z[:, 0]) * Z[:, 1], np.exp(Z[:, 1]), Z[:, 0] ** 2], axis=1)


def test_forward_jacobian_agrees_with_the_derivative_and_stays_in_the_box() -> None:
    for z in np.array([[0.3, 0.6], [1.0, 0.0], [0.0, 1.0], [1.0 - 1e-9, 0.5]]):
        problem = _problem(_smooth)
        jacobian, spent = forward_jacobian(problem, z, 0, _smooth(z[None, :])[0])
        a, b = z
        exact = np.array([[np.cos(a) * b, np.sin(a)], [0.0, np.exp(b)], [2.0 * a, 0.0]])
        assert (jacobian, spent) == (pytest.approx(exact, abs=1e-6), pytest.approx(2 * 0.25))
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
        assert (jacobian, spent) == (pytest.approx(expected, abs=1e-6), 3.0)


def known(reference: float) -> Ledger:
    """Return the ledger of a problem of which nothing but the cost of reference is known."""
    problem: Any = SimpleNamespace(dimension=1, extra=0, prices=(0.5, 1.0), reference=lambda rung: reference)
    return Ledger(problem, Evaluations.none(problem))


def test_gates() -> None:
    for reference, open_ in ((np.nan, True), (np.inf, True), (0.0, False)):
        assert explains(known(reference), 5.0, 0) is open_, "without a reference there is no gate"
    ledger = known(100.0)
    assert explains(ledger, GATE * 100.0, 0)
    assert not explains(ledger, GATE * 100.0 + 1e-9, 0)
    # an imperfect model never explains, but it may do as well as any
    cases = (60.0, np.inf, False), (60.0, 55.0, True), (60.0, 30.0, False), (np.inf, np.inf, False)
    for cost, others, passed in cases:
        assert passes(ledger, cost, 0, np.array([others, np.inf])) is passed


def ends(*rows: Any) -> Optima:
    found = Optima.none(2)
    for cost, lineage, ending in rows:
        found = found.add(Refinement(np.zeros(3), cost, ending, 5), lineage)
    return found


def test_confirmation_needs_two_independent_refinements_to_the_best() -> None:
    for second, confirmed in (
        ([], False),
        ([(100.05, 2, "converged")], True),
        ([(100.05, 2, "agreed")], True),
        ([(100.05, 1, "converged")], False),  # not independent
        ([(100.5, 2, "converged")], False),  # another optimum
        ([(100.05, 2, "limit")], False),
        ([(50.0, 2, "converged")], False),  # a better one: begin again
        ([(50.0, 2, "stalled"), (100.0, 3, "converged")], False),
        ([(300.0, 2, "hopeless"), (100.0, 3, "converged")], True),
    ):
        rows = [(100.0, 1, "converged"), *second]
        assert ends(*rows).confirmed(min(r[0] for r in rows), 1e4) is confirmed, second
    assert not ends((100.0, 1, "stalled"), (100.05, 2, "converged")).confirmed(100.0, 1e4)
    exact = ends((1e-11, 1, "converged"), (3e-12, 2, "converged"))
    assert exact.confirmed(3e-12, 1e4)
    assert not exact.confirmed(3e-12, np.inf)


def test_three_must_agree_where_much_is_left_unexplained() -> None:
    two = ends((100.0, 1, "converged"), (100.05, 2, "agreed"))
    assert two.confirmed(100.0, 1001.0)
    assert not two.confirmed(100.0, 999.0)
    assert two.add(Refinement(np.zeros(3), 100.02, "agreed", 5), 3).confirmed(100.0, 999.0)
    assert not two.add(Refinement(np.zeros(3), 100.02, "agreed", 5), 2).confirmed(100.0, 999.0)
    assert not ends(*[(100.0, i, "agreed") for i in range(4)]).confirmed(100.0, 999.0)
