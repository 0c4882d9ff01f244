"""Optimizers of pymoo and pygmo in their own loops, with their own constants and endings.

References
----------
Blank and Deb (2020), pymoo: multi-objective optimization in Python, IEEE Access 8, 89497-89509.
Biscani and Izzo (2020), A parallel global multiobjective framework for optimization: pagmo, J. Open Source
Software 5, 2338.
Brest, Greiner, Boskovic, Mernik and Zumer (2006), IEEE TEC 10, 646-657 (jDE, pygmo's self-adaptive evolution).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.random import Generator

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Halt, Ledger
from stoop.optimize.libraries import LARGE, Library, draw_seed, finite_costs, require
from stoop.optimize.population import MEMBERS
from stoop_studies.optimizers.evolution import uniform

CHUNK: Final = 20  #: generations of pygmo between two checks of convergence
SPREAD: Final = 1e-8  #: of the costs, relative, at which a population of pygmo has converged


def pymoo_ga() -> Library:
    """Return pymoo's genetic algorithm; an `IdentificationError` where the package is not installed, as all here."""
    return _pymoo("pymoo-ga", "pymoo.algorithms.soo.nonconvex.ga", "GA")


def pymoo_pso() -> Library:
    """Return pymoo's particle swarm, which adapts its constants."""
    return _pymoo("pymoo-pso", "pymoo.algorithms.soo.nonconvex.pso", "PSO")


def _pymoo(name: str, module: str, algorithm: str) -> Library:
    """Return a search by one of pymoo's algorithms, 50 members."""
    require("pymoo")

    def search(ledger: Ledger, start: FloatArray, generator: Generator) -> None:
        base: Any = require("pymoo.core.problem").Problem
        D = ledger.dimension

        class Box(base):  # type: ignore[misc] # pymoo has no types
            """The problem as pymoo defines it."""

            def __init__(self) -> None:
                super().__init__(n_var=D, n_obj=1, xl=np.zeros(D), xu=np.ones(D))

            def _evaluate(self, x: FloatArray, out: dict[str, Any], *_: Any, **__: Any) -> None:
                out["F"] = finite_costs(ledger, x)[:, None]

        population = uniform(MEMBERS, D, generator)
        population[0] = start
        made = getattr(require(module), algorithm)(pop_size=MEMBERS, sampling=population)
        run = require("pymoo.optimize").minimize
        run(Box(), made, seed=draw_seed(generator), copy_algorithm=False, verbose=False)

    return Library(name, search)


class Escape:
    """Carries an exception past a library that would swallow it.

    A cost function that raises may leave foreign code in any state. So the exception is kept, the rest of the run
    sees `LARGE`, and `check` raises what was kept once the library has returned.
    """

    def __init__(self, ledger: Ledger) -> None:
        self.ledger = ledger
        self.kept: BaseException | None = None

    def costs(self, X: FloatArray) -> FloatArray:
        """Return finite costs, (n,), of points, (n, D)."""
        if self.kept is None:
            try:
                return finite_costs(self.ledger, X)
            except (Halt, KeyboardInterrupt) as exception:
                self.kept = exception
        return np.full(len(X), LARGE)

    def check(self) -> None:
        """Raise what was kept."""
        if self.kept is not None:
            raise self.kept


class _PygmoProblem:
    """The problem as pygmo defines it; pygmo copies its problems, but all copies share one ledger."""

    def __init__(self, escape: Escape, dimension: int) -> None:
        self.escape, self.dimension = escape, dimension

    def fitness(self, x: FloatArray) -> list[float]:
        return [float(self.escape.costs(x[None, :])[0])]

    def get_bounds(self) -> tuple[list[float], list[float]]:
        return [0.0] * self.dimension, [1.0] * self.dimension

    def __deepcopy__(self, memory: dict[int, Any]) -> _PygmoProblem:
        return self


def pygmo_sade() -> Library:
    """Return pygmo's self-adaptive differential evolution (jDE); a run ends when its costs have become equal."""
    require("pygmo")

    def search(ledger: Ledger, start: FloatArray, generator: Generator) -> None:
        pygmo, escape, seed = require("pygmo"), Escape(ledger), draw_seed(generator)
        problem = pygmo.problem(_PygmoProblem(escape, ledger.dimension))
        population = pygmo.population(problem, MEMBERS - 1, seed=seed)
        population.push_back(start)
        algorithm = pygmo.algorithm(pygmo.sade(gen=CHUNK, ftol=0.0, xtol=0.0, memory=True, seed=seed))
        escape.check()
        while np.ptp(costs := population.get_f()[:, 0]) > SPREAD * abs(float(costs.mean())):
            population = algorithm.evolve(population)
            escape.check()

    return Library("pygmo-sade", search)
