"""The compositions of differential evolution, against a naive twin of the paper's steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop import optimize
from stoop.optimize.population import binomial
from stoop_studies.optimizers.compositions import de_best_2_bin, de_rand_1_bin, ps_gde
from stoop_studies.optimizers.evolution import Islands, chaos, clip
from stoop_studies.optimizers.mutation import (
    ScaledByCost,
    SuccessHistory,
    distinct,
    ordered,
    rand_1,
    weighted_centroid,
)

MAKERS = [ps_gde, de_rand_1_bin, de_best_2_bin]


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
    spent = [state.evaluations.trajectories]
    kinds = []
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


@pytest.mark.parametrize("make", MAKERS)
def test_own_values_take_the_first_places(make: Callable[[], Any], oscillation: Callable[..., Any]) -> None:
    starts = np.array([[0.1, 0.2, 0.3, 0.4], [-1.0, 2.0, 0.5, 0.5]])
    state = make().init(oscillation(), 1, starts)
    assert state.X[:2].tolist() == clip(starts, starts).tolist()
    many = np.random.default_rng(0).random((70, 4))
    assert (many[:50] == make().init(oscillation(), 1, many).X).all()


@pytest.mark.parametrize("make", MAKERS)
def test_every_composition_finds_the_optimum(
    make: Callable[[], Any], oscillation: Callable[..., Any], least: Callable[[Any], float]
) -> None:
    problem = oscillation(extra=0, bias=0.0, seed=3)
    target = least(problem) * 1.0001
    outcome = optimize.minimize(
        replace(make(), members=30), problem, seed=0, stop=optimize.Stop(target_cost=target, budget=30_000)
    )
    assert outcome.status == "target"


@pytest.mark.parametrize("make", MAKERS)
def test_evolution_never_claims_convergence(make: Callable[[], Any], oscillation: Callable[..., Any]) -> None:
    outcome = optimize.minimize(make(), oscillation(), seed=0, stop=optimize.Stop(generations=50))
    assert outcome.status == "generations"
    assert "ran out" in outcome.advice


@pytest.mark.parametrize("mutation", [ordered, rand_1, weighted_centroid, ScaledByCost()])
@pytest.mark.parametrize("structure", [Islands(1), Islands(3)])
def test_what_a_control_has_learnt_is_kept_with_any_mutation_and_structure(
    mutation: Any, structure: Any, oscillation: Callable[..., Any], tmp_path: Path
) -> None:
    """Pieces that no registered method puts together: stored and resumed halfway, the end is the same."""
    made = replace(ps_gde(mutation), control=SuccessHistory(), structure=structure)
    whole = optimize.minimize(made, oscillation(), seed=2, stop=optimize.Stop(generations=50))
    half = optimize.minimize(made, oscillation(), seed=2, stop=optimize.Stop(generations=23))
    optimize.save_state(tmp_path / "state.npz", half.state)
    state = optimize.load_state(tmp_path / "state.npz")
    rest = optimize.minimize(made, oscillation(), seed=2, stop=optimize.Stop(generations=50), state=state)
    assert rest.state.X.tobytes() == whole.state.X.tobytes()
    assert rest.state.memory.scales.tobytes() == whole.state.memory.scales.tobytes()
    assert not (whole.state.memory.scales == 0.5).all()
