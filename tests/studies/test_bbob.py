import importlib
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

from stoop_studies import problems
from stoop_studies.problems import bbob


@pytest.mark.parametrize("name", bbob.NAMES)
def test_the_optimum_is_zero_inside_the_box_and_nothing_lies_below(name: str) -> None:
    for instance in (1, 2, 7):
        posed = problems.pose(name, instance)
        assert posed.truth is not None
        x = (posed.truth + 5.0) / 10.0
        assert ((x >= 0.0) & (x <= 1.0)).all()
        assert posed.values(x) == pytest.approx(posed.truth, abs=1e-12)
        assert posed.problem.costs(x[None, :], 0)[0] == pytest.approx(0.0, abs=1e-6)
        assert posed.problem.costs(np.random.default_rng(instance).random((200, 10)), 0).min() > -1e-9
        assert posed.reference > posed.target == 1e-8


def test_the_sphere_and_its_instances_are_what_they_are_called() -> None:
    posed = problems.pose("bbob-01", 4)
    X = np.random.default_rng(1).random((30, 10))
    expected = ((10.0 * X - 5.0 - posed.truth) ** 2).sum(axis=1)
    assert posed.problem.costs(X, 0) == pytest.approx(expected, rel=1e-9)
    assert problems.pose("bbob-01", 5).truth != pytest.approx(posed.truth)


def test_mcnemar_is_a_binomial_tail_and_sign_flips_are_a_convolution(monkeypatch: Any) -> None:
    """Ones are a binomial; 24 unlike ones are as many as there are functions."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2]))
    measures = importlib.import_module("benchmarks.bbob")
    for gained, lost in ((0, 0), (3, 1), (1, 6), (10, 10)):
        assert measures.mcnemar(gained, lost) == pytest.approx(binom.cdf(gained, gained + lost, 0.5))
    assert measures.sign_flips(np.array([1] * 17 + [-1] * 23)) == pytest.approx(binom.cdf(17, 40, 0.5))
    sizes = np.random.default_rng(2).integers(-5, 6, size=12)
    signs = np.array(list(itertools.product((-1, 1), repeat=12)))
    expected = (signs @ np.abs(sizes) <= sizes.sum()).mean()
    assert measures.sign_flips(sizes) == pytest.approx(expected, rel=1e-12)
