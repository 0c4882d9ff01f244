import numpy as np
import pytest
from naive import swarm
from naive.landscapes import Only, rastrigin

from stoop import optimize
from stoop_studies.optimizers.pso import CHI, FASTEST, ParticleSwarm


def test_constriction_is_the_published_one() -> None:
    assert pytest.approx(0.7298, abs=5e-5) == CHI
    assert pytest.approx(1.49618, abs=5e-6) == CHI * 2.05


def test_the_swarm_moves_as_its_naive_twin() -> None:
    problem, optimizer = Only(rastrigin, 3), ParticleSwarm(members=7)
    ledger = optimize.Ledger(problem, optimize.Evaluations.none(problem))
    state = optimizer.init(ledger, 4, np.empty((0, 3)))
    x, v = state.X.tolist(), (5.0 * state.V).tolist()  # fast enough to meet the bounds
    state = type(state)(**{**vars(state), "V": 5.0 * state.V})
    best, costs = [list(p) for p in x], state.F.tolist()
    for _ in range(40):
        draws = state.stream.generator().random((2, 7, 3))
        state, _ = optimizer.step(state, ledger)
        swarm.moved(x, v, best, costs, draws, lambda p: float(rastrigin(np.array([p]))[0]))
        assert pytest.approx(np.array(x), abs=1e-12) == state.X
        assert pytest.approx(np.array(v), abs=1e-12) == state.V
        assert pytest.approx(np.array(best), abs=1e-12) == state.B
        assert pytest.approx(np.array(costs), abs=1e-9) == state.F


def test_particles_stay_in_the_box_and_below_the_largest_velocity() -> None:
    problem, optimizer = Only(lambda X: -X.sum(axis=1), 4), ParticleSwarm()
    ledger = optimize.Ledger(problem, optimize.Evaluations.none(problem))
    state = optimizer.init(ledger, 0, np.empty((0, 4)))
    for _ in range(30):
        state, _ = optimizer.step(state, ledger)
        assert np.abs(state.V).max() <= FASTEST
    assert problem.outside <= 0.0
    assert state.B[state.F.argmin()].tolist() == [1.0] * 4
