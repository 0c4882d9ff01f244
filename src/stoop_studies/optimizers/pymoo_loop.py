"""pymoo's genetic algorithm and particle swarm in pymoo's own loop, with its own constants and ending.

References
----------
Blank and Deb (2020), pymoo: multi-objective optimization in Python, IEEE Access 8, 89497-89509.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.libraries import Library, Search, draw_seed, finite_costs, require
from stoop.optimize.operators import MEMBERS
from stoop_studies.optimizers.pieces.operators import uniform


def searched_by(module: str, name: str) -> Search:
    """Return a search by one of pymoo's algorithms, 50 members."""

    def search(ledger: Ledger, start: FloatArray, generator: np.random.Generator) -> None:
        population = uniform(MEMBERS, ledger.dimension, generator)
        population[0] = start
        algorithm = getattr(require(module), name)(pop_size=MEMBERS, sampling=population)
        require("pymoo.optimize").minimize(
            _problem(ledger), algorithm, seed=draw_seed(generator), copy_algorithm=False, verbose=False
        )

    return search


def pymoo_ga() -> Library:
    """Return pymoo's genetic algorithm.

    Raises
    ------
    IdentificationError
        The package is not installed.
    """
    return _library("pymoo-ga", "pymoo.algorithms.soo.nonconvex.ga", "GA")


def pymoo_pso() -> Library:
    """Return pymoo's particle swarm, which adapts its constants.

    Raises
    ------
    IdentificationError
        The package is not installed.
    """
    return _library("pymoo-pso", "pymoo.algorithms.soo.nonconvex.pso", "PSO")


def _library(name: str, module: str, algorithm: str) -> Library:
    require("pymoo")
    return Library(name, searched_by(module, algorithm))


def _problem(ledger: Ledger) -> Any:
    """Return the problem in pymoo's words."""
    base: Any = require("pymoo.core.problem").Problem

    class Box(base):  # type: ignore[misc] # pymoo has no types
        def __init__(self) -> None:
            D = ledger.dimension
            super().__init__(n_var=D, n_obj=1, xl=np.zeros(D), xu=np.ones(D))

        def _evaluate(self, x: FloatArray, out: dict[str, Any], *_: Any, **__: Any) -> None:
            out["F"] = finite_costs(ledger, x)[:, None]

    return Box()
