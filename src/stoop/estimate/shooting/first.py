"""Search from afar: when no start is near enough to step from, an optimizer looks at windows as they were measured.

Each window begins in its measured state and is a piece of its own, so that even a wrong candidate flies all of them to
their end. What the best candidate leaves is for multiple shooting itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.estimate.fit import SEARCH_SHARE, Options
from stoop.estimate.shooting.windows import Shots, measured_starts
from stoop.problem import Layout, Misfit, Piece

POOR: Final = 0.7  #: of the cost of a model that says nothing: a start that is no better is none


def windowed(problem: Misfit, shots: Sequence[Shots]) -> Misfit:
    """Return the least-squares problem in which every window is a piece that begins as measured.

    Its unknowns are the free numbers and the biases; initial states are not among them.
    """
    biases = [n for n in problem.layout.nuisances if n.is_bias]
    layout = Layout(problem.layout.vehicle, problem.layout.parameters, tuple(biases))
    pieces = [piece for one in shots for piece in _pieces(one)]
    whole = tuple(len(p.time) for p in pieces)
    return Misfit(layout, tuple(pieces), problem.weights, (whole,))


def _pieces(shots: Shots) -> list[Piece]:
    starts, piece = measured_starts(shots), shots.piece
    return [
        piece.part(a, b, {name: float(values[w]) for name, values in starts.items()})
        for w, (a, b) in enumerate(zip(shots.edges, shots.edges[1:], strict=False))
    ]


def is_poor(problem: Misfit, starts: FloatArray) -> bool:
    """Tell whether no start (k, D) explains more than the first reading of each window does."""
    return not float(np.min(problem.costs(starts, 0))) < POOR * problem.reference(0)


def searched(
    problem: Misfit,
    starts: FloatArray,
    options: Options,
    callback: Callable[[Any], None] | None = None,
    state: Any = None,
) -> optimize.Outcome:
    """Search the windowed problem with the optimizer that was asked for."""
    stop = replace(options.stop, budget=max(SEARCH_SHARE * options.budget, float(len(starts))))
    maker = optimize.create(options.optimizer, stop.budget)
    return optimize.minimize(
        maker, problem, seed=options.seed, starts=starts, stop=stop, callback=callback, state=state
    )
