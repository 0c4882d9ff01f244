"""Information and its inverse: units, priors, nuisances, directions without information."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from stoop.assessment.covariance import (
    correlation,
    data_information,
    inverse_information,
    standard_errors,
)
from stoop.assessment.error_bars import estimate_uncertainty
from stoop.problem.evidence import PieceEvidence, invert, invert_rows


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


def test_two_that_only_show_as_a_sum_are_both_unknown() -> None:
    rows = np.random.default_rng(0).normal(size=(50, 2))
    rows = np.column_stack([rows[:, 0], rows[:, 1], 1e3 * rows[:, 1]])
    found = invert(rows.T @ rows)
    assert found.determined.tolist() == [True, False, False]
    held = invert(rows.T @ rows + np.diag([0.0, 0.0, 100.0]))
    assert held.determined.all()
    assert standard_errors(held.matrix)[2] == pytest.approx(0.1, rel=1e-3)


def nearly_collinear() -> np.ndarray:
    """Return sensitivities (154, 3) of y = b1 (b2 + x)^(-1 / b3), the model of NIST's Bennett5, near its values."""
    x, (b1, b2, b3) = np.linspace(10.0, 12.0, 154), (-2523.5, 46.74, 0.93218)
    power = (b2 + x) ** (-1.0 / b3)
    return np.column_stack([power, -b1 / b3 * power / (b2 + x), b1 * np.log(b2 + x) / b3**2 * power])


def exact_errors(rows: np.ndarray, prior: np.ndarray) -> list[float]:
    """Return the standard errors of rows and the information of priors, with 60 digits (mpmath)."""
    with mpmath.workdps(60):
        exact = mpmath.matrix(rows.tolist())
        inverse = (exact.T * exact + mpmath.matrix(prior.tolist())) ** -1
        return [float(mpmath.sqrt(inverse[i, i])) for i in range(len(prior))]


@pytest.mark.parametrize("prior", [np.zeros((3, 3)), np.diag([1e-9, 0.0, 0.0])])
def test_standard_errors_have_the_digits_of_the_sensitivities(prior: np.ndarray) -> None:
    """At a condition number of 2.5e5 the product of the rows leaves 5 digits, their QR and singular values 11."""
    rows = nearly_collinear()
    wanted = exact_errors(rows, prior)
    product = standard_errors(invert(rows.T @ rows + prior).matrix)
    assert np.max(np.abs(product / wanted - 1.0)) > 1e-9
    cut = [PieceEvidence(np.zeros((77, 1)), part[:, None, :]) for part in (rows[:77], rows[77:])]
    found = estimate_uncertainty(cut, prior)
    assert_allclose(standard_errors(found.cramer_rao), wanted, rtol=1e-10)
    assert_allclose(standard_errors(inverse_information(cut, prior).matrix), wanted, rtol=1e-10)
    if not prior.any():
        assert_allclose(standard_errors(invert_rows(rows).matrix), wanted, rtol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_rows_and_their_product_have_the_same_inverse(seed: int) -> None:
    """Pieces with unknowns of their own, priors that are correlated, an inflation, directions without information."""
    random = np.random.default_rng(seed)
    jacobians = [random.normal(size=(9000, 2, 6)), random.normal(size=(3, 2, 6))]
    jacobians[0][:, :, 4:], jacobians[1][:, :, 3] = 0.0, 0.0
    for jacobian in jacobians:
        jacobian[:, :, 1] = 2.0 * jacobian[:, :, 0]  # they only show as a sum
    pieces = [PieceEvidence(np.zeros(jacobian.shape[:2]), jacobian) for jacobian in jacobians]
    root = random.normal(size=(2, 2))
    for prior in (np.zeros((6, 6)), np.pad(1e4 * root.T @ root, (0, 4))):
        by_product = invert(4.0 * data_information(pieces) + prior)
        found = inverse_information(pieces, prior, 4.0)
        assert found.determined.tolist() == by_product.determined.tolist()
        assert found.determined[:2].all() == prior.any()
        assert_allclose(found.matrix, by_product.matrix, rtol=1e-8, atol=1e-12)
        assert_allclose(found.eigenvalues, by_product.eigenvalues, rtol=1e-8, atol=1e-12)


def test_rows_without_information() -> None:
    for shape in ((0, 3), (0, 0), (5, 0), (2, 2)):
        found = invert_rows(np.zeros(shape))
        assert found.determined.tolist() == [False] * shape[1]
        assert not found.matrix.any()


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
