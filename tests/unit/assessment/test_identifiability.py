"""A number that is not the data's is called so."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stoop.assessment.covariance import marked
from stoop.assessment.error_bars import Identifiability, identifiability, scaled_singular_values
from stoop.problem.evidence import Unknown, invert


def judge(
    rows: np.ndarray, prior: list[float], box: list[float], size: list[float]
) -> tuple[Identifiability, ...]:
    information = rows.T @ rows + np.diag(np.array(prior) ** -2.0)
    inverse = invert(information)
    unknowns = [
        Unknown(f"C{i}", "parameter", 0.0, *scales)
        for i, scales in enumerate(zip(size, box, prior, strict=True))
    ]
    return identifiability(unknowns, information, marked(inverse.matrix, inverse.determined))


ROWS = np.random.default_rng(0).normal(size=(400, 2))
NONE = [np.inf, np.inf]


def test_a_number_that_is_not_the_data_s_is_called_so() -> None:
    """Rows of the sensitivities, priors, boxes, sizes; whether the second number is identifiable, and the reason."""
    collinear = np.column_stack([ROWS[:, 0], ROWS[:, 0] + 0.01 * ROWS[:, 1]])
    one = [1.0, 1.0]
    for case, rows, prior, box, size, known, reason in (
        ("known", ROWS, NONE, NONE, one, True, ""),
        ("the prior alone", ROWS * [1.0, 1e-4], one, NONE, one, False, "prior-only"),
        ("the box alone", ROWS * [1.0, 0.1], NONE, one, [10.0, 10.0], False, "error-as-box"),
        ("small, its error far smaller than its box", ROWS, NONE, [2.0, 2.0], [1.0, 1e-3], True, ""),
        ("a huge relative error", ROWS * 1e-3, NONE, NONE, [100.0, 1.0], False, "error-beyond-size"),
        ("unseen", ROWS * [1.0, 0.0], NONE, one, one, False, "not-seen"),
        ("collinear", collinear, NONE, NONE, [100.0, 100.0], True, "known-in-combination"),
    ):
        first, second = judge(rows, prior, box, size)
        assert (second.identifiable, getattr(second.reason, "code", "")) == (known, reason), case
        assert (first.name, second.name, first.identifiable) == ("C0", "C1", True), case
        assert second.conditional_std <= second.marginal_std, case
        assert (second.multiple_correlation > 0.999) == (case == "collinear"), case
    known = judge(ROWS, NONE, NONE, one)[0]
    assert known.marginal_std == pytest.approx(0.05, rel=0.1)
    assert judge(ROWS * [1.0, 0.0], NONE, one, one)[1].marginal_std == np.inf


def test_singular_values_do_not_know_units() -> None:
    information = ROWS.T @ ROWS
    scaled = information * np.outer([1e6, 1e-3], [1e6, 1e-3])
    assert_allclose(scaled_singular_values(scaled), scaled_singular_values(information))
    assert scaled_singular_values(np.diag([4.0, 9.0])).tolist() == [1.0, 1.0]
    assert scaled_singular_values(np.ones((2, 2)))[1] == pytest.approx(0.0, abs=1e-7)
