"""One search, as a campaign runs it: which optimizer, which problem, which seed; what came of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.parallel import Json
from stoop_studies.problems import Posed, pose
from stoop_studies.variants import build

HISTORY_ROWS: Final = 200
FOREVER: Final = 10**9  #: generations
_OWN: Final = ("optimizer", "problem", "seed", "budget", "to_target", "history")


def search(arguments: Mapping[str, Json], stops: Sequence[int | None]) -> list[Json]:
    """Run an optimizer on a problem, once, and return its state at each stop.

    Parameters
    ----------
    arguments : mapping
        ``optimizer``: a name, or a variant (`stoop_studies.variants`). ``problem``: a name. ``seed``: of both.
        ``budget``: evaluations, or None. ``to_target``: whether to end at the target. ``history``: at most so
        many rows are kept (default 200). The rest are the problem's own arguments.
    stops : sequence of int or None
        Generations; None is until budget, target or convergence.

    Returns
    -------
    list of dict, one per stop, in the same order
        ``cost`` and ``values`` of the best point (None before there is one); ``evaluations`` and
        ``generation`` so far; ``status``; ``hit``: evaluations up to the target, or None; ``history``: rows
        of evaluations and cost.

    Raises
    ------
    IdentificationError
        There is no such optimizer or problem.
    """
    return [dict(result) for result in searched(posed_by(arguments), arguments, stops)]


def posed_by(arguments: Mapping[str, Json]) -> Posed:
    """Return the problem that arguments name, as of `search`."""
    own = {k: v for k, v in arguments.items() if k not in _OWN}
    return pose(str(arguments["problem"]), int(_number(arguments["seed"])), **own)


def searched(
    posed: Posed, arguments: Mapping[str, Json], stops: Sequence[int | None]
) -> list[dict[str, Json]]:
    """Do what `search` does, on a problem that is posed already."""
    budget = None if arguments.get("budget") is None else _number(arguments["budget"])
    optimizer = build(str(arguments["optimizer"]), budget)
    target = posed.target if arguments.get("to_target") else -np.inf
    rows, seed = int(_number(arguments.get("history", HISTORY_ROWS))), int(_number(arguments["seed"]))
    generations = [FOREVER if s is None else s for s in stops]
    found: dict[int, dict[str, Json]] = {}
    state, ended = None, False
    for generation in sorted(set(generations)):  # a run that ended by itself stands for all later stops
        if not ended:
            stop = optimize.Stop(generation, np.inf if budget is None else budget, target)
            outcome = optimize.minimize(optimizer, posed.problem, seed=seed, stop=stop, state=state)
            state, ended = outcome.state, outcome.status != "generations"
        found[generation] = _record(outcome, posed, rows)
    return [found[generation] for generation in generations]


def _record(outcome: optimize.Outcome, posed: Posed, rows: int) -> dict[str, Json]:
    """Return an outcome as plain numbers."""
    finite = bool(np.isfinite(outcome.cost))
    values = posed.values(outcome.z[: posed.problem.dimension]).tolist() if finite else None
    reached = np.flatnonzero(outcome.history[:, 1] <= posed.target)
    return {
        "cost": outcome.cost if finite else None,
        "evaluations": outcome.trajectories,
        "generation": outcome.generation,
        "status": outcome.status,
        "values": values,
        "hit": float(outcome.history[reached[0], 0]) if reached.size else None,
        "history": thinned(outcome.history, rows).tolist(),
    }


def thinned(history: FloatArray, rows: int) -> FloatArray:
    """Return the rows (k, 2) of a history that improve by a share, and the last; at most so many.

    The share is 1 %, or as much more as it takes: rows are then about equally far apart in the logarithm.
    """
    if rows < 1 or not len(history):
        return history[:0]
    rows, share, last = max(rows, 2), 0.99, len(history) - 1
    while True:
        kept = [0]
        for i, cost in enumerate(history[:, 1].tolist()):
            if cost <= share * history[kept[-1], 1]:
                kept.append(i)
        kept = kept if kept[-1] == last else [*kept, last]
        if len(kept) <= rows:
            return history[kept]
        share **= 1.5


def _number(value: Json) -> float:
    """Return a number of a plan; anything else, a mistake of the plan, is a TypeError."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return value
