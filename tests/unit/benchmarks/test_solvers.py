"""Other tools simulate what stoop simulates, or get no figures. JAX is checked by the benchmark itself alone."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from stoop.estimate.fit import estimation_problem
from stoop.problem.misfit import Misfit

sys.path.insert(0, str(Path(__file__).parents[3]))


def part(name: str) -> ModuleType:
    return importlib.import_module(f"benchmarks.{name}")


@pytest.fixture(scope="module")
def posed() -> tuple[Misfit, Any]:
    """The problem of stoop, and the same written out for others."""
    flown = part("solver_stoop").scene()
    problem, _ = estimation_problem(
        flown.start, flown.flights, flown.windows, part("solver_stoop").options(flown)
    )
    return problem, part("solvers").case_of(flown, problem)


@pytest.mark.parametrize("module", ["solver_scipy", "solver_casadi"])
def test_trajectories_are_those_of_the_kernel(posed: tuple[Misfit, Any], module: str) -> None:
    (problem, case), solvers = posed, part("solvers")
    z = solvers.probe(case)
    options = {"stride": 50} if module == "solver_casadi" else {}
    assert solvers.difference(problem, z, part(module).prepare(case, **options).simulate(z)) < 1e-12


def test_a_difference_is_noticed(posed: tuple[Misfit, Any]) -> None:
    (problem, case), solvers = posed, part("solvers")
    z = solvers.probe(case)
    other = replace(case, dt=case.dt * (1.0 + 1e-6))
    assert solvers.difference(problem, z, part("solver_scipy").prepare(other).simulate(z)) > solvers.TOLERANCE


def test_cost_is_that_of_stoop(posed: tuple[Misfit, Any]) -> None:
    """Readings, standard deviations and priors of the case add up to the cost that stoop minimizes."""
    problem, case = posed
    z = case.start + np.concatenate([np.zeros(case.coefficients), np.full(problem.extra, 0.1)])
    readings = np.stack([problem.outputs(z, i) for i in range(len(problem.pieces))])
    own = np.sum(((readings - case.measured) / case.sigma) ** 2) + np.sum(z[case.coefficients :] ** 2)
    assert own == pytest.approx(
        np.sum(problem.residuals(z[None, :], len(problem.prices) - 1) ** 2), rel=1e-12
    )


def test_lines_that_hold_code_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    solvers = part("solvers")
    head = ('"""Text."""', "import math", "def f(", "    x,", "):")
    body = ('    """More."""', "    # why", "    return math.sqrt(", "        x", "    )")
    (tmp_path / "small.py").write_text("\n".join([*head, *body]))
    monkeypatch.setattr(solvers, "__file__", str(tmp_path / "solvers.py"))
    assert solvers.lines("small") == 5, "def, x, return, its argument, the bracket that closes it"
