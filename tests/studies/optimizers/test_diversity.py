"""What follows selection: exchange between islands, acceleration, migration, second mutation; and local search."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop import optimize
from stoop.optimize.ledger import Evaluations, Ledger
from stoop_studies.optimizers.compositions import ps_gde
from stoop_studies.optimizers.evolution import (
    Acceleration,
    Islands,
    Migration,
    RingMigration,
    SecondMutation,
    Selected,
    relative_variance,
    scattered,
)
from stoop_studies.optimizers.local_search import LevenbergMarquardt, PreySchedule


class Bowl:
    dimension, extra, prices = 3, 0, (1.0,)

    def costs(self, X: np.ndarray, rung: int) -> np.ndarray:
        return 2.0 + ((X - 0.4) ** 2).sum(axis=1)


def selected(X: np.ndarray, improved: bool = False, F: np.ndarray | None = None) -> Selected:
    F = Bowl().costs(X, 0) if F is None else F
    return Selected(X, F, F + 1.0 if improved else F)


def pen() -> Ledger:
    return Ledger(Bowl(), Evaluations.none(Bowl()))


def cloud(n: int = 12, spread: float = 1.0, seed: int = 0) -> np.ndarray:
    return 0.9 - spread * 0.8 * np.random.default_rng(seed).random((n, 3))


# ----------------------------------------------------------------------------------------------- islands
def test_in_a_ring_the_best_of_each_island_comes_to_the_next() -> None:
    islands, now = Islands(3), selected(cloud(18))
    X, F = RingMigration(islands, 1.0)(now, pen(), np.random.default_rng(0))
    places = islands.places(18)
    for k, place in enumerate(places):
        source = places[k - 1]
        best = now.X[source][now.F[source].argmin()]
        changed = np.flatnonzero((X[place] != now.X[place]).any(axis=1))
        assert len(changed) == 1
        assert X[place][changed[0]].tolist() == best.tolist()
        assert F[place][changed[0]] == now.F[source].min()
        assert F[place].min() <= now.F[place].min()


def test_a_ring_evaluates_nothing_and_keeps_quiet_without_luck_or_neighbors() -> None:
    ledger, now = pen(), selected(cloud(18))
    assert RingMigration(Islands(3), 0.0)(now, ledger, np.random.default_rng(0))[0] is now.X
    assert RingMigration(Islands(1), 1.0)(now, ledger, np.random.default_rng(0))[0] is now.X
    RingMigration(Islands(3), 1.0)(now, ledger, np.random.default_rng(0))
    assert ledger.spent == 0.0


# ------------------------------------------------------------------------------------------ acceleration
def test_acceleration_moves_the_best_down_its_gradient_only_when_the_generation_failed() -> None:
    now, ledger = selected(cloud()), pen()
    best = int(now.F.argmin())
    X, F = Acceleration()(now, ledger, np.random.default_rng(0))
    step, descent = X[best] - now.X[best], 0.4 - now.X[best]
    assert step @ descent == pytest.approx(np.linalg.norm(step) * np.linalg.norm(descent), rel=1e-4)
    assert F[best] < now.F[best]
    assert F[best] == Bowl().costs(X[best][None, :], 0)[0]
    assert (np.delete(X, best, axis=0) == np.delete(now.X, best, axis=0)).all()
    assert 4.0 <= ledger.spent <= 3.0 + 5.0
    ledger, content = pen(), selected(cloud(), improved=True)
    assert Acceleration()(content, ledger, np.random.default_rng(0))[0] is content.X
    assert ledger.spent == 0.0


def test_acceleration_at_the_optimum_or_from_infinity_does_no_harm() -> None:
    X = cloud()
    X[3] = 0.4
    after, F = Acceleration(halvings=2)(selected(X), pen(), np.random.default_rng(0))
    assert (after == X).all()
    assert (selected(X).F == F).all()
    lost, ledger = selected(X, F=np.full(12, np.inf)), pen()
    assert Acceleration()(lost, ledger, np.random.default_rng(0))[0] is X
    assert ledger.spent == 0.0


# --------------------------------------------------------------------------------- migration, 2nd mutation
def test_migration_draws_all_but_the_best_anew_once_they_have_contracted() -> None:
    apart, ledger = selected(cloud()), pen()
    assert Migration(width=1e-3)(apart, ledger, np.random.default_rng(0))[0] is apart.X
    assert ledger.spent == 0.0
    together = selected(cloud(spread=1e-4))
    X, F = Migration(width=1e-3)(together, ledger, np.random.default_rng(0))
    best = int(together.F.argmin())
    assert X[best].tolist() == together.X[best].tolist()
    assert F.tolist() == pytest.approx(Bowl().costs(X, 0).tolist())
    assert np.ptp(X, axis=0).min() > 0.3
    assert ledger.spent == 11.0


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_scattered_points_lie_inside_and_mostly_where_there_is_room(seed: int) -> None:
    x = np.array([0.0, 1.0, 0.25])
    points = scattered(x, 400, np.random.default_rng(seed))
    assert ((points >= 0.0) & (points <= 1.0)).all()
    assert (points[:, 2] < 0.25).mean() == pytest.approx(0.25, abs=0.12)


def test_second_mutation_begins_as_costs_become_equal() -> None:
    ledger, spread = pen(), selected(cloud())
    sleepy = SecondMutation(threshold=1e-9)(spread, ledger, np.random.default_rng(0))
    assert sleepy[0] is spread.X
    assert ledger.spent == 0.0
    flat = selected(cloud(200, spread=1e-6))
    X, F = SecondMutation(threshold=1e-4, probability=0.3)(flat, ledger, np.random.default_rng(0))
    moved = (X != flat.X).any(axis=1)
    assert moved.mean() == pytest.approx(0.3, abs=0.1)
    assert not moved[flat.F.argmin()]
    assert ledger.spent == moved.sum()
    assert F.tolist() == pytest.approx(Bowl().costs(X, 0).tolist())
    assert ((X >= 0.0) & (X <= 1.0)).all()


def test_relative_variance_has_no_unit() -> None:
    F = np.array([1.0, 2.0, 6.0])
    assert relative_variance(F) == pytest.approx(np.var(F) / np.mean(F) ** 2)
    assert relative_variance(1e9 * F) == pytest.approx(relative_variance(F))
    assert relative_variance(np.array([1.0, np.inf])) == relative_variance(np.zeros(3)) == np.inf


# ------------------------------------------------------------------------------------------ local search
def test_a_schedule_as_printed_searches_locally_where_the_repaired_one_evolves() -> None:
    repaired, printed = (PreySchedule(LevenbergMarquardt(), period=4, swapped=s) for s in (False, True))
    assert [g for g in range(1, 13) if repaired.due(g)] == [4, 8, 12]
    assert [printed.due(g) for g in range(1, 13)] == [not repaired.due(g) for g in range(1, 13)]


@pytest.mark.parametrize(("share", "members", "number"), [(0.05, 50, 3), (0.05, 30, 2), (0.0, 50, 1)])
def test_half_a_prey_counts_as_one(share: float, members: int, number: int) -> None:
    assert PreySchedule(LevenbergMarquardt(), share=share).number(members) == number


@pytest.mark.parametrize("extra", [0, 1])
def test_a_levenberg_marquardt_search_ends_at_the_optimum_and_is_counted(
    oscillation: Callable[..., Any], near: Callable[[float], np.ndarray], extra: int
) -> None:
    problem = oscillation(extra=extra, bias=0.0)
    ledger, x = Ledger(problem, Evaluations.none(problem)), near(1.02)[:4]
    cost = float(problem.costs(x[None, :], 2)[0])
    problem.spent = 0.0
    y, lower = LevenbergMarquardt()(ledger, x, cost)
    assert lower < 0.1 * cost
    assert lower == pytest.approx(problem.costs(y[None, :], 2)[0])
    assert ledger.spent == pytest.approx(problem.spent - 1.0)
    assert LevenbergMarquardt()(ledger, y, 0.0)[0] is y


def test_levenberg_prey_makes_ps_gde_cheaper(oscillation: Callable[..., Any]) -> None:

    problem = oscillation(extra=0, bias=0.0, seed=3)
    target = 1.05 * 240.0
    stop = optimize.Stop(target_cost=target, budget=30_000)
    plain = optimize.minimize(ps_gde(), problem, seed=0, stop=stop)
    keen = optimize.minimize(ps_gde(prey=PreySchedule(LevenbergMarquardt())), problem, seed=0, stop=stop)
    assert plain.status == keen.status == "target"
    assert keen.trajectories < plain.trajectories
