from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stoop import optimize
from stoop.optimize import Stop, minimize
from stoop.optimize.population import MEMBERS
from stoop.optimize.problem import ScalarProblem

METHODS = (
    "ps-gde", "de-rand-1-bin", "de-best-2-bin", "weighted-centroid", "multi-population", "hybrid",
    "trigonometric", "sacpmde", "asmde", "derl",
)  # fmt: skip
every = pytest.mark.parametrize("name", METHODS)
PLACE = np.linspace(0.25, 0.8, 10)


class Costs(ScalarProblem):
    """A problem of which only a cost is known; `asked` counts candidates."""

    def __init__(self, cost: Callable[[np.ndarray], np.ndarray], dimension: int = 10) -> None:
        self.asked, self.dimension, self._cost = 0, dimension, cost

    def costs(self, X: np.ndarray, rung: int) -> np.ndarray:
        self.asked += len(X)
        return self._cost(X)


def sphere(X: np.ndarray) -> np.ndarray:
    return ((X - PLACE) ** 2).sum(axis=1)


def rosenbrock(X: np.ndarray) -> np.ndarray:
    Y = 4.0 * X - 2.0
    return (100.0 * (Y[:, 1:] - Y[:, :-1] ** 2) ** 2 + (1.0 - Y[:, :-1]) ** 2).sum(axis=1)


def egg(X: np.ndarray) -> np.ndarray:
    """Many optima above a floor: what escapes from them is worth something."""
    Y = X - 0.37
    return 5.0 + (40.0 * Y**2 + 1.0 - np.cos(40.0 * Y)).sum(axis=1)


@every
def test_a_curved_valley_is_followed_far_below_luck(name: str) -> None:
    budget = 20_000
    luck = Costs(rosenbrock).costs(np.random.default_rng(0).random((budget, 10)), 0).min()
    stop = Stop(generations=10**6, budget=float(budget))
    for s in range(3):
        assert minimize(optimize.create(name), Costs(rosenbrock), seed=s, stop=stop).cost < 0.1 * luck


@every
def test_a_step_is_a_generation_of_the_same_size_for_all(name: str) -> None:
    optimizer, problem = optimize.create(name), Costs(rosenbrock)
    state = optimizer.init(problem, 3, np.empty((0, 10)))
    assert problem.asked == MEMBERS
    for _ in range(25):
        before = problem.asked
        state, event = optimizer.step(state, problem)
        assert state.X.shape == (MEMBERS, 10)
        assert problem.asked - before >= MEMBERS or event.kind == "refinement"
        assert state.evaluations.trajectories == problem.asked
        assert event.cost == state.F.min()


@every
def test_a_stored_state_goes_on_as_if_nothing_had_been(name: str) -> None:
    """Without residuals, through a wide and a narrow stage (collapsed populations included)."""
    whole, half = (minimize(optimize.create(name), Costs(sphere), seed=4, stop=Stop(n)) for n in (240, 119))
    rest = minimize(optimize.create(name), Costs(sphere), seed=4, stop=Stop(240), state=half.state)
    assert rest.state.X.tobytes() == whole.state.X.tobytes()
    assert rest.history.tobytes() == whole.history.tobytes()
    assert rest.state.stream == whole.state.stream


def _found(name: str) -> int:
    stop = Stop(generations=10**6, budget=15_000.0, target_cost=5.001)
    small = replace(optimize.create(name), members=12)
    return sum(minimize(small, Costs(egg, 4), seed=s, stop=stop).status == "target" for s in range(20))


def test_second_mutation_and_migration_lead_out_of_wrong_optima() -> None:
    """What ASMDE and the hybrid add to DE/rand/1/bin is what they were made for."""
    plain = _found("de-rand-1-bin")
    assert plain < 16
    assert _found("asmde") == _found("hybrid") == 20


@pytest.mark.parametrize("name", optimize.names())
def test_names_keep_their_promises(name: str) -> None:
    """The name is kept in states; a plan is taken by all; residuals are asked for only where it is said."""
    planned = optimize.create(name, budget=500.0)
    assert planned.name == optimize.create(name).name == name
    if optimize.needs_residuals(name):
        return
    problem = Costs(sphere)
    outcome = minimize(planned, problem, seed=0, stop=Stop(generations=10**6, budget=500.0))
    assert outcome.trajectories == problem.asked <= 500
    assert outcome.status == "budget"
