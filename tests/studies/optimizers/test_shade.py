from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from naive.landscapes import Only, ellipsoid, rastrigin, rosenbrock, sphere
from naive.shade import evaluations_to

from stoop import optimize
from stoop.optimize.population import ParameterMemory, success_means
from stoop_studies.optimizers.local_search import QuasiNewton
from stoop_studies.optimizers.shade import JSO, TERMINAL, LShade, OrderedShade, keep_best, linear_size

SCALES, RATES = np.array([0.2, 0.4, 0.9]), np.array([0.5, 0.0, 1.0])
GAINS, WON = np.array([3.0, 1.0, np.inf]), np.array([True, True, False])


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


def test_jso_limits_early_scales_and_rates() -> None:
    for progress, low, high in ((0.0, 0.7, 0.7), (0.3, 0.6, 0.7), (0.55, 0.0, 0.7), (0.8, 0.0, 1.0)):
        scales, rates = JSO().limit(np.array([0.1, 1.0]), np.array([0.0, 1.0]), progress)
        assert (scales.tolist(), rates.tolist()) == ([0.1, high], [low, 1.0])


def test_size_falls_on_a_straight_line_and_the_best_stay() -> None:
    assert [linear_size(180, 4, p) for p in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [180, 180, 92, 4, 4]
    X = np.arange(5.0)[:, None]
    kept, costs = keep_best(X, np.array([3.0, 1.0, 4.0, 0.0, 2.0]), 3)
    assert (kept[:, 0].tolist(), costs.tolist()) == ([1.0, 3.0, 4.0], [1.0, 0.0, 2.0])


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

    def one(x: np.ndarray) -> float:
        return float(cost(x[None, :])[0])

    twin = [evaluations_to(target, one, dimension, budget, seed, jso=is_jso) for seed in range(9)]
    assert np.median(ours) == pytest.approx(np.median(twin), rel=0.1)


@pytest.mark.parametrize("make", [LShade, JSO])
def test_the_population_shrinks_to_four_over_the_planned_budget(make: Callable[..., Any]) -> None:
    budget, sizes = 3000.0, []
    problem = Only(rastrigin, 5)
    stop = optimize.Stop(generations=10**6, budget=1.1 * budget, target_cost=-1.0)
    note = lambda p: sizes.append(len(p.state.X))  # noqa: E731
    optimize.minimize(make(budget), problem, seed=0, stop=stop, callback=note)
    assert sizes[-1] == 4
    assert (np.diff(sizes) <= 0).all()
    assert problem.asked <= 1.1 * budget


def test_ordered_shade_refines_at_once_where_that_is_enough() -> None:
    stop = optimize.Stop(generations=10**6, budget=5000, target_cost=1e-12)
    for cost, most in ((sphere, 150), (ellipsoid, 400), (rosenbrock, 2000)):
        for seed in range(3):
            outcome = optimize.minimize(OrderedShade(), Only(cost, 5), seed=seed, stop=stop)
            assert outcome.status == "target"
            assert outcome.trajectories <= most


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
