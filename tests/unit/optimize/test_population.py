from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from naive.landscapes import rosenbrock

from stoop.optimize.population import DEFAULT, PERIOD, OrderedToPBest, Population, Trials


def sphere(X: np.ndarray) -> np.ndarray:
    return ((X - 0.3) ** 2).sum(axis=1)


def young(n: int = 20, d: int = 3, seed: int = 0) -> Population:
    X = np.random.default_rng(seed).random((n, d))
    return Population.first(X, sphere(X))


@given(st.integers(0, 2**32 - 1))
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
    mutation = OrderedToPBest(population.archive, DEFAULT.elite)
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
    population = replace(young(), refined=np.ones(20, dtype=bool))
    X = population.X.copy()
    X[4] = 0.3
    trials = Trials(X, np.full(20, 0.5), np.full(20, 0.9))
    costs = np.full(20, np.inf)
    costs[4] = 0.0
    after = population.tell(trials, costs, np.random.default_rng(0))
    assert after.archive.tolist() == [population.X[4].tolist()]
    assert np.flatnonzero(~after.refined).tolist() == [4]


def test_prey_is_the_best_not_refined_at_and_not_beside_an_earlier_end() -> None:
    population = young()
    order = np.argsort(population.F)
    first, population = population.next_start(np.empty((0, 3)))
    assert first == order[0]
    second, population = population.next_start(np.empty((0, 3)))
    assert second == order[1]
    third, population = population.next_start(population.X[order[2]][None, :] + 0.01)
    assert third is None
    assert population.refined[order[:3]].all()
    assert population.due == population.age + population.period
    member, _ = replace(young(), F=np.full(20, np.inf)).next_start(np.empty((0, 3)))
    assert member is None


def test_diving_pays_or_is_put_off() -> None:
    population = young()
    better = population.with_refined(7, np.full(3, 0.31), 1e-4, improved=True)
    assert better.X[7].tolist() == [0.31] * 3
    assert better.due == PERIOD // 2
    worse = population.with_refined(7, np.full(3, 0.9), 9.0, improved=False)
    assert (worse.X == population.X).all()
    assert worse.period == 2 * PERIOD
    for _ in range(10):
        worse = worse.with_refined(7, np.full(3, 0.9), 9.0, improved=False)
    assert worse.period == 20 * PERIOD


def test_a_population_is_given_up_when_it_collapsed_or_rests() -> None:
    for change, given_up in (
        ({}, False),
        ({"X": np.full((20, 3), 0.5)}, True),
        ({"F": np.full(20, 7.0)}, True),
        ({"F": np.full(20, np.inf)}, False),
        ({"idle": 160}, False),
        ({"idle": 161}, True),
    ):
        assert replace(young(), **change).exhausted is given_up, change


def test_it_solves_a_valley_by_evolution_alone() -> None:
    generator = np.random.default_rng(0)
    X = generator.random((40, 4))
    population = Population.first(X, rosenbrock(X))
    for _ in range(400):
        trials = population.ask(generator)
        population = population.tell(trials, rosenbrock(trials.X), generator)
    assert population.F.min() < 1e-10
    assert population.X[population.F.argmin()] == pytest.approx(0.75, abs=1e-4)
