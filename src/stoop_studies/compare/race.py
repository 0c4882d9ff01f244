"""One run of a comparison, as a campaign executes it, and what is kept of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.numbers import finite_or_none
from stoop.optimize.local_refinement import AGREE
from stoop.parallel import Json
from stoop_studies.search import posed_by, searched

LEVELS: Final = 10  #: costs on the way to the target at which runs are timed, the target among them
ROWS: Final = 10_000  #: of a history from which times are read


@dataclass(frozen=True)
class Race:
    """How one optimizer did on one problem with one seed."""

    problem: str
    optimizer: str
    seed: int
    hit: float | None  #: evaluations up to the target; None: never reached
    hits: tuple[float | None, ...]  #: evaluations up to each level, the highest cost first; the last is `hit`
    #: spent until the run ended: at the target, at the end of the budget, or when it claimed convergence
    evaluations: float
    cost: float  #: the least that was found; inf where nothing was
    status: str  #: "target", "budget", "converged" or "generations"
    #: target, reference: the cost that counts as solved, and the trivial model's
    target: float
    reference: float

    @property
    def spent(self) -> float:
        """Evaluations up to the target, or up to the run's end without it."""
        return self.evaluations if self.hit is None else self.hit

    @property
    def wrong(self) -> bool:
        """Whether it claimed convergence elsewhere, by more than two confirmations may differ."""
        return self.status == "converged" and self.hit is None and self.cost > self.target * (1.0 + AGREE)


def race(arguments: Mapping[str, Json], stops: Sequence[int | None]) -> list[Json]:
    """Run an optimizer on a problem to the target, its own end, or the end of the budget.

    Arguments and stops are those of `stoop_studies.search.search`; returned are the fields of `Race` that the run decides.
    """
    posed, kept = posed_by(arguments), list[Json]()
    for result in searched(posed, {**arguments, "to_target": True, "history": ROWS}, stops):
        history = np.array(result["history"], dtype=np.float64).reshape(-1, 2)
        reached = [history[history[:, 1] <= level, 0] for level in levels(posed.reference, posed.target)[:-1]]
        kept.append(
            {
                **{k: result[k] for k in ("hit", "evaluations", "cost", "status")},
                "hits": [*(float(times[0]) if times.size else None for times in reached), result["hit"]],
                "target": posed.target,
                "reference": finite_or_none(posed.reference),
            }
        )
    return kept


def levels(reference: float, target: float) -> FloatArray:
    """Return costs (LEVELS,) falling from below the trivial model's to the target, evenly in their logarithm."""
    high = reference if np.isfinite(reference) and reference > target else target
    rungs: FloatArray = np.geomspace(high, target, LEVELS + 1)[1:]
    return rungs


def read_race(problem: str, optimizer: str, seed: int, result: Mapping[str, Any]) -> Race:
    """Return what a stored result says."""
    finite = {n: np.inf if result[n] is None else float(result[n]) for n in ("cost", "reference")}
    return Race(problem, optimizer, seed, **{**result, **finite, "hits": tuple(result["hits"])})
