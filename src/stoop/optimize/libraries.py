"""Optimizers of other libraries behind the interface of this room.

One step is one run of the library to its own end; the next starts from fresh random numbers. Its evaluations count as any
other optimizer's, and budget, target or Ctrl-C end it in the middle.
"""

from __future__ import annotations

import importlib
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from functools import cache
from io import StringIO
from types import ModuleType
from typing import Final

import numpy as np
from threadpoolctl import ThreadpoolController, threadpool_limits

from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.optimize.ledger import Evaluations, Halt, Ledger
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State

LARGE: Final = 1e100  #: stands for an infinite cost, which other libraries cannot handle
SEEDS: Final = 2**31 - 1
PROCESS_LOCK: Final = (
    threading.RLock()
)  #: for changes that the whole process shares, as the number of BLAS threads


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit SciPy and NumPy to one thread: on tiny matrices more only wait, and round differently.

    One caller at a time: two threads that each restore the limit they found could leave the other's.
    """
    with PROCESS_LOCK, _blas_threads().limit(limits=1, user_api="blas"):
        yield


@cache
def _blas_threads() -> ThreadpoolController:
    """Return the handle of the BLAS libraries; finding them takes a millisecond, and they must be loaded."""
    importlib.import_module("scipy.optimize")
    return ThreadpoolController()


@dataclass(frozen=True, kw_only=True)
class LibraryState(State):
    """State between two runs of a library.

    Attributes
    ----------
    starts : (k, D), the user's own values from which no run has started yet
    """

    starts: FloatArray


Search = Callable[[Ledger, FloatArray, np.random.Generator], None]


@dataclass(frozen=True)
class Library:
    """A search of another library; it never claims convergence.

    Attributes
    ----------
    name : registered name
    search : one run: from ledger, first point (D,) and random numbers to the library's own end
    """

    name: str
    search: Search

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
        """Run the library once, from the next of the user's own values or from anywhere."""
        ledger = Ledger.at(problem, state.evaluations)
        generator = state.stream.generator()
        anywhere = generator.random(problem.dimension)
        start = state.starts[0] if len(state.starts) else anywhere
        with _contained():
            self.search(ledger, start.copy(), generator)
        after = replace(
            state,
            generation=state.generation + 1,
            stream=RandomStream.of(generator),
            evaluations=ledger.evaluations,
            starts=state.starts[1:],
        )
        return after, Event("evolution", ledger.cost, ledger.full, f"run {after.generation}")


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


def finite_costs(ledger: Ledger, X: FloatArray) -> FloatArray:
    """Return costs, (n,), of points, (n, D), with a large number for infinity."""
    inside = np.clip(np.asarray(X, dtype=np.float64), 0.0, 1.0)
    costs: FloatArray = np.minimum(ledger.costs(inside, ledger.full), LARGE)
    return costs


def draw_seed(generator: np.random.Generator) -> int:
    """Return a seed for a library that keeps its own random numbers; never 0, which some take for none."""
    return 1 + int(generator.random() * (SEEDS - 1))


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
        raise IdentificationError(
            f"optimizer: needs the package {package}; install it with: pip install 'stoop[compare]'"
        ) from None


@contextmanager
def _contained() -> Iterator[None]:
    """Contain a library's warnings and global seeds; one BLAS thread, so that it rounds alike; one run at a time."""
    with PROCESS_LOCK, warnings.catch_warnings(), threadpool_limits(1, user_api="blas"):
        warnings.simplefilter("ignore")
        before = np.random.get_state()  # noqa: NPY002 - theirs, and restored as it was
        try:
            yield
        finally:
            np.random.set_state(before)  # noqa: NPY002
