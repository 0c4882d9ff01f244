from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stoop.optimize.population import binomial
from stoop_studies.optimizers.compositions import ps_gde
from stoop_studies.optimizers.evolution import chaos
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
