"""Other libraries: what they ask is booked, what ends a run gets through, and nothing is left behind."""

from __future__ import annotations

import importlib
import threading
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from naive.landscapes import Only, sphere
from threadpoolctl import threadpool_info

from stoop import optimize
from stoop.errors import IdentificationError
from stoop.optimize import libraries
from stoop.optimize.libraries import LARGE, Escape, Library, draw_seed, finite_costs, one_blas_thread, require

SCALAR = ("scipy-de", "pymoo-ga", "pymoo-pso", "cma", "pygmo-sade")
FOREIGN = (*SCALAR, "scipy-least-squares")
EXTRA = ("pymoo-ga", "pymoo-pso", "cma", "pygmo-sade")
scalar = pytest.mark.parametrize("name", SCALAR)
foreign = pytest.mark.parametrize("name", FOREIGN)


def search(name: str, problem: Any, budget: float = 600.0, **stop: Any) -> optimize.Outcome:
    stop = {"generations": 10**6, "budget": budget, "target_cost": -1.0, **stop}
    return optimize.minimize(optimize.create(name), problem, seed=3, stop=optimize.Stop(**stop))


@foreign
def test_the_budget_ends_a_run_to_the_trajectory(name: str, oscillation: Callable[..., Any]) -> None:
    problem = oscillation()
    outcome = search(name, problem, 333.0)
    assert outcome.status == "budget"
    assert problem.spent <= 333.0 + 1e-9
    assert outcome.trajectories == pytest.approx(problem.spent)
    # a Jacobian that no longer fits the budget is not begun
    assert problem.spent >= 333.0 - problem.dimension - problem.extra
    assert problem.largest <= 0.0


@scalar
def test_the_target_ends_a_run_at_once(name: str) -> None:
    problem = Only(sphere, 3)
    outcome = search(name, problem, 1e5, target_cost=1e-4)
    assert outcome.status == "target"
    assert outcome.cost <= 1e-4
    assert outcome.trajectories <= problem.asked


@scalar
def test_ctrl_c_gets_through(name: str) -> None:
    def cost(X: np.ndarray) -> np.ndarray:
        if problem.asked > 200:
            raise KeyboardInterrupt
        return sphere(X)

    problem = Only(cost, 3)
    outcome = search(name, problem, 1e5)
    assert outcome.status == "interrupted"
    assert np.isfinite(outcome.cost)
    assert outcome.state is not None


@pytest.mark.parametrize(
    "name", ["scipy-de", "scipy-least-squares", "cma", "pymoo-ga", "pymoo-pso", "pygmo-sade"]
)
def test_a_run_can_be_repeated_from_its_state(
    name: str, oscillation: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second run of a library begins from the first one's stream, through a file and by a fresh optimizer."""
    monkeypatch.setattr(libraries, "RESTARTS", 0)
    whole = search(name, oscillation(noise=0.3), 40_000.0, generations=2)
    first = search(name, oscillation(noise=0.3), 40_000.0, generations=1)
    assert first.state is not None
    optimize.save_state(tmp_path / "state.npz", first.state)
    state = optimize.load_state(tmp_path / "state.npz")
    stop = optimize.Stop(generations=2, budget=40_000.0)
    again = optimize.minimize(optimize.create(name), oscillation(noise=0.3), seed=99, stop=stop, state=state)
    assert again.z.tobytes() == whole.z.tobytes()
    assert again.history.tobytes() == whole.history.tobytes()
    assert again.trajectories == whole.trajectories > first.trajectories


@foreign
def test_nothing_is_left_behind(
    name: str,
    oscillation: Callable[..., Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    np.random.seed(7)  # noqa: NPY002
    expected = np.random.RandomState(7).random(3)
    filters = list(warnings.filters)
    search(name, oscillation())
    assert np.random.random(3).tolist() == expected.tolist()  # noqa: NPY002
    assert list(warnings.filters) == filters
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


@scalar
def test_infinite_costs_do_no_harm(name: str) -> None:
    problem = Only(lambda X: np.where(X[:, 0] > 0.5, np.inf, sphere(X)), 3)
    outcome = search(name, problem)
    assert outcome.cost < 0.2


@scalar
def test_costs_that_are_all_infinite_do_no_harm(name: str) -> None:
    outcome = search(name, Only(lambda X: np.full(len(X), np.nan), 3), 200.0)
    assert outcome.status == "budget"
    assert outcome.cost == np.inf


def test_starts_that_diverge_are_abandoned(oscillation: Callable[..., Any]) -> None:
    problem = oscillation(broken=lambda Z: Z[:, 2] > 0.2)
    outcome = search("scipy-least-squares", problem, 300.0)
    assert outcome.status == "budget"
    assert outcome.generation > 10
    assert np.isfinite(outcome.cost)


@foreign
def test_own_values_are_where_the_first_run_begins(
    name: str, oscillation: Callable[..., Any], near: Callable[[float], np.ndarray]
) -> None:
    problem = oscillation()
    start = near(1.0)[:4]
    cost = float(problem.costs(start[None, :], 2)[0])
    stop = optimize.Stop(generations=1, budget=300.0, target_cost=cost * 1.02)
    outcome = optimize.minimize(optimize.create(name), problem, seed=0, starts=start[None, :], stop=stop)
    if name == "cma":  # begins about its first mean, not at it
        assert np.abs(outcome.z[:4] - start).max() < 0.5
    else:
        assert outcome.status == "target"


@pytest.mark.parametrize("name", EXTRA)
def test_a_missing_package_is_named(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    package = name.split("-")[0]
    real = importlib.import_module

    def missing(module: str, *arguments: Any, **options: Any) -> Any:
        if module.split(".")[0] == package:
            raise ImportError(module)
        return real(module, *arguments, **options)

    monkeypatch.setattr("importlib.import_module", missing)
    assert name in optimize.names()
    with pytest.raises(IdentificationError, match=rf"{package}; .*pip install '\.\[compare\]'") as error:
        optimize.create(name)
    assert "\n" not in str(error.value)


def test_scipys_evolution_converges_on_a_floor_and_begins_anew() -> None:
    """As under noise: costs differ by less than a hundredth, which is where SciPy ends and polishes."""
    outcome = search("scipy-de", Only(lambda X: 50.0 + sphere(X), 3), 2000.0)
    assert outcome.generation >= 3
    assert outcome.cost == pytest.approx(50.0, abs=1e-9), "polished"


def test_scipys_least_squares_gives_a_start_up_after_twenty_steps(
    oscillation: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    monkeypatch.setattr("scipy.optimize.least_squares", lambda *_, max_nfev, **__: asked.append(max_nfev))
    search("scipy-least-squares", oscillation(), generations=2)
    assert asked == [20, 20]


def test_limits_of_the_whole_process_are_taken_one_at_a_time() -> None:
    inside, leave = threading.Event(), threading.Event()
    order: list[str] = []

    def first() -> None:
        with one_blas_thread():
            inside.set()
            leave.wait(5.0)
            order.append("first")

    def second() -> None:
        inside.wait(5.0)
        leave.set()
        with one_blas_thread():
            order.append("second")

    before = [(one["filepath"], one["num_threads"]) for one in threadpool_info()]
    threads = [threading.Thread(target=work) for work in (first, second)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert order == ["first", "second"]
    assert [(one["filepath"], one["num_threads"]) for one in threadpool_info()] == before


def test_what_needs_residuals_says_so() -> None:
    needing = {n for n in optimize.names() if optimize.needs_residuals(n)}
    assert needing == {"ps-gde-lm", "scipy-least-squares"}
    with pytest.raises(IdentificationError, match="no residuals"):
        search("scipy-least-squares", Only(sphere, 3))


def test_cma_refuses_a_single_variable() -> None:
    with pytest.raises(IdentificationError, match="one variable"):
        search("cma", Only(sphere, 1))


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


def test_points_beside_the_box_are_asked_on_its_bound() -> None:
    problem = Only(sphere, 2)
    ledger = optimize.Ledger(problem, optimize.Evaluations.none(problem))
    finite_costs(ledger, np.array([[1.0 + 1e-16, -1e-18]]))
    assert problem.outside <= 0.0


def test_seeds_are_positive_and_differ() -> None:
    seeds = {draw_seed(np.random.default_rng(k)) for k in range(200)}
    assert len(seeds) == 200
    assert min(seeds) >= 1
    assert max(seeds) < 2**31


def test_packages_load() -> None:
    assert require("cma").__name__ == "cma"
    assert isinstance(optimize.create("cma"), Library)
