"""What an optimizer costs beside the simulation: a generation of 48 members on the paper's problem, one thread.

Everything but the compiled time loop counts as overhead: mutation, crossover, selection, random numbers, the
ledger, from the unit box to parameters, initial states. Both are timed in turn, in processor time.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.clock import interleave
from benchmarks.table import Row
from stoop import optimize
from stoop.optimize.ledger import Evaluations
from stoop.optimize.population import Population, latin_hypercube
from stoop.problem import Misfit
from stoop_studies.problems.paper import paper

PART = "overhead"
MEMBERS = 48
ROUNDS = 60
ASKED = 20.0  #: %, of those that the project stands for
NAMES = ("ps-gde", "de-rand-1-bin", "pso", "ga")
POPULATION = "ps-gde-lm, its population"


def run() -> list[Row]:
    """Time generations and the simulations in them."""
    with patch.dict(os.environ, {"STOOP_THREADS": "1"}):
        problem = paper().problem("N", 0, noise=False)
        calls = {name: _generations(name, problem) for name in NAMES}
        calls[POPULATION] = _population(problem)
        times = interleave({"simulation": _simulation(problem), **calls}, ROUNDS)
    simulation = times.pop("simulation")
    return [_row(name, float(np.median(1.0 - simulation / taken)), taken) for name, taken in times.items()]


def _row(name: str, share: float, taken: Any) -> Row:
    note = f"of a generation of {MEMBERS}, which takes {1e3 * float(np.median(taken)):.2f} ms"
    asked = ASKED if name in ("ps-gde", POPULATION) else None
    return Row(PART, f"{name}: all but simulation", 100.0 * share, "%", at_most=asked, note=note)


def _simulation(problem: Misfit) -> Callable[[], object]:
    """Return the bare kernel's call for one generation."""
    X = np.random.default_rng(0).random((MEMBERS, problem.dimension))
    seen: list[tuple[Any, ...]] = []
    kernel = problem.layout.vehicle.kernel()
    with patch.object(type(kernel), "cost", lambda self, *words: seen.append(words) or np.zeros(MEMBERS)):
        problem.costs(X, len(problem.prices) - 1)
    words = seen[0]
    return lambda: kernel.cost(*words)


def _generations(name: str, problem: Misfit) -> Callable[[], object]:
    """Return a call that does the next generation; local searches are left out, they are other work."""
    whole: Any = optimize.create(name)
    optimizer = replace(whole, members=MEMBERS, **({"prey": None} if name == "ps-gde" else {}))
    ledger = optimize.Ledger(problem, Evaluations.none(problem))
    state = optimizer.init(ledger, 0, np.empty((0, problem.dimension)))

    def step() -> None:
        nonlocal state
        state, _ = optimizer.step(state, ledger)

    return step


def _population(problem: Misfit) -> Callable[[], object]:
    """Return a call that moves the default's population by one generation."""
    ledger = optimize.Ledger(problem, Evaluations.none(problem))
    generator = np.random.Generator(np.random.PCG64(0))
    X = latin_hypercube(MEMBERS, problem.dimension, generator)
    population = Population.first(X, ledger.costs(X, ledger.full))

    def step() -> None:
        nonlocal population
        trials = population.ask(generator)
        population = population.tell(trials, ledger.costs(trials.X, ledger.full), generator)

    return step
