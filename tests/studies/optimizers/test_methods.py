from dataclasses import replace

import numpy as np
import pytest
from naive.landscapes import Only, rosenbrock, sphere

from stoop import optimize
from stoop.optimize import Stop, minimize
from stoop.optimize.libraries import LARGE, finite_costs
from stoop.optimize.population import MEMBERS
from stoop_studies.optimizers.libraries import Escape

METHODS = (
    "ps-gde", "de-rand-1-bin", "de-best-2-bin", "weighted-centroid", "multi-population", "hybrid",
    "trigonometric", "sacpmde", "asmde", "derl",
)  # fmt: skip
every = pytest.mark.parametrize("name", METHODS)


def egg(X: np.ndarray) -> np.ndarray:
    Y = X - 0.37
    return 5.0 + (40.0 * Y**2 + 1.0 - np.cos(40.0 * Y)).sum(axis=1)


@every
def test_a_curved_valley_is_followed_far_below_luck(name: str) -> None:
    budget = 20_000
    luck = rosenbrock(np.random.default_rng(0).random((budget, 10))).min()
    stop = Stop(generations=10**6, budget=float(budget))
    for s in range(3):
        assert minimize(optimize.create(name), Only(rosenbrock, 10), seed=s, stop=stop).cost < 0.1 * luck


@every
def test_a_step_is_a_generation_of_the_same_size_for_all(name: str) -> None:
    optimizer, problem = optimize.create(name), Only(rosenbrock, 10)
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
    problem, optimizer = Only(sphere, 10), optimize.create(name)
    whole, half = (minimize(optimizer, problem, seed=4, stop=Stop(n)) for n in (240, 119))
    rest = minimize(optimize.create(name), problem, seed=4, stop=Stop(240), state=half.state)
    assert rest.state.X.tobytes() == whole.state.X.tobytes()
    assert rest.history.tobytes() == whole.history.tobytes()
    assert rest.state.stream == whole.state.stream


def _found(name: str) -> int:
    stop = Stop(generations=10**6, budget=15_000.0, target_cost=5.001)
    small = replace(optimize.create(name), members=12)
    return sum(minimize(small, Only(egg, 4), seed=s, stop=stop).status == "target" for s in range(20))


def test_second_mutation_and_migration_lead_out_of_wrong_optima() -> None:
    plain = _found("de-rand-1-bin")
    assert plain < 16
    assert _found("asmde") == _found("hybrid") == 20


@pytest.mark.parametrize("name", optimize.names())
def test_names_keep_their_promises(name: str) -> None:
    planned = optimize.create(name, budget=500.0)
    assert planned.name == optimize.create(name).name == name
    if optimize.needs_residuals(name):
        return
    problem = Only(sphere, 10)
    outcome = minimize(planned, problem, seed=0, stop=Stop(generations=10**6, budget=500.0))
    assert outcome.trajectories == problem.asked <= 500
    assert outcome.status == "budget"


def test_an_exception_is_carried_past_a_library() -> None:
    problem = Only(sphere, 2)
    ledger = optimize.Ledger(problem, optimize.Evaluations.none(problem), budget=3.0)
    escape = Escape(ledger)
    assert escape.costs(np.full((2, 2), 0.5)).max() < 1.0
    escape.check()
    assert escape.costs(np.full((4, 2), 0.5)).tolist() == [LARGE] * 4
    assert escape.costs(np.full((1, 2), 0.5)).tolist() == [LARGE]
    assert problem.asked == 3
    with pytest.raises(optimize.ledger.Halt):
        escape.check()
    fresh = optimize.Ledger(problem, optimize.Evaluations.none(problem))
    finite_costs(fresh, np.array([[1.0 + 1e-16, -1e-18]]))
    assert problem.outside <= 0.0, "points beside the box are evaluated on its bound"
