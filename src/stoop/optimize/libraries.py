"""Optimizers of other libraries behind the interface of this room: SciPy's differential evolution and least squares, CMA-ES.

One step is one run of the library to its own end; the next starts from fresh random numbers. Its evaluations count as any
other optimizer's, and budget, target or Ctrl-C end it in the middle.

Differential evolution starts again from a new population whenever it has converged. Four settings are not SciPy's
defaults (best1bin, dither 0.5 to 1, crossover 0.7, converged when the standard deviation of the costs is 1 % of their
mean, polished by L-BFGS-B then): 50 members, as for all others here (SciPy: 15 a variable); as many generations as
convergence takes (1000); a generation is evaluated as a whole, so that its winners take effect in the next one
("deferred"; SciPy: at once); and the first member is the given start. Its Latin hypercube is ours.

Least squares is trust region reflective from one random start after another. A Jacobian by differences counts one
trajectory per variable. Two settings are ours. A start is given up after 20 trial steps (SciPy: 100 per variable), because
most starts that have not converged by then never do. 20 is the best compromise for SciPy on seeds 0 to 59 of the paper's
problem: expected evaluations on N, W, N+noise, W+noise and N+few+noise are 98, 1614, 108, 1643 and 157 with 40 steps, 94,
1127, 104, 1196 and 161 with 20, and 93, 1092, 103, 1127 and 335 with 15; 1000 steps take more than 20 on each. And
tolerances are as small as rounding allows, since the target ends a run.

References
----------
Storn and Price (1997), J. Global Optim. 11, 341-359; `scipy.optimize.differential_evolution`.
Branch, Coleman and Li (1999), A subspace, interior, and conjugate gradient method for large-scale
bound-constrained minimization problems, SIAM J. Sci. Comput. 21, 1-23; `scipy.optimize.least_squares`.
Hansen and Ostermeier (2001), Completely derandomized self-adaptation in evolution strategies, Evolutionary
Computation 9, 159-195; package ``cma``.
Hansen (2009), Benchmarking a BI-population CMA-ES on the BBOB-2009 function testbed, GECCO, 2389-2395.
"""

from __future__ import annotations

import importlib
import threading
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, replace
from io import StringIO
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from threadpoolctl import threadpool_limits

from stoop.base.arrays import FloatArray
from stoop.base.extras import install
from stoop.errors import IdentificationError
from stoop.optimize.ledger import HUGE, Evaluations, Ledger
from stoop.optimize.normal_equations import dense
from stoop.optimize.population import MEMBERS, latin_hypercube
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State

LARGE: Final = 1e100  #: stands for an infinite cost, which other libraries cannot handle
#: of CMA-ES with a larger population, as BIPOP is usually run; those with a small one do not count
RESTARTS: Final = 9
PROCESS_LOCK: Final = threading.RLock()  #: for what the whole process shares, as the number of BLAS threads


@dataclass(frozen=True, kw_only=True)
class LibraryState(State):
    """State between two runs; `starts`, (k, D), are the user's own values from which no run has started yet."""

    starts: FloatArray


@dataclass(frozen=True)
class Library:
    """A search of another library; it never claims convergence.

    `search` is one run: from ledger, first point (D,) and random numbers to the library's own end.
    """

    name: str
    search: Callable[[Ledger, FloatArray, Generator], None]

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> LibraryState:
        """Keep the user's own values for the first runs; nothing is evaluated yet."""
        return LibraryState(
            optimizer=self.name,
            generation=0,
            stream=RandomStream.from_seed(seed),
            evaluations=Evaluations.none(problem),
            starts=np.clip(starts[:, : problem.dimension], 0.0, 1.0),
        )

    def step(self, state: LibraryState, problem: Problem) -> tuple[LibraryState, Event]:
        """Run the library once, from the next of the user's own values or from anywhere.

        Its warnings and global seeds are contained; BLAS has one thread, so that it rounds alike.
        """
        ledger = Ledger.at(problem, state.evaluations)
        generator = state.stream.generator()
        anywhere = generator.random(problem.dimension)
        start = state.starts[0] if len(state.starts) else anywhere
        with PROCESS_LOCK, warnings.catch_warnings(), threadpool_limits(1, user_api="blas"):
            warnings.simplefilter("ignore")
            before = np.random.get_state()  # noqa: NPY002 - theirs, and restored as it was
            try:
                self.search(ledger, start.copy(), generator)
            finally:
                np.random.set_state(before)  # noqa: NPY002
        after = replace(
            state,
            generation=state.generation + 1,
            stream=RandomStream.of(generator),
            evaluations=ledger.evaluations,
            starts=state.starts[1:],
        )
        return after, Event("evolution", ledger.cost, ledger.full, f"run {after.generation}")


def finite_costs(ledger: Ledger, X: FloatArray) -> FloatArray:
    """Return costs, (n,), of points, (n, D), with a large number for infinity."""
    inside = np.clip(np.asarray(X, dtype=np.float64), 0.0, 1.0)
    costs: FloatArray = np.minimum(ledger.costs(inside, ledger.full), LARGE)
    return costs


def draw_seed(generator: Generator) -> int:
    """Return a seed for a library that keeps its own random numbers; never 0, which some take for none."""
    return 1 + int(generator.random() * (2**31 - 2))


def require(module: str) -> ModuleType:
    """Return a module of a package of the extra "compare".

    Raises
    ------
    IdentificationError
        The package is not installed, or does not load.
    """
    package = module.partition(".")[0]
    try:
        with redirect_stdout(StringIO()):
            return importlib.import_module(module)
    except ImportError:
        raise IdentificationError(f"optimizer: needs the package {package}; {install('compare')}") from None


def scipy_de() -> Library:
    """Return SciPy's differential evolution; the start takes the first place of the population."""

    def search(ledger: Ledger, start: FloatArray, generator: Generator) -> None:
        from scipy.optimize import differential_evolution

        def cost(x: FloatArray) -> Any:
            # (D, n) from the population, (D,) from the polishing
            values = finite_costs(ledger, np.atleast_2d(x.T))
            return values if x.ndim == 2 else values[0]

        population = latin_hypercube(MEMBERS, ledger.dimension, generator)
        population[0] = start
        evolve: Any = differential_evolution  # the stubs know no vectorized cost
        bounds = [(0.0, 1.0)] * ledger.dimension
        # convergence ends a run, not the number of generations
        settings: dict[str, Any] = {
            "maxiter": 10**7,
            "vectorized": True,
            "updating": "deferred",
            "seed": generator,
        }
        evolve(cost, bounds, init=population, **settings)

    return Library("scipy-de", search)


class _Diverged(Exception):  # noqa: N818 - not an error: this start leads nowhere
    """The start diverged."""


def scipy_least_squares() -> Library:
    """Return SciPy's least squares; nuisances start at zero, and a start that diverges is abandoned."""

    def search(ledger: Ledger, start: FloatArray, generator: Generator) -> None:
        from scipy.optimize import least_squares

        place, r = np.empty(0), np.empty(0)  # where residuals were simulated last

        def residuals(z: FloatArray) -> FloatArray:
            nonlocal place, r
            found: FloatArray = ledger.residuals(z[None, :], ledger.full)[0]
            if not r.size and not (np.abs(found) < HUGE).all():
                raise _Diverged
            place, r = z.copy(), found
            return found

        def jacobian(z: FloatArray) -> FloatArray:
            J = dense(ledger.jacobian(z, ledger.full, r if np.array_equal(z, place) else residuals(z))[0])
            if not (np.abs(J) < HUGE).all():
                raise _Diverged
            return J

        wide = np.full(ledger.extra, np.inf)
        bounds = np.append(np.zeros(ledger.dimension), -wide), np.append(np.ones(ledger.dimension), wide)
        # strictly inside the box, where SciPy starts
        z = np.append(np.clip(start, 1e-10, 1.0 - 1e-10), np.zeros(ledger.extra))
        settings: dict[str, Any] = {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-14, "max_nfev": 20}
        with suppress(_Diverged, np.linalg.LinAlgError):
            least_squares(residuals, z, jac=jacobian, bounds=bounds, **settings)

    return Library("scipy-least-squares", search)


def cma() -> Library:
    """Return CMA-ES with BIPOP restarts; the start is the first mean, later means lie anywhere.

    Raises
    ------
    IdentificationError
        The package is not installed.
    """
    require("cma")

    def search(ledger: Ledger, start: FloatArray, generator: Generator) -> None:
        if ledger.dimension < 2:
            raise IdentificationError(
                "optimizer cma: cannot search one variable alone; take another optimizer"
            )
        means = [start]

        def mean() -> FloatArray:
            return means.pop() if means else generator.random(ledger.dimension)

        def costs(points: list[FloatArray]) -> list[float]:
            values: list[float] = finite_costs(ledger, np.array(points)).tolist()
            return values

        options: dict[str, Any] = {"bounds": [0.0, 1.0], "seed": draw_seed(generator)}
        silent = {"verbose": -10, "verb_log": 0, "verb_disp": 0, "signals_filename": None}
        width = 0.3  # first standard deviation, of the box
        run = require("cma").fmin2
        run(None, mean, width, options | silent, parallel_objective=costs, restarts=RESTARTS, bipop=True)

    return Library("cma", search)
