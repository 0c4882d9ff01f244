"""Solvers of others, which benchmarks compare, simulate the same equations at the same cost."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.estimate.fit import estimation_problem
from stoop.problem.misfit import Misfit

ROOT = Path(__file__).parents[2]


def part(name: str) -> Any:
    """Import a module of the benchmarks, which lie outside the package."""
    if str(ROOT) not in sys.path:
        sys.path.insert(0, str(ROOT))
    return importlib.import_module(f"benchmarks.{name}")


@pytest.fixture(scope="module")
def posed() -> tuple[Misfit, Any]:
    flown = part("solver_stoop").scene()
    options = part("solver_stoop").options(flown)
    problem, _ = estimation_problem(flown.start, flown.flights, flown.windows, options)
    return problem, part("solvers").case_of(flown, problem)


@pytest.mark.parametrize("module", ["solver_scipy", "solver_casadi"])
def test_trajectories_of_other_solvers_are_those_of_the_kernel(
    posed: tuple[Misfit, Any], module: str
) -> None:
    (problem, case), solvers = posed, part("solvers")
    z = solvers.probe(case)
    options = {"stride": 50} if module == "solver_casadi" else {}
    assert solvers.difference(problem, z, part(module).prepare(case, **options).simulate(z)) < 1e-12
    if module == "solver_scipy":
        other = part(module).prepare(replace(case, dt=case.dt * (1.0 + 1e-6))).simulate(z)
        assert solvers.difference(problem, z, other) > solvers.TOLERANCE, "a difference is noticed"


def test_the_cost_of_other_solvers_is_that_of_stoop(posed: tuple[Misfit, Any]) -> None:
    """Readings, standard deviations and priors of the case add up to the cost that stoop minimizes."""
    problem, case = posed
    z = case.start + np.concatenate([np.zeros(case.coefficients), np.full(problem.extra, 0.1)])
    readings = np.stack([problem.outputs(z, i) for i in range(len(problem.pieces))])
    own = np.sum(((readings - case.measured) / case.sigma) ** 2) + np.sum(z[case.coefficients :] ** 2)
    cost = np.sum(problem.residuals(z[None, :], len(problem.prices) - 1) ** 2)
    assert own == pytest.approx(cost, rel=1e-12)
