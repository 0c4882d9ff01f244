import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

from stoop.optimize.ledger import sum_of_squares
from stoop.optimize.normal_equations import TallMatrix, project, solve_damped
from stoop.optimize.secant import Secant


@settings(max_examples=40)
@given(st.integers(0, 30), st.integers(0, 3000))
def test_gram_and_project_are_the_plain_products(v: int, n: int) -> None:
    generator = np.random.default_rng(v * 10_000 + n)
    rows, r = generator.standard_normal((v, n)), generator.standard_normal(n)
    tall, step = TallMatrix.of(rows), generator.standard_normal(v)
    assert tall.gram() == pytest.approx(rows @ rows.T, rel=1e-11, abs=1e-11 * n)
    assert (tall.gram() == tall.gram().T).all()
    for product in (project(rows, r), tall.project(r)):
        assert product == pytest.approx(rows @ r, rel=1e-11, abs=1e-11 * n)
    assert tall.apply(step) == pytest.approx(step @ rows, rel=1e-11, abs=1e-11)
    assert not TallMatrix.of(0.0 * rows).gram().any()


@settings(max_examples=50)
@given(st.integers(0, 1000))
def test_a_matrix_by_stretches_is_that_with_its_zeros(seed: int) -> None:
    generator, parts = np.random.default_rng(seed), []
    for n in (5, 0, 40):
        some = generator.permutation(7)[: generator.integers(0, 8)]
        parts.append((some, generator.standard_normal((len(some), n))))
    tall = TallMatrix.stacked(parts, 7)
    J, step, r = tall.dense(), generator.standard_normal(7), generator.standard_normal(45)
    assert J.shape == tall.shape == (45, 7)
    assert tall.gram() == pytest.approx(J.T @ J, rel=1e-11, abs=1e-11)
    assert tall.project(r) == pytest.approx(J.T @ r, rel=1e-11, abs=1e-11)
    assert tall.apply(step) == pytest.approx(J @ step, rel=1e-11, abs=1e-11)
    chosen, numbers = generator.permutation(7)[:4], generator.integers(0, 45, 9)
    assert np.array_equal(tall.of_variables(chosen).dense(), J[:, chosen])
    assert np.array_equal(tall.rows(numbers), J[numbers])


def test_a_variable_with_huge_numbers_anywhere_has_no_part() -> None:
    tall = TallMatrix.stacked([(np.array([2, 0]), np.ones((2, 3))), (np.array([0, 1]), np.ones((2, 4)))], 3)
    assert tall.below(10.0) is tall
    for bad in (np.nan, np.inf, -1e200):
        tall.parts[1][0, 2] = bad
        left = tall.below(1e100).dense()
        assert not left[:, 0].any()
        assert np.array_equal(left[:, 1:], tall.dense()[:, 1:])


def test_rounding_does_not_depend_on_the_number_of_threads() -> None:
    generator = np.random.default_rng(0)
    rows, r = generator.standard_normal((60, 30000)), generator.standard_normal(30000)
    tall, seen = TallMatrix.of(rows), set()
    for threads in (1, 2, 4):
        with threadpool_limits(threads):
            A, b = tall.gram(), project(rows, r)
            x = solve_damped(A, b, 1e-3)
            parts = [A, b, x, tall.project(r), tall.apply(b), np.array(sum_of_squares(r))]
            seen.add(b"".join(np.ascontiguousarray(part).tobytes() for part in parts))
    assert len(seen) == 1


@given(st.integers(1, 12), st.floats(1e-10, 1e3), st.integers(0, 1000))
def test_solution_does_not_depend_on_units(v: int, damping: float, seed: int) -> None:
    generator = np.random.default_rng(seed)
    rows, b = generator.standard_normal((v, 3 * v)), generator.standard_normal(v)
    units = 10.0 ** generator.uniform(-5, 5, v)  # squares in 1e20, above the floor of 1e-24
    A = rows @ rows.T
    x = solve_damped(A, b, damping)
    assert (A + damping * np.diag(np.diag(A))) @ x == pytest.approx(b, abs=1e-6)
    assert solve_damped(A * np.outer(units, units), b * units, damping) * units == pytest.approx(x, rel=1e-6)


def test_singular_systems_have_a_finite_answer() -> None:
    A = np.ones((3, 3))
    assert np.isfinite(solve_damped(A, np.ones(3), 0.0)).all()
    A = np.diag([1.0, 0.0])
    assert solve_damped(A, np.array([1.0, 0.0]), 1e-3) == pytest.approx([1 / 1.001, 0.0])
    assert solve_damped(np.zeros((2, 2)), np.zeros(2), 1e-3).tolist() == [0.0, 0.0]


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


def test_packed_holds_everything() -> None:
    one = Secant.none(3).at(np.ones(3), np.ones(3), np.eye(3))
    one = one.at(np.arange(3.0), np.array([1.0, 3.0, 9.0]), np.eye(3))
    again = Secant.unpacked(one.packed, 3)
    for name in ("point", "gradient", "correction"):
        assert np.array_equal(getattr(again, name), getattr(one, name))


def test_a_correction_counts_where_the_curvature_stays_positive_definite() -> None:
    def corrected(change: list[float], chosen: list[int]) -> np.ndarray:
        return Secant(np.zeros(2), np.zeros(2), np.diag(change)).corrected(np.eye(2), np.array(chosen))

    assert np.array_equal(corrected([1.0, 2.0], [0, 1]), np.diag([2.0, 3.0]))
    assert np.array_equal(corrected([1.0, -2.0], [0, 1]), np.eye(2))
    assert np.array_equal(corrected([1.0, -2.0], [0]), [[2.0]])
    assert np.array_equal(corrected([1.0, np.nan], [0, 1]), np.eye(2))
