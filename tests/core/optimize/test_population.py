from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from naive.landscapes import rosenbrock

from stoop.optimize import population as of
from stoop.optimize.population import DEFAULT, ParameterMemory, Population

SEEDS = st.integers(0, 2**32 - 1)


def sphere(X: np.ndarray) -> np.ndarray:
    return ((X - 0.3) ** 2).sum(axis=1)


def young(n: int = 20, d: int = 3, seed: int = 0) -> Population:
    X = np.random.default_rng(seed).random((n, d))
    return Population.first(X, sphere(X))


@given(SEEDS)
def test_trials_lie_in_the_box_and_the_population_never_worsens(seed: int) -> None:
    generator, population = np.random.default_rng(seed), young(seed=seed)
    for _ in range(6):
        trials = population.ask(generator)
        assert ((trials.X >= 0.0) & (trials.X <= 1.0)).all()
        after = population.tell(trials, sphere(trials.X), generator)
        assert (after.F <= population.F).all()
        assert (sphere(after.X) == after.F).all()
        assert len(after.archive) <= len(after.X)
        population = after
    assert population.age == 6


def parents(population: Population, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    mutation = of.OrderedToPBest(population.archive, DEFAULT.elite)
    return mutation.parents(population.X, population.F, np.random.default_rng(seed))


def test_differences_point_from_worse_to_better() -> None:
    """With scale 1, rate 1 and the first term taken away, better minus worse is left: it must descend."""
    population = young(n=40, d=2)
    for seed in range(20):
        towards, better, worse = parents(population, seed)
        assert (sphere(better) <= sphere(worse)).all()
        elite = np.sort(population.F)[round(DEFAULT.elite * 40) - 1]
        assert (sphere(towards) <= elite).all()
    population = replace(young(), archive=np.full((20, 3), 0.3))  # the very optimum, but it has lost
    assert not any((parents(population, seed)[1] == 0.3).all(axis=1).any() for seed in range(20))


def test_winners_fill_the_archive_with_their_parents_and_can_be_prey_again() -> None:
    population, costs = replace(young(), refined=np.ones(20, dtype=bool)), np.full(20, np.inf)
    X = population.X.copy()
    X[4], costs[4] = 0.3, 0.0
    trials = of.Trials(X, np.full(20, 0.5), np.full(20, 0.9))
    after = population.tell(trials, costs, np.random.default_rng(0))
    assert after.archive.tolist() == [population.X[4].tolist()]
    assert np.flatnonzero(~after.refined).tolist() == [4]


def test_prey_is_the_best_not_refined_at_and_not_beside_an_earlier_end() -> None:
    population, order = young(), np.argsort(young().F)
    nowhere = np.empty((0, 3))
    beside = young().X[order[2]][None, :] + 0.01
    for ends, member in ((nowhere, order[0]), (nowhere, order[1]), (beside, None)):
        found, population = population.next_start(ends)
        assert found == member
    assert population.refined[order[:3]].all()
    assert population.due == population.age + population.period
    assert replace(young(), F=np.full(20, np.inf)).next_start(nowhere)[0] is None


def test_a_population_is_given_up_when_it_collapsed_or_rests() -> None:
    flat, worst = {"F": np.full(20, 7.0)}, {"F": np.full(20, np.inf)}
    for change in ({"X": np.full((20, 3), 0.5)}, flat, {"idle": 161}):
        assert replace(young(), **change).exhausted is True, change
    for change in ({}, worst, {"idle": 160}):
        assert replace(young(), **change).exhausted is False, change


def test_it_solves_a_valley_by_evolution_alone() -> None:
    generator = np.random.default_rng(0)
    X = generator.random((40, 4))
    population = Population.first(X, rosenbrock(X))
    for _ in range(400):
        trials = population.ask(generator)
        population = population.tell(trials, rosenbrock(trials.X), generator)
    assert population.F.min() < 1e-10
    assert population.X[population.F.argmin()] == pytest.approx(0.75, abs=1e-4)


@given(SEEDS)
def test_latin_hypercube_has_one_point_in_each_slice(seed: int) -> None:
    X = of.latin_hypercube(17, 3, np.random.default_rng(seed))
    assert (np.sort((X * 17).astype(int), axis=0) == np.arange(17)[:, None]).all()


def test_crossover_equals_its_naive_twin() -> None:
    X = np.random.default_rng(2).random((12, 5))
    for rate in (0.0, 0.3, 0.9, 1.0):
        T, generator = of.binomial(X, X + 10.0, rate, np.random.default_rng(4)), np.random.default_rng(4)
        draws, always = generator.random(X.shape), generator.random(len(X))
        for i, row in enumerate(X):
            j_always = int(always[i] * len(row))
            naive = [x + 10.0 if j == j_always or draws[i, j] <= rate else x for j, x in enumerate(row)]
            assert T[i].tolist() == naive
            assert (T[i] != X[i]).any()


def test_selection_keeps_the_parent_on_a_tie_and_never_takes_nan() -> None:
    parents, trials = np.zeros((4, 1)), np.ones((4, 1))
    before, after = np.array([1.0, 1.0, np.inf, 1.0]), np.array([1.0, 0.5, 2.0, np.nan])
    X, F, won = of.greedy(parents, before, trials, after)
    assert won.tolist() == [False, True, True, False]
    assert X[:, 0].tolist() == [0.0, 1.0, 1.0, 0.0]
    assert F.tolist() == [1.0, 0.5, 2.0, 1.0]


@given(SEEDS)
def test_sampled_scales_and_rates_are_in_range(seed: int) -> None:
    scales, rates = ParameterMemory.fresh().sample(100, np.random.default_rng(seed))
    assert ((scales > 0.0) & (scales <= 1.0)).all()
    assert ((rates >= 0.0) & (rates <= 1.0)).all()


def test_memory_learns_weighted_lehmer_means_in_turn() -> None:
    scales, rates, gains = np.array([0.2, 0.9, 0.5]), np.array([1.0, 0.1, 0.3]), np.array([1.0, 5.0, 3.0])
    won = np.array([True, False, True])
    memory = ParameterMemory.fresh(entries=2).learn(scales, rates, gains, won)
    assert memory.scales[0] == pytest.approx((0.25 * 0.04 + 0.75 * 0.25) / (0.25 * 0.2 + 0.75 * 0.5))
    assert memory.rates[0] == pytest.approx((0.25 * 1.0 + 0.75 * 0.09) / (0.25 * 1.0 + 0.75 * 0.3))
    assert (memory.scales[1], memory.rates[1], memory.slot) == (0.5, 0.8, 1)
    assert memory.learn(scales, rates, gains, won).slot == 0
    assert memory.learn(scales, rates, gains, np.zeros(3, dtype=bool)) is memory
    one, best = np.array([0.4]), np.array([True])
    memory = ParameterMemory.fresh().learn(one, one + 0.2, np.array([np.inf]), best)  # of an infinite parent
    assert (memory.scales[0], memory.rates[0]) == (pytest.approx(0.4), pytest.approx(0.6))
