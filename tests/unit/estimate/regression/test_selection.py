"""Choosing terms: published identities against brute force, and sets of terms that are known."""

from __future__ import annotations

import ast
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive.regression import best_subset, press, rss

from stoop.estimate.regression.least_squares import FrequencyDomain
from stoop.estimate.regression.structure import (
    Choose,
    Model,
    PartialF,
    Press,
    Regression,
    orthogonal,
    parents,
    stepwise,
)
from stoop.vehicle import terms


def rows(y: np.ndarray, X: np.ndarray) -> Regression:
    """Return a regression whose residuals count as white."""
    return Regression(y, X, (slice(0, len(y)),), 1.0, FrequencyDomain())


def drawn(seed: int, n: int = 120, k: int = 8) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((n, k)) @ (np.eye(k) + 0.3 * rng.standard_normal((k, k)))
    return rng.standard_normal(n), X


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_press_is_the_sum_of_squares_of_rows_left_out(seed: int) -> None:
    y, X = drawn(seed, 25, 4)
    assert Model(rows(y, X), (0, 1, 3)).press == pytest.approx(press(y, X[:, [0, 1, 3]]), rel=1e-9)


def test_the_partial_f_is_the_square_of_students_t() -> None:
    y, X = drawn(3)
    columns = (0, 1, 5)
    inverse = np.linalg.inv(X[:, columns].T @ X[:, columns])
    estimate = inverse @ X[:, columns].T @ y
    variance = rss(y, X[:, columns]) / (len(y) - 3) * np.diag(inverse)
    found = [Model(rows(y, X), columns).partial_f(c) for c in columns]
    np.testing.assert_allclose(found, estimate**2 / variance, rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_clear_set_is_found(seed: int) -> None:
    noise, X = drawn(seed)
    y = X[:, [1, 4, 6]] @ [3.0, -2.0, 4.0] + 0.1 * noise
    assert tuple(sorted(stepwise(rows(y, X)).model.columns)) == (1, 4, 6) == best_subset(y, X, 3)
    assert {1, 4, 6} <= set(orthogonal(rows(y, X)).model.columns)  # which takes nothing back


def test_terms_that_cancel_are_found_on_the_way_down() -> None:
    """Alone none of the three explains a thing; the way up from nothing stops at once."""
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((2, 150))
    small = 0.25 * rng.standard_normal(150)
    X = np.column_stack([a, b, -(a + b) + small, *rng.standard_normal((3, 150))])
    y = X[:, :3].sum(axis=1) + 0.01 * rng.standard_normal(150)
    assert sorted(stepwise(rows(y, X)).model.columns) == [0, 1, 2]


def test_chance_alone_brings_in_a_term_as_seldom_as_is_said() -> None:
    """A significance of 0.2 among six candidates: Bonferroni holds it to at most 0.2, and to little less."""
    rule = PartialF(0.2)
    hits = sum(bool(stepwise(rows(*drawn(seed, 60, 6)), rule).model.columns) for seed in range(150))
    assert 0.08 * 150 < hits < 0.28 * 150


def trees(*texts: str) -> list[ast.expr]:
    return [terms.parse(t, {"alpha", "beta", "q", "elevator", "rudder"}, "test") for t in texts]


def test_products_and_powers_stand_on_their_variables() -> None:
    names = (
        "alpha^3",
        "alpha",
        "elevator",
        "alpha*elevator",
        "beta^2",
        "abs(alpha)",
        "2*alpha",
        "rudder*elevator",
    )
    found = parents(trees(*names))
    assert found == ((1,), (), (), (1, 2), (), (), (), (2,))


@pytest.mark.parametrize("criterion", [stepwise, orthogonal])
def test_a_cubic_comes_with_its_linear_term(criterion: Choose) -> None:
    """Cubic alone in truth: counted from another angle there are lower powers, so the linear one is kept."""
    noise, X = drawn(11)
    angle = X[:, 0] / np.std(X[:, 0])
    columns = np.column_stack([angle**3, angle, X[:, 1]])
    data = replace(rows(2.0 * angle**3 + 0.1 * noise, columns), parents=((1,), (), ()))
    assert {0, 1} <= set(criterion(data).model.columns)
    assert criterion(replace(data, parents=())).model.columns[0] == 0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_nothing_is_chosen_without_what_it_stands_on(seed: int) -> None:
    noise, X = drawn(seed, 60, 3)
    columns = np.column_stack([X, X[:, 0] ** 2, X[:, 1] ** 3, X[:, 0] * X[:, 2]])
    y = columns @ np.random.default_rng(seed).choice([0.0, 1.0], 6) + noise
    data = replace(rows(y, columns), parents=((), (), (), (0,), (1,), (0, 2)))
    for criterion in (stepwise, orthogonal, lambda r: stepwise(r, Press())):
        model = criterion(data).model
        assert all(set(data.parents_of(c)) <= set(model.columns) for c in model.columns)
