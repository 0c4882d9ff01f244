"""Iterates of a running fit, for displays: the problem, the point, and the simulated readings there.

A context manager sets the observer of all estimators that run within it. Readings are simulated only when the observer
calls `Candidate.simulate`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize import Progress
from stoop.problem import Misfit


@dataclass(frozen=True, eq=False)
class Candidate:
    """The best point of a fit so far, with the current weights."""

    problem: Misfit
    #: (D + E,)
    z: FloatArray
    cost: float
    #: readings (n, n_y) of each piece of the problem
    simulate: Callable[[], Sequence[FloatArray]]

    @property
    def parameters(self) -> dict[str, float]:
        """Free parameters, SI."""
        return self.problem.layout.values(self.z)


_watcher: ContextVar[Callable[[Candidate], None] | None] = ContextVar("watcher", default=None)


@contextmanager
def watched(see: Callable[[Candidate], None]) -> Iterator[None]:
    """Call `see` with the iterates of fits within the block."""
    token = _watcher.set(see)
    try:
        yield
    finally:
        _watcher.reset(token)


def show(
    problem: Misfit, z: FloatArray, cost: float, simulate: Callable[[], Sequence[FloatArray]] | None = None
) -> None:
    """Pass a point to the observer, if there is one; entries behind the first D + E are left out."""
    see = _watcher.get()
    if see is None or not np.isfinite(cost):
        return
    z = z[: problem.dimension + problem.extra]
    own = simulate or (lambda: [problem.outputs(z, i) for i in range(len(problem.pieces))])
    see(Candidate(problem, z, float(cost), own))


def shown(problem: Misfit, callback: Callable[[Progress], None] | None) -> Callable[[Progress], None] | None:
    """Return the callback of a search that also shows the best point of each step."""
    if _watcher.get() is None:
        return callback

    def see(progress: Progress) -> None:
        show(problem, progress.state.evaluations.best, progress.cost)
        if callback is not None:
            callback(progress)

    return see
