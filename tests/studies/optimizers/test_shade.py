"""L-SHADE, jSO and ordered SHADE: their pieces against the definitions, the whole against a naive twin."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from naive.landscapes import Only, ellipsoid, rastrigin, rosenbrock, sphere
from naive.shade import evaluations_to

from stoop import optimize
from stoop.errors import IdentificationError
from stoop.optimize.population import (
    OrderedToPBest,
    ParameterMemory,
    elite,
    success_means,
    two_others,
    update_archive,
)
from stoop_studies.optimizers.local_search import QuasiNewton
from stoop_studies.optimizers.shade import (
    JSO,
    TERMINAL,
    CurrentToPBest,
    LShade,
    OrderedShade,
    elite_but_self,
    keep_best,
    linear_size,
)

SCALES, RATES = np.array([0.2, 0.4, 0.9]), np.array([0.5, 0.0, 1.0])
GAINS, WON = np.array([3.0, 1.0, np.inf]), np.array([True, True, False])


# -------------------------------------------------------------------------------------------------- memory
def test_successful_is_the_weighted_lehmer_mean() -> None:
    scale, rate = success_means(SCALES, RATES, GAINS, WON)
    assert scale == pytest.approx((0.75 * 0.04 + 0.25 * 0.16) / (0.75 * 0.2 + 0.25 * 0.4))
    assert rate == pytest.approx(0.5)


def test_l_shade_keeps_a_rate_of_zero_for_good() -> None:
    memory = ParameterMemory.fresh(2, 0.5, 0.5)
    nothing = np.zeros(3)
    memory = LShade().learn(memory, SCALES, nothing, GAINS, WON)
    assert memory.rates.tolist() == [TERMINAL, 0.5]
    memory = ParameterMemory(memory.scales, memory.rates, 0)
    assert LShade().learn(memory, SCALES, RATES, GAINS, WON).rates[0] == TERMINAL
    _, rates = memory.sample(400, np.random.default_rng(0))
    assert 120 < (rates == 0.0).sum() < 280  # every second entry, and few normal draws below zero


def test_jso_goes_halfway_and_never_learns_its_last_entry() -> None:
    memory = JSO().memory()
    scale, rate = success_means(SCALES, RATES, GAINS, WON)
    for k in range(5):
        memory = JSO().learn(memory, SCALES, RATES, GAINS, WON)
        assert memory.slot == (k + 1) % 5
    assert memory.scales.tolist() == pytest.approx([(0.3 + scale) / 2] * 4 + [0.9])
    assert memory.rates.tolist() == pytest.approx([(0.8 + rate) / 2] * 4 + [0.9])


@pytest.mark.parametrize("learn", [ParameterMemory.learn, LShade().learn, JSO().learn])
def test_nothing_is_learnt_where_nothing_won(learn: Callable[..., ParameterMemory]) -> None:
    memory = ParameterMemory.fresh()
    assert learn(memory, SCALES, RATES, GAINS, np.zeros(3, dtype=bool)) is memory


@pytest.mark.parametrize(
    ("progress", "low", "high"), [(0.0, 0.7, 0.7), (0.3, 0.6, 0.7), (0.55, 0.0, 0.7), (0.8, 0.0, 1.0)]
)
def test_jso_limits_early_scales_and_rates(progress: float, low: float, high: float) -> None:
    scales, rates = JSO().limit(np.array([0.1, 1.0]), np.array([0.0, 1.0]), progress)
    assert scales.tolist() == [0.1, high]
    assert rates.tolist() == [low, 1.0]


# ------------------------------------------------------------------------------- mutation, archive, size
def test_elite_are_the_best_and_all_of_them() -> None:
    F = np.random.default_rng(0).permutation(20).astype(float)
    drawn = np.concatenate([elite(F, 0.2, np.random.default_rng(s)) for s in range(40)])
    assert sorted(set(F[drawn])) == [0.0, 1.0, 2.0, 3.0]


def test_elite_but_self_is_uniform_over_the_others() -> None:
    F = np.array([5.0, 1.0, 3.0, 2.0, 9.0, 7.0])
    drawn = np.array([elite_but_self(F, 0.5, np.random.default_rng(s)) for s in range(3000)])
    for i in range(6):
        counts = np.bincount(drawn[:, i], minlength=6)
        others = [k for k in (1, 3, 2) if k != i]
        assert counts[i] == 0
        assert counts[others].sum() == 3000
        assert counts[others].min() > 0.85 * 3000 / len(others)


def test_two_others_are_neither_the_member_nor_each_other() -> None:
    for seed in range(50):
        a, b = two_others(5, 8, np.random.default_rng(seed))
        own = np.arange(5)
        assert (a != own).all()
        assert (b != own).all()
        assert (a != b).all()
        assert a.max() < 5
        assert b.max() < 8


def test_current_to_pbest_with_scale_zero_stays_and_pull_leads_to_the_elite() -> None:
    generator = np.random.default_rng(1)
    X = generator.random((12, 3))
    F = sphere(X)
    archive = generator.random((4, 3))
    assert (CurrentToPBest(archive)(X, F, 0.0, generator) == X).all()
    apart = np.repeat(X[:1], 12, axis=0)  # all members alike: the difference is to the archive only
    same = CurrentToPBest(np.empty((0, 3)), pull=0.5)(apart, F, 1.0, generator)
    assert same == pytest.approx(apart)
    ordered = OrderedToPBest(archive)
    _, better, worse = ordered.parents(X, F, generator)
    assert (sphere(better) <= sphere(worse)).sum() >= 8  # those against the archive may be otherwise


def test_the_archive_forgets_at_random_beyond_its_size() -> None:
    archive, losers = np.zeros((3, 2)), np.ones((4, 2))
    assert len(update_archive(archive, losers, 9, np.random.default_rng(0))) == 7
    kept = update_archive(archive, losers, 5, np.random.default_rng(0))
    assert len(kept) == 5
    assert set(kept[:, 0]) == {0.0, 1.0}


def test_size_falls_on_a_straight_line_and_the_best_stay() -> None:
    assert [linear_size(180, 4, p) for p in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [180, 180, 92, 4, 4]
    X = np.arange(5.0)[:, None]
    kept, costs = keep_best(X, np.array([3.0, 1.0, 4.0, 0.0, 2.0]), 3)
    assert (kept[:, 0].tolist(), costs.tolist()) == ([1.0, 3.0, 4.0], [1.0, 0.0, 2.0])


# --------------------------------------------------------------------------------------------- the whole
@pytest.mark.parametrize(("make", "is_jso"), [(LShade, False), (JSO, True)])
@pytest.mark.parametrize(("cost", "target"), [(ellipsoid, 1e-9), (rastrigin, 1e-6)])
def test_as_quick_as_the_naive_twin(
    make: Callable[..., Any], is_jso: bool, cost: Callable[[np.ndarray], np.ndarray], target: float
) -> None:
    budget, dimension = 2500, 2
    stop = optimize.Stop(generations=10**6, budget=budget, target_cost=target)
    ours = []
    for seed in range(20):
        outcome = optimize.minimize(make(budget), Only(cost, dimension), seed=seed, stop=stop)
        ours.append(outcome.trajectories if outcome.status == "target" else np.inf)
    twin = [
        evaluations_to(target, lambda x: float(cost(x[None, :])[0]), dimension, budget, seed, jso=is_jso)
        for seed in range(9)
    ]
    assert np.median(ours) == pytest.approx(np.median(twin), rel=0.1)


@pytest.mark.parametrize("make", [LShade, JSO])
def test_the_population_shrinks_to_four_over_the_planned_budget(make: Callable[..., Any]) -> None:
    budget, sizes = 3000.0, []
    problem = Only(rastrigin, 5)
    stop = optimize.Stop(generations=10**6, budget=1.1 * budget, target_cost=-1.0)
    optimize.minimize(
        make(budget), problem, seed=0, stop=stop, callback=lambda p: sizes.append(len(p.state.X))
    )
    assert sizes[-1] == 4
    assert (np.diff(sizes) <= 0).all()
    assert problem.asked <= 1.1 * budget


def test_a_budget_without_end_is_no_plan() -> None:
    assert optimize.create("l-shade", np.inf).budget is optimize.create("jso").budget is None
    assert optimize.create("jso", 500.0).budget == 500.0


def test_first_populations_are_the_published_sizes() -> None:
    for dimension, linear, jso_members in ((10, 180, 182), (30, 540, 466)):
        assert LShade().members(dimension) == linear
        assert JSO().members(dimension) == jso_members


def test_ordered_shade_refines_at_once_where_that_is_enough() -> None:
    stop = optimize.Stop(generations=10**6, budget=5000, target_cost=1e-12)
    for cost, most in ((sphere, 150), (ellipsoid, 400), (rosenbrock, 2000)):
        for seed in range(3):
            outcome = optimize.minimize(OrderedShade(), Only(cost, 5), seed=seed, stop=stop)
            assert outcome.status == "target"
            assert outcome.trajectories <= most


def test_ordered_shade_finds_the_best_of_many_valleys() -> None:
    stop = optimize.Stop(generations=10**6, budget=30_000, target_cost=1e-8)
    outcomes = [optimize.minimize(OrderedShade(), Only(rastrigin, 5), seed=s, stop=stop) for s in range(3)]
    assert [o.status for o in outcomes] == ["target"] * 3


def test_ordered_shade_uses_residuals_where_there_are_some(
    oscillation: Callable[..., Any], least: Callable[[Any], float]
) -> None:
    problem = oscillation(extra=0, bias=0.0)
    stop = optimize.Stop(generations=10**6, budget=4000, target_cost=least(problem) * (1.0 + 1e-6))
    outcome = optimize.minimize(OrderedShade(), problem, seed=0, stop=stop)
    assert outcome.status == "target"


def test_a_new_population_is_larger_and_knows_no_optima() -> None:
    seen: list[Any] = []
    stop = optimize.Stop(generations=10**6, budget=6000)
    optimize.minimize(
        OrderedShade(members=8),
        Only(sphere, 2),
        seed=0,
        stop=stop,
        callback=lambda p: seen.append(p.state),
    )
    sizes = [len(s.population.X) for s in seen]
    assert sizes[0] == 8
    assert sorted(set(sizes)) == sizes[:1] + [k for k in sorted(set(sizes)) if k > 8]
    changed = [b for a, b in pairwise(seen) if len(b.population.X) > len(a.population.X)]
    assert changed
    assert all(len(s.optima) == 0 for s in changed)


# ----------------------------------------------------------------------------------------- the quasi-Newton search itself
def test_every_difference_of_the_search_is_counted() -> None:
    problem = Only(rosenbrock, 4)
    ledger = optimize.Ledger(problem, optimize.Evaluations.none(problem))
    x = np.full(4, 0.3)
    cost = float(ledger.costs(x[None, :], 0)[0])
    y, end = QuasiNewton()(ledger, x, cost)
    assert ledger.spent == problem.asked
    assert end < 1e-10 < cost
    assert end == rosenbrock(y[None, :])[0]
    assert problem.outside <= 0.0


def test_a_search_against_a_bound_ends_on_it() -> None:
    problem = Only(lambda X: ((X - 1.4) ** 2).sum(axis=1), 3)
    ledger = optimize.Ledger(problem, optimize.Evaluations.none(problem))
    y, _ = QuasiNewton()(ledger, np.full(3, 0.5), np.inf)
    assert y.tolist() == [1.0] * 3
    assert problem.outside <= 0.0


def test_a_search_beside_infinity_comes_back() -> None:
    def half(X: np.ndarray) -> np.ndarray:
        return np.where(X[:, 0] > 0.4, np.inf, sphere(X + 0.3))

    problem = Only(half, 3)
    ledger = optimize.Ledger(problem, optimize.Evaluations.none(problem))
    x = np.array([0.4 - 1e-12, 0.5, 0.5])
    y, end = QuasiNewton()(ledger, x, float(half(x[None, :])[0]))
    assert end <= half(x[None, :])[0]
    assert end == half(y[None, :])[0]


def test_a_search_that_cannot_reach_the_incumbent_is_let_go() -> None:
    problem = Only(lambda X: 1.0 + 1e-3 * rosenbrock(X), 4)
    patient, hasty = (
        optimize.Ledger(problem, optimize.Evaluations.none(problem)),
        optimize.Ledger(problem, optimize.Evaluations.none(problem)),
    )
    x = np.full(4, 0.3)
    cost = float(problem.costs(x[None, :], 0)[0])
    QuasiNewton()(patient, x, cost)
    QuasiNewton()(hasty, x, cost, incumbent=0.0)
    assert hasty.spent < patient.spent


def test_a_problem_without_residuals_says_so() -> None:
    with pytest.raises(IdentificationError, match="no residuals"):
        Only(sphere).residuals(np.zeros((1, 5)), 0)
    with pytest.raises(IdentificationError, match="no residuals"):
        Only(sphere).jacobian(np.zeros(5), 0, np.zeros(1))
