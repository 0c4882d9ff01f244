from collections.abc import Callable
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.optimize import population as of
from stoop.optimize.population import binomial
from stoop_studies.optimizers.compositions import ps_gde
from stoop_studies.optimizers.evolution import chaos, chaotic_start, clip, placed
from stoop_studies.optimizers.mutation import distinct


def test_a_generation_of_ps_gde_equals_its_naive_twin(oscillation: Callable[..., Any]) -> None:
    problem, optimizer = oscillation(), ps_gde()
    state = optimizer.init(problem, 11, np.empty((0, 4)))
    generator = np.random.Generator(np.random.PCG64(11))
    X = chaos(50, 4, generator)
    assert (state.X == X).all()
    F = problem.costs(X, 2)
    picks = distinct(50, 3, generator)
    V = np.empty_like(X)
    for i in range(50):
        r1, r2, r3 = sorted(picks[:, i], key=lambda m: F[m])
        for j in range(4):
            V[i, j] = min(max(X[i, j] + 0.6 * (X[r1, j] - X[i, j] + X[r2, j] - X[r3, j]), 0.0), 1.0)
    T = binomial(X, V, 0.9, generator)
    G = problem.costs(T, 2)
    after, event = optimizer.step(state, problem)
    for i in range(50):
        assert after.X[i].tolist() == pytest.approx((T if G[i] < F[i] else X)[i].tolist(), rel=1e-14)
    assert event.kind == "evolution"
    assert event.cost == after.F.min() == min(F.min(), G.min())


def test_local_search_replaces_every_twentieth_generation(oscillation: Callable[..., Any]) -> None:
    """Three prey of fifty; each takes D for the gradient, four for the search, one for its end."""
    problem, optimizer = oscillation(), ps_gde()
    state = optimizer.init(problem, 1, np.empty((0, 4)))
    spent, kinds = [state.evaluations.trajectories], []
    for _ in range(40):
        before = state
        state, event = optimizer.step(state, problem)
        kinds.append(event.kind)
        spent.append(state.evaluations.trajectories)
        if event.kind == "refinement":
            worse = np.argsort(before.F)[3:]
            assert (state.X[worse] == before.X[worse]).all()
            assert (state.F <= before.F).all()
    assert [i + 1 for i, kind in enumerate(kinds) if kind == "refinement"] == [20, 40]
    assert np.diff(spent).tolist() == [3 * (4 + 4 + 1) if k == "refinement" else 50 for k in kinds]


def test_chaos_is_the_logistic_map_of_each_variable() -> None:
    X = chaos(30, 4, np.random.default_rng(3))
    c = np.random.default_rng(3).random(4).tolist()
    for row in X:
        assert row.tolist() == c
        c = [4.0 * v * (1.0 - v) for v in c]
    draws = iter(map(np.array, ([0.25, 0.3, 0.75, 0.5], [0.0, 1.0, 0.7], [0.75, 0.6], [0.2])))
    start = chaotic_start(4, Mock(random=lambda n: next(draws)[:n].copy()))
    assert start.tolist() == [0.2, 0.3, 0.6, 0.7], "never where the map is not chaotic"


@given(st.integers(0, 2**32 - 1))
def test_mended_mutants_are_inside_and_others_untouched(seed: int) -> None:
    X = np.random.default_rng(seed).random((12, 5))
    V = X + np.random.default_rng(seed).normal(0.0, 1.0, X.shape)
    inside = (V >= 0) & (V <= 1)
    for mend in (clip, of.midpoint):
        W = mend(V, X)
        assert ((W >= 0) & (W <= 1)).all()
        assert (W[inside] == V[inside]).all()
    assert (clip(V, X)[V < 0] == 0.0).all()
    assert (of.midpoint(V, X)[V < 0] == X[V < 0] / 2).all()
    assert (of.midpoint(V, X)[V > 1] == (X[V > 1] + 1) / 2).all()


def test_own_values_take_the_first_places_inside_the_box() -> None:
    X = np.full((3, 2), 0.5)
    assert placed(X, np.array([[2.0, -1.0]])).tolist() == [[1.0, 0.0], [0.5, 0.5], [0.5, 0.5]]
    assert placed(X, np.zeros((5, 2))).tolist() == [[0.0, 0.0]] * 3
    assert placed(X, np.empty((0, 2))).tolist() == X.tolist() == [[0.5, 0.5]] * 3
