"""Other libraries: calls are counted, an end of the run passes through, and the process stays as it was."""

import importlib
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from naive.landscapes import Only, ellipsoid, sphere

from stoop import optimize
from stoop.errors import IdentificationError
from stoop.optimize import libraries
from stoop.optimize.libraries import draw_seed

SCIPY = ("scipy-de", "scipy-least-squares")
EXTRA = ("pymoo-ga", "pymoo-pso", "cma", "pygmo-sade")  #: of optional packages


def search(name: str, problem: Any, budget: float = 600.0, **stop: Any) -> optimize.Outcome:
    stop = {"generations": 10**6, "budget": budget, "target_cost": -1.0, **stop}
    return optimize.minimize(optimize.create(name), problem, seed=3, stop=optimize.Stop(**stop))


def check_budget_and_process(name: str, problem: Any, folder: Path, patch: pytest.MonkeyPatch) -> None:
    """The budget ends a run to the trajectory; random state, filters of warnings and folder stay as they were."""
    patch.chdir(folder)
    np.random.seed(7)  # noqa: NPY002
    filters = list(warnings.filters)
    outcome = search(name, problem, 333.0)
    assert (outcome.status, outcome.trajectories) == ("budget", pytest.approx(problem.spent))
    # a Jacobian that no longer fits the budget is not begun
    assert 333.0 - problem.dimension - problem.extra <= problem.spent <= 333.0 + 1e-9
    assert problem.largest <= 0.0
    assert np.random.random(3).tolist() == np.random.RandomState(7).random(3).tolist()  # noqa: NPY002
    assert (list(warnings.filters), list(folder.iterdir())) == (filters, [])


def check_target_and_interrupt(name: str) -> None:
    problem = Only(sphere, 3)
    outcome = search(name, problem, 1e5, target_cost=1e-4)
    assert (outcome.status, outcome.cost <= 1e-4) == ("target", True)
    assert outcome.trajectories <= problem.asked

    def cost(X: np.ndarray) -> np.ndarray:
        if problem.asked > 200:
            raise KeyboardInterrupt
        return sphere(X)

    problem = Only(cost, 3)
    outcome = search(name, problem, 1e5)
    assert (outcome.status, np.isfinite(outcome.cost)) == ("interrupted", True)
    assert outcome.state is not None


def check_repetition(name: str, make: Callable[[], Any], folder: Path, patch: pytest.MonkeyPatch) -> None:
    """The second run of a library begins from the first one's stream, through a file and by a fresh optimizer."""
    patch.setattr(libraries, "RESTARTS", 0)
    whole, first = (search(name, make(), 40_000.0, generations=n) for n in (2, 1))
    optimize.save_state(folder / "state.npz", first.state)
    state, stop = optimize.load_tagged(folder / "state.npz")[0], optimize.Stop(generations=2, budget=40_000.0)
    again = optimize.minimize(optimize.create(name), make(), seed=99, stop=stop, state=state)
    assert (again.z.tobytes(), again.history.tobytes()) == (whole.z.tobytes(), whole.history.tobytes())
    assert again.trajectories == whole.trajectories > first.trajectories


def check_infinite_costs(name: str) -> None:
    assert search(name, Only(lambda X: np.where(X[:, 0] > 0.5, np.inf, sphere(X)), 3)).cost < 0.2
    outcome = search(name, Only(lambda X: np.full(len(X), np.nan), 3), 200.0)
    assert (outcome.status, outcome.cost) == ("budget", np.inf)


def first_run(name: str, problem: Any, start: np.ndarray) -> optimize.Outcome:
    target = float(problem.costs(start[None, :], 2)[0]) * 1.02
    stop = optimize.Stop(generations=1, budget=300.0, target_cost=target)
    return optimize.minimize(optimize.create(name), problem, seed=0, starts=start[None, :], stop=stop)


@pytest.mark.parametrize("name", SCIPY)
def test_scipy(name, oscillation, near, tmp_path, monkeypatch, capfd):
    folder = tmp_path / "empty"
    folder.mkdir()
    check_budget_and_process(name, oscillation(), folder, monkeypatch)
    assert capfd.readouterr() == ("", "")
    check_repetition(name, lambda: oscillation(noise=0.3), tmp_path, monkeypatch)
    assert first_run(name, oscillation(), near(1.0)[:4]).status == "target"


def test_scipys_evolution() -> None:
    """It converges on a floor, where costs differ by less than a hundredth, polishes there, and begins anew."""
    check_target_and_interrupt("scipy-de")
    check_infinite_costs("scipy-de")
    outcome = search("scipy-de", Only(lambda X: 50.0 + sphere(X), 3), 2000.0)
    assert outcome.generation >= 3
    assert outcome.cost == pytest.approx(50.0, abs=1e-9), "polished"


def test_scipys_least_squares_gives_up_after_twenty_steps_or_where_it_diverges(oscillation, monkeypatch):
    outcome = search("scipy-least-squares", oscillation(broken=lambda Z: Z[:, 2] > 0.2), 300.0)
    assert (outcome.status, np.isfinite(outcome.cost)) == ("budget", True)
    assert outcome.generation > 10
    asked: list[int] = []
    monkeypatch.setattr("scipy.optimize.least_squares", lambda *_, max_nfev, **__: asked.append(max_nfev))
    search("scipy-least-squares", oscillation(), generations=2)
    assert asked == [20, 20]


@pytest.mark.parametrize("name", EXTRA)
def test_a_missing_package_is_named(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    package, real = name.split("-")[0], importlib.import_module

    def missing(module: str, *arguments: Any) -> Any:
        if module.split(".")[0] == package:
            raise ImportError(module)
        return real(module, *arguments)

    monkeypatch.setattr("importlib.import_module", missing)
    assert name in optimize.names()
    with pytest.raises(IdentificationError, match=rf"{package}; .*pip install '\.\[compare\]'") as error:
        optimize.create(name)
    assert "\n" not in str(error.value)


def test_optimizers_that_need_residuals_are_refused_without() -> None:
    needy = {n for n in optimize.names() if optimize.needs_residuals(n)}
    assert needy == {"ps-gde-lm", "scipy-least-squares"}
    with pytest.raises(IdentificationError, match="no residuals"):
        search("scipy-least-squares", Only(sphere, 3))


def test_seeds_are_positive_and_differ() -> None:
    seeds = {draw_seed(np.random.default_rng(k)) for k in range(200)}
    assert len(seeds) == 200
    assert 1 <= min(seeds) <= max(seeds) < 2**31


@pytest.mark.parametrize("name", EXTRA)
def test_packages(name, oscillation, near, tmp_path, monkeypatch, capfd):
    folder = tmp_path / "empty"
    folder.mkdir()
    check_target_and_interrupt(name)
    capfd.readouterr()  # the import of a package may warn
    check_budget_and_process(name, oscillation(), folder, monkeypatch)
    assert capfd.readouterr() == ("", "")
    check_repetition(name, lambda: Only(ellipsoid, 2), tmp_path, monkeypatch)
    check_infinite_costs(name)
    start = near(1.0)[:4]
    outcome = first_run(name, oscillation(), start)
    if name == "cma":  # begins about its first mean, not at it
        assert np.abs(outcome.z[:4] - start).max() < 0.5
    else:
        assert outcome.status == "target"


def test_cma_refuses_a_single_variable() -> None:
    with pytest.raises(IdentificationError, match="one variable"):
        search("cma", Only(sphere, 1))
