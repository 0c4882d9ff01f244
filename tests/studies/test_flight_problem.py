import re
from typing import Any

import numpy as np
import pytest

from stoop import optimize
from stoop.flight.load import save_flight
from stoop.optimize.problem import forward_jacobian
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import load_vehicle
from stoop.workflow.demo import MANEUVER
from stoop_studies.problems import Posed, pose

FREE = ("CLalpha", "Cmalpha", "Cmelevator")


def _freed(line: re.Match[str]) -> str:
    name, value = line[1], float(line[2])
    low, high = sorted((0.3 * value, 3.0 * value))
    free = f"free = true, bounds = [{low}, {high}]" if name in FREE else "free = false"
    return f"{name} = {{ value = {value}, {free} }}"


@pytest.fixture(scope="module")
def posed(tmp_path_factory: pytest.TempPathFactory) -> Posed:
    folder = tmp_path_factory.mktemp("flight")
    vehicle = load_vehicle("twin-boom")
    flight = simulate_flight(vehicle.reduced("longitudinal"), parse_maneuver(MANEUVER, "m"), 3, name="flown")
    save_flight(flight, folder / "flown.nc")
    text = re.sub(r"^(C\w+) = (\S+)$", _freed, vehicle.text, flags=re.MULTILINE)
    (folder / "v.toml").write_text(f'model.reduce = "longitudinal"\n{text}', encoding="utf-8")
    place, file = str(folder / "flown.nc"), str(folder / "v.toml")
    return pose("flight", 1, flight=place, vehicle=file, maneuvers=["0:9", "10:18"])


def test_everything_is_searched_in_one_box(posed: Posed) -> None:
    problem: Any = posed.problem
    assert problem.extra == 0
    assert problem.dimension == len(posed.parameters) == problem.problem.dimension + problem.problem.extra
    assert problem.problem.extra >= 8  # four states in either window


def test_cost_is_that_of_the_problem_apart(posed: Posed) -> None:
    problem: Any = posed.problem
    X = np.random.default_rng(0).uniform(0.3, 0.7, (5, problem.dimension))
    X[0, problem.problem.dimension :] = 0.5  # where the measurements put initial states
    full = len(problem.prices) - 1
    costs = problem.costs(X, full)
    apart = problem.problem
    assert costs[0] == pytest.approx(apart.costs(X[:1, : apart.dimension], full)[0])
    assert costs == pytest.approx(np.sum(apart.residuals(problem.split(X), full) ** 2, axis=1))


def test_jacobian_is_the_difference_quotient(posed: Posed) -> None:
    problem: Any = posed.problem
    z = np.full(problem.dimension, 0.52)
    full = len(problem.prices) - 1
    r = problem.residuals(z[None], full)[0]
    J, spent = problem.jacobian(z, full, r)
    naive, most = forward_jacobian(problem, z, full, r)
    assert np.abs(J - naive).max() < 1e-3 * np.abs(naive).max()
    assert spent < most  # an initial state is flown on its own window only


def test_the_default_gets_there_blind_and_near_the_truth(posed: Posed) -> None:
    stop = optimize.Stop(budget=20_000.0, target_cost=posed.target)
    outcome = optimize.minimize(optimize.create(), posed.problem, seed=7, stop=stop)
    assert outcome.status == "target"
    found = dict(zip(posed.parameters, posed.values(outcome.z), strict=True))
    truth = {name: load_vehicle("twin-boom").value(name) for name in FREE}
    assert {name: found[name] for name in FREE} == pytest.approx(truth, rel=0.05)
