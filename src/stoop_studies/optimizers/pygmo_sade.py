"""pygmo's self-adaptive differential evolution (jDE), begun again from a new population when it has converged.

References
----------
Biscani and Izzo (2020), A parallel global multiobjective framework for optimization: pagmo, J. Open Source
Software 5, 2338.
Brest, Greiner, Boskovic, Mernik and Zumer (2006), IEEE TEC 10, 646-657 (the adaptation).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.libraries import Escape, Library, draw_seed, require
from stoop.optimize.operators import MEMBERS

CHUNK: Final = 20  #: generations between two looks at whether to end
SPREAD: Final = 1e-8  #: of the costs, relative, at which a population has converged


class _Box:
    """The problem in pygmo's words; pygmo copies its problems, but the books are one."""

    def __init__(self, escape: Escape, dimension: int) -> None:
        self.escape, self.dimension = escape, dimension

    def fitness(self, x: FloatArray) -> list[float]:
        return [float(self.escape.costs(x[None, :])[0])]

    def get_bounds(self) -> tuple[list[float], list[float]]:
        return [0.0] * self.dimension, [1.0] * self.dimension

    def __deepcopy__(self, memory: dict[int, Any]) -> _Box:
        return self


def search(ledger: Ledger, start: FloatArray, generator: np.random.Generator) -> None:
    """Run once; `start` takes the last place of the population."""
    pygmo = require("pygmo")
    escape = Escape(ledger)
    seed = draw_seed(generator)
    population = pygmo.population(pygmo.problem(_Box(escape, ledger.dimension)), MEMBERS - 1, seed=seed)
    population.push_back(start)
    algorithm = pygmo.algorithm(pygmo.sade(gen=CHUNK, ftol=0.0, xtol=0.0, memory=True, seed=seed))
    escape.check()
    while not _converged(population.get_f()[:, 0]):
        population = algorithm.evolve(population)
        escape.check()


def pygmo_sade() -> Library:
    """Return pygmo's self-adaptive differential evolution.

    Raises
    ------
    IdentificationError
        The package is not installed.
    """
    require("pygmo")
    return Library("pygmo-sade", search)


def _converged(costs: FloatArray) -> bool:
    """Whether members, (n,), can no longer be told apart by their costs."""
    return float(costs.max() - costs.min()) <= SPREAD * abs(float(costs.mean()))
