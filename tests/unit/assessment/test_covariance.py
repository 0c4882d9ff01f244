"""Information and its inverse: units, priors, nuisances, directions without information."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from stoop.assessment.covariance import correlation, data_information, marked, standard_errors
from stoop.problem.evidence import PieceEvidence, invert


def information(seed: int, size: int) -> np.ndarray:
    rows = np.random.default_rng(seed).normal(size=(3 * size, size))
    return np.asarray(rows.T @ rows)


@given(st.integers(0, 99), st.integers(1, 8))
@settings(max_examples=30)
def test_inverse_whatever_the_units(seed: int, size: int) -> None:
    matrix = information(seed, size)
    scale = 10.0 ** np.random.default_rng(seed).uniform(-8, 8, size)
    found = invert(matrix * np.outer(scale, scale))
    assert_allclose(found.matrix * np.outer(scale, scale), np.linalg.inv(matrix), rtol=1e-6, atol=1e-8)
    assert found.determined.all()


def test_nuisances_cost_what_the_schur_complement_says() -> None:
    matrix = information(3, 7)
    a, b, d = matrix[:4, :4], matrix[:4, 4:], matrix[4:, 4:]
    schur = a - b @ np.linalg.solve(d, b.T)
    assert_allclose(invert(matrix).matrix[:4, :4], np.linalg.inv(schur), rtol=1e-9)


def test_what_nothing_depends_on_is_unknown() -> None:
    matrix = np.zeros((3, 3))
    matrix[:2, :2] = information(1, 2)
    found = invert(matrix)
    assert found.determined.tolist() == [True, True, False]
    sigma = standard_errors(marked(found.matrix, found.determined))
    assert_allclose(sigma[:2], np.sqrt(np.diag(np.linalg.inv(matrix[:2, :2]))))
    assert sigma[2] == np.inf


def test_two_that_only_show_as_a_sum_are_both_unknown() -> None:
    rows = np.random.default_rng(0).normal(size=(50, 2))
    rows = np.column_stack([rows[:, 0], rows[:, 1], 1e3 * rows[:, 1]])
    found = invert(rows.T @ rows)
    assert found.determined.tolist() == [True, False, False]
    held = invert(rows.T @ rows + np.diag([0.0, 0.0, 100.0]))
    assert held.determined.all()
    assert standard_errors(held.matrix)[2] == pytest.approx(0.1, rel=1e-3)


def test_no_information_at_all() -> None:
    found = invert(np.zeros((2, 2)))
    assert not found.determined.any()
    assert_allclose(found.matrix, 0.0)


def test_missing_measurements_carry_no_information() -> None:
    random = np.random.default_rng(2)
    residual, jacobian = random.normal(size=(20, 2)), random.normal(size=(20, 2, 3))
    residual[4, 1] = np.nan
    jacobian[4, 1] = np.nan
    whole = data_information([PieceEvidence(residual, jacobian)])
    rows = np.delete(jacobian.reshape(-1, 3), 9, axis=0)
    assert_allclose(whole, rows.T @ rows)


def test_correlation_of_what_is_known() -> None:
    covariance = np.array([[4.0, 1.0, np.nan], [1.0, 1.0, np.nan], [np.nan, np.nan, np.inf]])
    matrix = correlation(covariance)
    assert matrix[0, 1] == pytest.approx(0.5)
    assert np.isnan(matrix[0, 2])
    assert_allclose(np.diag(matrix), 1.0)
