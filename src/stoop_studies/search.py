"""One search, as a campaign runs it: which optimizer, which problem, which seed; what came of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.parallel import Json
from stoop_studies.problems import Posed, pose
from stoop_studies.variants import Variant, build

HISTORY_ROWS: Final = 200
FOREVER: Final = 10**9  #: generations
_OWN: Final = ("optimizer", "problem", "seed", "budget", "to_target", "history")


def search(arguments: Mapping[str, Json], stops: Sequence[int | None]) -> list[Json]:
    """Run an optimizer on a problem, once, and tell how it stood at each stop.

    Parameters
    ----------
    arguments : mapping
        ``optimizer``: a name, or a table (`stoop_studies.variants`). ``problem``: a name. ``seed``: of both.
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
    return [dict(told) for told in searched(posed_by(arguments), arguments, stops)]


def posed_by(arguments: Mapping[str, Json]) -> Posed:
    """Return the problem that arguments name, as of `search`."""
    own = {k: v for k, v in arguments.items() if k not in _OWN}
    return pose(str(arguments["problem"]), _seed(arguments), **own)


def searched(
    posed: Posed, arguments: Mapping[str, Json], stops: Sequence[int | None]
) -> list[dict[str, Json]]:
    """Do what `search` does, on a problem that is posed already."""
    budget = arguments.get("budget")
    optimizer = build(_variant(arguments["optimizer"]), None if budget is None else _number(budget))
    limits = optimize.Stop(
        budget=np.inf if budget is None else _number(budget),
        target_cost=posed.target if arguments.get("to_target") else -np.inf,
    )
    rows = int(_number(arguments.get("history", HISTORY_ROWS)))
    generations = [FOREVER if s is None else s for s in stops]
    found = _run(optimizer, posed.problem, _seed(arguments), limits, sorted(set(generations)))
    return [_told(found[g], posed, rows) for g in generations]


def _run(
    optimizer: Any, problem: optimize.Problem, seed: int, limits: optimize.Stop, stops: Sequence[int]
) -> dict[int, optimize.Outcome]:
    """Go from stop to stop; one that ended for good stands for all later ones."""
    found: dict[int, optimize.Outcome] = {}
    state, ended = None, False
    for stop in stops:
        if not ended:
            until = optimize.Stop(stop, limits.budget, limits.target_cost)
            outcome = optimize.minimize(optimizer, problem, seed=seed, stop=until, state=state)
            state, ended = outcome.state, outcome.status != "generations"
        found[stop] = outcome
    return found


def _told(outcome: optimize.Outcome, posed: Posed, rows: int) -> dict[str, Json]:
    """Return an outcome as plain numbers."""
    finite = bool(np.isfinite(outcome.cost))
    values = posed.values(outcome.z[: posed.problem.dimension]).tolist() if finite else None
    return {
        "cost": outcome.cost if finite else None,
        "evaluations": outcome.trajectories,
        "generation": outcome.generation,
        "status": outcome.status,
        "values": values,
        "hit": _hit(outcome.history, posed.target),
        "history": thinned(outcome.history, rows).tolist(),
    }


def _hit(history: FloatArray, target: float) -> float | None:
    """Return the evaluations up to the first cost at the target or below."""
    reached = np.flatnonzero(history[:, 1] <= target)
    return float(history[reached[0], 0]) if reached.size else None


def thinned(history: FloatArray, rows: int) -> FloatArray:
    """Return the rows (k, 2) of a history that improve by a share, and the last; at most so many.

    The share is 1 %, or as much more as it takes: rows are then about equally far apart in the logarithm.
    """
    if rows < 1 or not len(history):
        return history[:0]
    rows, share = max(rows, 2), 0.99
    while len(kept := _improving(history[:, 1], share)) > rows:
        share **= 1.5
    return history[kept]


def _improving(costs: FloatArray, share: float) -> list[int]:
    """Return where falling costs (k,) are below a share of the last that was kept; first and last always."""
    kept = [0]
    for i, cost in enumerate(costs.tolist()):
        if cost <= share * costs[kept[-1]]:
            kept.append(i)
    return kept if kept[-1] == len(costs) - 1 else [*kept, len(costs) - 1]


def _seed(arguments: Mapping[str, Json]) -> int:
    return int(_number(arguments["seed"]))


def _number(value: Json) -> float:
    """Return a number of a plan.

    Raises
    ------
    TypeError
        Anything else: a mistake of the plan.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return value


def _variant(value: Json) -> Variant:
    return value if isinstance(value, dict) else str(value)
