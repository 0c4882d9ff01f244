"""The secant update of Dennis, Gay and Welsch."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stoop.optimize.secant import Secant


@given(st.integers(0, 2**32 - 1), st.integers(2, 8))
def test_the_corrected_curvature_turns_the_step_into_the_change_of_the_gradient(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    root, known = rng.normal(size=(2, n, n))
    hessian, known = root @ root.T + np.eye(n), known @ known.T
    first, second, third = rng.normal(size=(3, n))
    found = Secant.none(n).at(first, hessian @ first, known).at(second, hessian @ second, known)
    found = found.at(third, hessian @ third, known)
    np.testing.assert_allclose(found.correction, found.correction.T, rtol=0.0, atol=1e-8)
    step, change = third - second, hessian @ (third - second)
    np.testing.assert_allclose((known + found.correction) @ step, change, atol=1e-7 * np.abs(change).max())


def test_gradients_that_say_nothing_change_nothing() -> None:
    before = Secant(np.zeros(2), np.zeros(2), np.eye(2))
    after = before.at(np.array([1.0, 0.0]), np.array([-1.0, 0.0]), np.eye(2))  # the gradient falls
    assert np.array_equal(after.correction, np.eye(2))
    assert np.array_equal(after.gradient, [-1.0, 0.0])
    lost = before.at(np.ones(2), np.array([np.nan, 1.0]), np.eye(2))
    assert np.array_equal(lost.correction, np.eye(2))
    assert np.array_equal(lost.at(np.ones(2), np.ones(2), np.eye(2)).correction, np.eye(2))
    with np.errstate(over="ignore", invalid="ignore"):  # its square overflows
        after = before.at(np.array([1.0, 0.0]), np.array([1e200, 0.0]), np.eye(2))
    assert np.isfinite(after.correction).all()


def test_a_correction_counts_where_the_curvature_stays_positive_definite() -> None:
    def corrected(change: list[float], chosen: list[int]) -> np.ndarray:
        return Secant(np.zeros(2), np.zeros(2), np.diag(change)).corrected(np.eye(2), np.array(chosen))

    assert np.array_equal(corrected([1.0, 2.0], [0, 1]), np.diag([2.0, 3.0]))
    assert np.array_equal(corrected([1.0, -2.0], [0, 1]), np.eye(2))
    assert np.array_equal(corrected([1.0, -2.0], [0]), [[2.0]])
    assert np.array_equal(corrected([1.0, np.nan], [0, 1]), np.eye(2))
