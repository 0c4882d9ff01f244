from typing import Any

import numpy as np
import pytest
from naive.landscapes import Only, rastrigin, rosenbrock, sphere
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.problem import Problem

from stoop import optimize
from stoop.optimize.state import RandomStream
from stoop_studies.optimizers.ga import GeneticAlgorithm, SimulatedBinary


def coarse(X: np.ndarray) -> np.ndarray:
    return sphere(X).round(3)


def theirs(cost: Any, seed: int, generations: int) -> Any:
    class Box(Problem):
        def __init__(self) -> None:
            super().__init__(n_var=6, n_obj=1, xl=np.zeros(6), xu=np.ones(6))

        def _evaluate(self, x: np.ndarray, out: dict[str, Any], *_: Any, **__: Any) -> None:
            out["F"] = cost(x)[:, None]

    algorithm = GA(pop_size=50)
    algorithm.setup(Box(), seed=1, termination=("n_gen", generations + 1))
    algorithm.random_state = RandomStream.from_seed(seed).generator()
    while algorithm.has_next():
        algorithm.next()
    return algorithm


@pytest.mark.parametrize("cost", [sphere, coarse, rosenbrock, rastrigin])
def test_members_are_those_of_pymoo_to_the_last_bit(cost: Any) -> None:
    ours = optimize.minimize(GeneticAlgorithm(), Only(cost, 6), seed=11, stop=optimize.Stop(generations=40))
    reference = theirs(cost, 11, 40)
    assert ours.state is not None
    assert ours.state.X.tobytes() == reference.pop.get("X").tobytes()
    assert ours.state.F.tolist() == reference.pop.get("F")[:, 0].tolist()
    assert ours.trajectories == reference.evaluator.n_eval


def test_spread_of_children_has_the_published_distribution() -> None:
    """P(spread <= 1) is one half without bounds; far from them the spread's median is 1."""
    generator = np.random.default_rng(1)
    parents = np.stack([np.full((20_000, 1), 0.499), np.full((20_000, 1), 0.501)])
    children = SimulatedBinary(eta=2.0, mated=1.0, crossed=1.0)(parents, generator)
    spread = np.abs(children[0] - children[1])[:, 0] / 0.002
    u = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
    expected = np.where(u <= 0.5, (2 * u) ** (1 / 3), (1 / (2 * (1 - u))) ** (1 / 3))
    assert np.quantile(spread, u) == pytest.approx(expected, rel=0.02)


def test_a_flat_cost_ends_without_a_child_too_many() -> None:
    problem = Only(lambda X: np.zeros(len(X)), 1)
    outcome = optimize.minimize(GeneticAlgorithm(), problem, seed=0, stop=optimize.Stop(generations=20))
    assert outcome.generation == 20
    assert outcome.trajectories == problem.asked <= 21 * 50
