"""The BBOB functions as problems, and the arithmetic of their benchmark."""

from __future__ import annotations

import importlib
import itertools
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop import optimize
from stoop.errors import IdentificationError
from stoop.optimize.problem import ScalarProblem
from stoop_studies import problems
from stoop_studies.problems import bbob

ROOT = Path(__file__).parents[2]
functions = pytest.mark.parametrize("name", bbob.NAMES)


@functions
def test_the_optimum_is_zero_inside_the_box_and_nothing_lies_below(name: str) -> None:
    for instance in (1, 2, 7):
        posed = problems.pose(name, instance)
        assert posed.truth is not None
        x = (posed.truth + 5.0) / 10.0
        assert ((x >= 0.0) & (x <= 1.0)).all()
        assert posed.values(x) == pytest.approx(posed.truth, abs=1e-12)
        assert posed.problem.costs(x[None, :], 0)[0] == pytest.approx(0.0, abs=1e-6)
        X = np.random.default_rng(instance).random((200, 10))
        F = posed.problem.costs(X, 0)
        assert F.min() > -1e-9
        assert posed.reference > posed.target == 1e-8


@functions
def test_many_at_once_are_the_same_as_one_by_one(name: str) -> None:
    problem = problems.pose(name, 3).problem
    X = np.random.default_rng(0).random((20, 10))
    alone = [problem.costs(x[None, :], 0)[0] for x in X]
    assert problem.costs(X, 0).tolist() == alone


def test_the_sphere_and_its_instances_are_what_they_are_called() -> None:
    posed = problems.pose("bbob-01", 4)
    X = np.random.default_rng(1).random((30, 10))
    expected = ((10.0 * X - 5.0 - posed.truth) ** 2).sum(axis=1)
    assert posed.problem.costs(X, 0) == pytest.approx(expected, rel=1e-9)
    other = problems.pose("bbob-01", 5)
    assert other.truth != pytest.approx(posed.truth)


def test_it_has_no_residuals_and_says_so() -> None:
    problem = problems.pose("bbob-08", 1).problem
    assert isinstance(problem, ScalarProblem)
    assert not optimize.Ledger(problem).has_residuals
    with pytest.raises(IdentificationError, match="no residuals"):
        problem.residuals(np.zeros((1, 10)), 0)
    with pytest.raises(IdentificationError, match="no residuals"):
        optimize.minimize(optimize.create("ps-gde-lm"), problem, seed=0)


def test_it_can_be_searched() -> None:
    posed = problems.pose("bbob-08", 1)
    stop = optimize.Stop(generations=10**6, budget=20_000, target_cost=posed.target)
    outcome = optimize.minimize(optimize.create("ordered-shade"), posed.problem, seed=1, stop=stop)
    assert outcome.status == "target"
    assert posed.values(outcome.z) == pytest.approx(posed.truth, abs=1e-3)


def test_bad_requests_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(IdentificationError, match="no instance 0"):
        problems.pose("bbob-01", 0)
    with pytest.raises(IdentificationError, match="knows no flight"):
        problems.pose("bbob-01", 1, flight="x")
    with pytest.raises(IdentificationError, match="bbob-25: there is none"):
        problems.pose("bbob-25", 1)
    monkeypatch.setitem(sys.modules, "ioh", None)
    with pytest.raises(IdentificationError, match=r"pip install '\.\[compare\]'"):
        problems.pose("bbob-01", 1)


@pytest.fixture
def measures(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(ROOT))
    return importlib.import_module("benchmarks.bbob")


@pytest.mark.parametrize(("gained", "lost"), [(0, 0), (3, 1), (1, 6), (10, 10)])
def test_mcnemar_is_a_binomial_tail(measures: Any, gained: int, lost: int) -> None:
    from scipy.stats import binom

    assert measures.mcnemar(gained, lost) == pytest.approx(binom.cdf(gained, gained + lost, 0.5))


def test_sign_flips_count_every_way_of_turning_signs(measures: Any) -> None:
    assert measures.sign_flips(np.array([0, 0])) == 1.0
    assert measures.sign_flips(np.array([-2, 0, -1])) == 0.25
    assert measures.sign_flips(np.array([3, 1, -1])) == pytest.approx(7 / 8)


def test_sign_flips_of_many_functions_are_a_convolution(measures: Any) -> None:
    """Ones are a binomial; 24 unlike ones are as many as there are functions."""
    from scipy.stats import binom

    assert measures.sign_flips(np.array([1] * 17 + [-1] * 23)) == pytest.approx(binom.cdf(17, 40, 0.5))
    sizes = np.random.default_rng(2).integers(-5, 6, size=12)
    signs = np.array(list(itertools.product((-1, 1), repeat=12)))
    expected = (signs @ np.abs(sizes) <= sizes.sum()).mean()
    assert measures.sign_flips(sizes) == pytest.approx(expected, rel=1e-12)


def test_expected_running_time_is_all_evaluations_over_successes(measures: Any) -> None:
    runs = measures.Runs(np.array([[10.0, 30.0], [50.0, 50.0]]), np.array([[True, False], [False, False]]))
    assert runs.ert.tolist() == [40.0, np.inf]
