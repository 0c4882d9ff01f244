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


def code(one: Identifiability) -> str:
    return "" if one.reason is None else one.reason.code


ROWS = np.random.default_rng(0).normal(size=(400, 2))
NONE = [np.inf, np.inf]


def test_what_the_data_tell() -> None:
    found = judge(ROWS, NONE, NONE, [1.0, 1.0])
    assert all(one.identifiable and not one.reason for one in found)
    assert [one.name for one in found] == ["C0", "C1"]
    assert found[0].conditional_std <= found[0].marginal_std == pytest.approx(0.05, rel=0.1)
    assert found[0].multiple_correlation < 0.2


def test_only_the_prior_speaks() -> None:
    weak = ROWS * [1.0, 1e-4]
    found = judge(weak, [1.0, 1.0], NONE, [1.0, 1.0])
    assert found[0].identifiable
    assert not found[1].identifiable
    assert code(found[1]) == "prior-only"


def test_only_the_box_speaks() -> None:
    found = judge(ROWS * [1.0, 0.1], NONE, [1.0, 1.0], [10.0, 10.0])
    assert found[0].identifiable
    assert not found[1].identifiable
    assert code(found[1]) == "error-as-box"


def test_small_but_well_bounded_is_identifiable() -> None:
    # A cross term of nearly zero with an error far smaller than its box is knowledge, not ignorance.
    assert judge(ROWS, NONE, [2.0, 2.0], [1e-3, 1e-3])[0].identifiable


def test_huge_relative_error_without_any_yardstick() -> None:
    found = judge(ROWS * 1e-3, NONE, NONE, [1.0, 100.0])
    assert not found[0].identifiable
    assert code(found[0]) == "error-beyond-size"
    assert found[1].identifiable


def test_unseen() -> None:
    found = judge(ROWS * [1.0, 0.0], NONE, [1.0, 1.0], [1.0, 1.0])
    assert not found[1].identifiable
    assert found[1].marginal_std == np.inf
    assert code(found[1]) == "not-seen"


def test_collinear_is_said_but_not_condemned() -> None:
    rows = np.column_stack([ROWS[:, 0], ROWS[:, 0] + 0.01 * ROWS[:, 1]])
    found = judge(rows, NONE, NONE, [100.0, 100.0])
    assert found[0].identifiable
    assert code(found[0]) == "known-in-combination"
    assert found[0].multiple_correlation > 0.999


def test_singular_values_do_not_know_units() -> None:
    information = ROWS.T @ ROWS
    scaled = information * np.outer([1e6, 1e-3], [1e6, 1e-3])
    assert_allclose(scaled_singular_values(scaled), scaled_singular_values(information))
    assert scaled_singular_values(np.diag([4.0, 9.0])).tolist() == [1.0, 1.0]
    assert scaled_singular_values(np.ones((2, 2)))[1] == pytest.approx(0.0, abs=1e-7)
