"""Every optimizer: determinism, resuming, stopping, bounds, bad numbers; and what the default concludes."""

import pickle
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from core.optimize.conftest import Residuals
from core.optimize.test_libraries import EXTRA, SCIPY

from stoop import optimize
from stoop.errors import IdentificationError
from stoop.optimize import Stop

OWN = tuple(n for n in optimize.names() if n not in (*SCIPY, *EXTRA))
SOME = ("ps-gde-lm", "ps-gde", "ga", "pso", "jso", *SCIPY)  #: one of each kind of code


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if is_dataclass(a):
        return type(a) is type(b) and all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return type(a) is type(b) and a == b


class Rugged(Residuals):
    """Thousands of local optima: nothing is confirmed early, so that scouts, refinements and the population all take part."""

    dimension, extra, prices = 4, 1, (0.1, 0.3, 1.0)

    def __init__(self) -> None:
        self.spent, self.largest = 0.0, 0.0

    def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
        self.spent += len(Z) * self.prices[rung]
        self.largest = max(self.largest, float(np.abs(Z[:, :4] - 0.5).max(initial=0.0) - 0.5))
        return np.concatenate([3.0 * (Z - 0.37), np.sin((30.0 + rung) * Z[:, :4]), Z[:, 4:] - 0.5], axis=1)

    def reference(self, rung: int) -> float:
        return 12.0


@pytest.mark.parametrize("name", OWN)
def test_a_run_is_counted_repeatable_and_resumable(name: str, tmp_path: Path) -> None:
    """Ended by generations or inside a step, saved, loaded, continued by fresh objects: the same to the last bit."""
    starts = np.array([[0.0, 1.0, 0.5, 1.0, 7.0], [-2.0, 3.0, 0.5, 0.5, -7.0]])  # the last is a nuisance
    states: list[Any] = []

    def run(stop: Stop, **keys: Any) -> tuple[Rugged, optimize.Outcome]:
        problem = Rugged()
        keys = {"seed": 3, "starts": starts, "stop": stop} | keys
        return problem, optimize.minimize(optimize.create(name), problem, **keys)

    problem, whole = run(Stop(40, target_cost=-1.0), callback=lambda p: states.append(p.state))
    assert problem.largest <= 1e-15, "nothing is evaluated outside the box"
    assert ((whole.z[:4] >= 0.0) & (whole.z[:4] <= 1.0)).all()
    assert (whole.trajectories, whole.history[-1, 1]) == (pytest.approx(problem.spent), whole.cost)
    assert (np.diff(whole.history, axis=0) * [1.0, -1.0] > 0.0).all()
    assert not _same(run(Stop(3), seed=6)[1].state.evaluations, states[2].evaluations)
    assert name != optimize.names()[0] or whole.state.population is not None
    for stop in (Stop(7), Stop(40, 0.5), Stop(40, 77.7)):
        _, part = run(stop)
        assert part.trajectories <= stop.budget + 1e-9
        if np.isinf(stop.budget):
            assert _same(part.state, states[stop.generations - 1])
        state = part.state
        if state is not None:
            optimize.save_state(tmp_path / "state.npz", state)
            state = optimize.load_tagged(tmp_path / "state.npz")[0]
        _, rest = run(Stop(40, target_cost=-1.0), state=state)
        assert _same(rest.state, whole.state), stop
    before = pickle.dumps(states[8])
    first, again = (optimize.create(name).step(states[8], Rugged())[0] for _ in range(2))
    assert _same(first, again)
    assert pickle.dumps(states[8]) == before, "a step does not change its state"


def test_long_refinements_and_populations_take_no_more_than_scouting() -> None:
    """Each may begin one more step when it has taken as much, and so exceeds it by what that step costs."""
    largest = {"prolonged": 0.0, "evolved": 0.0}
    before = optimize.create().init(Rugged(), 3, np.empty((0, 4)))
    rounds, populations = set(), set()

    def watch(progress: optimize.Progress) -> None:
        nonlocal before
        state: Any = progress.state
        spent = state.evaluations.trajectories - before.evaluations.trajectories
        taken = {part: getattr(state, part) - getattr(before, part) for part in largest}
        assert sum(more > 0.0 for more in taken.values()) <= 1
        for part, more in taken.items():
            assert more in (0.0, pytest.approx(spent))
            if more:
                scouted = before.evaluations.trajectories - before.prolonged - before.evolved
                assert getattr(before, part) <= scouted + 1e-9
            largest[part] = max(largest[part], more)
        rounds.add(state.scouts.tobytes())
        populations.add(state.population is not None)
        before = state

    problem = Rugged()
    problem.reference = lambda rung: 1.0  # so that gates stop candidates
    optimize.minimize(optimize.create(), problem, seed=3, stop=Stop(generations=200), callback=watch)
    assert min(largest.values()) > 0.0
    assert populations == {False, True}
    assert before.round > 10
    assert len(rounds) == -(-before.round // 5), "five rounds share a Latin hypercube"


@pytest.mark.parametrize("shares", [(0.4, 1.0), (0.05, 0.1, 0.2, 0.4, 1.0)])
def test_a_state_of_another_ladder_continues(oscillation, shares):
    saved = optimize.minimize(optimize.create(), oscillation(), seed=1, stop=Stop(generations=2)).state
    assert not saved.converged
    rest = optimize.minimize(optimize.create(), oscillation(shares=shares), seed=1, state=saved)
    assert rest.status == "converged"
    assert rest.trajectories > saved.evaluations.trajectories
    assert len(rest.state.least) == len(shares)


@pytest.mark.parametrize("name", SOME)
def test_the_target_and_ctrl_c_end_a_run_and_keep_the_best(name, oscillation):
    problem = oscillation()
    stop = Stop(target_cost=0.05 * problem.reference(2), budget=20_000)
    outcome = optimize.minimize(optimize.create(name), problem, seed=2, stop=stop)
    assert outcome.status == "target"
    assert outcome.cost <= stop.target_cost
    assert (problem.residuals(outcome.z[None, :], 2) ** 2).sum() == pytest.approx(outcome.cost)
    assert len(outcome.advice.splitlines()) == 1
    problem = Rugged()
    simulate = problem.residuals

    def residuals(Z: np.ndarray, rung: int) -> np.ndarray:
        if problem.spent > 60.0:
            raise KeyboardInterrupt
        return simulate(Z, rung)

    problem.residuals = residuals
    outcome = optimize.minimize(optimize.create(name), problem, seed=2)
    assert outcome.status == "interrupted"
    assert (simulate(outcome.z[None, :], 2) ** 2).sum() == pytest.approx(outcome.cost)


@pytest.mark.parametrize("when", [0, 7])
def test_ctrl_c_in_the_callback_keeps_the_best(when: int) -> None:
    def callback(progress: optimize.Progress) -> None:
        if progress.state.generation > when:
            raise KeyboardInterrupt

    outcome = optimize.minimize(optimize.create(), Rugged(), seed=2, callback=callback)
    assert (outcome.status, outcome.generation) == ("interrupted", when + 1)
    assert "resume" in outcome.advice


@pytest.mark.parametrize("name", SOME)
def test_divergence_is_survived(name: str) -> None:
    class Patchy(Rugged):
        direction = np.random.default_rng(5).standard_normal((4, 5)) * 40.0
        share, bad = 0.0, 0.0

        def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
            R = super().residuals(Z, rung)
            R[np.abs(np.sin(Z[:, :4] @ self.direction)).prod(axis=1) * 7919.0 % 1.0 < self.share] = self.bad
            return R

        def reference(self, rung: int) -> float:
            return self.bad

    for share, bad in ((0.4, np.nan), (0.9, np.inf), (1.0, -np.inf)):
        problem = Patchy()
        problem.share, problem.bad = share, bad
        outcome = optimize.minimize(optimize.create(name), problem, seed=4, stop=Stop(40, 1000.0))
        assert np.isfinite(outcome.z).all()
        assert np.isfinite(outcome.cost) == (share < 1.0), share
    assert outcome.cost == np.inf
    assert outcome.status != "converged"
    assert "no candidate gave a finite cost" in outcome.advice


def test_the_default_finds_and_confirms_the_least_cost(oscillation, least):
    for seed in range(12):
        problem = oscillation(seed=seed)
        outcome = optimize.minimize(optimize.create(), problem, seed=seed, stop=Stop(budget=5000))
        assert (outcome.status, outcome.advice) == ("converged", "")
        assert outcome.cost == pytest.approx(least(problem), rel=1e-5)


def test_an_imperfect_model_is_fitted_and_confirmed_all_the_same(oscillation, least):
    for seed in range(6):
        problem = oscillation(seed=seed, disturbance=0.12)
        outcome = optimize.minimize(optimize.create(), problem, seed=seed, stop=Stop(budget=5000))
        assert outcome.status == "converged"
        assert outcome.cost / 240 > 30.0
        assert outcome.cost <= least(problem) * (1.0 + 1e-5)
        assert outcome.trajectories < 1000


def test_a_good_start_is_cheap_even_after_a_bad_one_and_brings_its_nuisances(oscillation, near, least):
    problem, bad = oscillation(seed=1), np.array([0.9, 0.9, 0.02, 0.1])

    def run(*starts: np.ndarray, **stop: Any) -> optimize.Outcome:
        keys = {"starts": np.array(starts), "stop": Stop(**stop)}
        return optimize.minimize(optimize.create(), problem, seed=1, **keys)

    best = least(problem)
    for starts, cheap in (([near(0.98)[:4]], 20.0), ([bad, near(0.98)[:4]], 25.0), ([bad], np.inf)):
        outcome = run(*starts, budget=5000)
        assert (outcome.status, outcome.cost) == ("converged", pytest.approx(best, rel=1e-5))
        assert outcome.history[outcome.history[:, 1] <= best * 1.001, 0][0] < cheap
    # from the very optimum the first refinement has nothing to do; without its nuisances it has
    spent = [run(start, generations=1).trajectories for start in (outcome.z, outcome.z[:4])]
    assert np.abs(outcome.z[4:]).max() > 0.01
    assert spent[0] < spent[1]


def test_bad_questions_get_one_line(oscillation: Callable[..., Any]) -> None:
    forgetful = Mock(init=optimize.create().init, step=Mock(return_value=None))
    forgetful.name = "forgetful"
    two = Stop(generations=2)
    state = optimize.minimize(optimize.create("ps-gde"), oscillation(), seed=0, stop=two).state
    with pytest.raises(IdentificationError, match=r"^optimizer nonsense: .*use one of ps-gde-lm"):
        optimize.create("nonsense")
    for optimizer, changes, keys, says in (
        (optimize.create(), {}, {"starts": np.zeros((2, 3))}, r"starts must be finite and 4 wide"),
        (optimize.create(), {}, {"state": state}, r"is of ps-gde, not ps-gde-lm"),
        (optimize.create("ps-gde"), {"extra": 0}, {"state": state}, r"has 5 variables, the problem 4"),
        (optimize.create(), {"dimension": 0}, {}, "no variable is free"),
        (forgetful, {}, {}, r"^optimizer forgetful: its step returned NoneType, not"),
    ):
        with pytest.raises(IdentificationError, match=says):
            optimize.minimize(optimizer, oscillation(**changes), seed=0, **keys)
