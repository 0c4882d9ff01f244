"""Correlated pairs, partners and blind directions where algebra gives them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stoop.assessment.covariance import correlation
from stoop.assessment.error_bars import marginal_information, near_null_directions, partners, worst_pairs

NAMES = ("a", "b", "c", "d")


def test_the_sum_of_two_is_seen_and_their_difference_is_not() -> None:
    random = np.random.default_rng(0)
    common = random.normal(size=500)
    J = np.column_stack([common, common + 1e-4 * random.normal(size=500), 5.0 * random.normal(size=500)])
    (dark,) = near_null_directions(NAMES[:3], J.T @ J, np.full(3, 1e6))
    assert set(dark.changes) == {"a", "b"}
    assert dark.changes["a"] == pytest.approx(-dark.changes["b"], rel=1e-3)
    assert dark.singular_value < 1e-3
    step = np.array([dark.changes["a"], dark.changes["b"], 0.0])
    assert float(np.sum((J @ step) ** 2)) == pytest.approx(1.0, rel=0.05)  # the cost rises by 1
    assert dark.words is not None
    assert dark.words.code == "direction-together"
    assert "a by +" in str(dark.words) or "b by +" in str(dark.words)


def test_what_the_data_do_not_see_at_all_comes_first() -> None:
    (dark,) = near_null_directions(("a", "b"), np.diag([2.0, 0.0]), np.ones(2))
    assert dark.changes == {"b": 1.0}
    assert dark.words is not None
    assert (dark.words.code, dark.words.subject) == ("direction-not-seen", "b")
    assert dark.singular_value == 0.0


def test_well_separated_parameters_have_no_blind_direction() -> None:
    assert near_null_directions(("a", "b"), np.array([[1.0, 0.3], [0.3, 4.0]]), np.ones(2)) == ()


def test_marginal_information_is_the_inverse_of_the_block_of_the_covariance() -> None:
    A = np.random.default_rng(2).normal(size=(20, 4))
    whole = A.T @ A
    assert_allclose(marginal_information(whole, 2), np.linalg.inv(np.linalg.inv(whole)[:2, :2]), rtol=1e-9)
    assert_allclose(marginal_information(whole, 4), whole)


def test_pairs_and_partners() -> None:
    covariance = np.array(
        [[1.0, 0.95, 0.0, 0.0], [0.95, 1.0, 0.0, 0.0], [0.0, 0.0, 4.0, -1.6], [0.0, 0.0, -1.6, 1.0]]
    )
    related = correlation(covariance)
    (pair,) = worst_pairs(NAMES, related)
    assert (pair.first, pair.second, pair.correlation) == ("a", "b", pytest.approx(0.95))
    assert partners(NAMES, related, 0) == ("b",)
    assert partners(NAMES, related, 2) == ("d",)


def test_a_step_that_would_more_than_double_a_parameter_is_cut() -> None:
    J = np.column_stack([np.ones(50), np.ones(50) + 1e-9 * np.arange(50)])
    (dark,) = near_null_directions(("a", "b"), J.T @ J, np.array([0.5, 2.0]))
    assert dark.changes["a"] == pytest.approx(0.5)
    assert dark.changes["b"] == pytest.approx(-0.5, rel=1e-3)
