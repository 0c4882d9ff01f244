"""The paper's longitudinal problem with the search that ships, and with the paper's own optimizers.

Ten coefficients of Table 1, six channels, 1500 samples at 50 Hz, the elevator of Fig. 3; cost in trajectories
of the whole record (a third of it counts a third). The boxes are those of the prototype's ``problem.py``: the
truth lies somewhere in each, never on purpose in its middle. No starting values, priors or equation-error
estimate; the first measurement is the trivial model whose cost is J0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.table import Row
from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop_studies.problems.paper import NEAR, Paper, box, optimum, paper

__all__ = ["Paper", "box", "run"]


PART = "paper"
SEEDS = 100
SEEDS_OF_POPULATIONS = 20
ASKED = {"N": 15.0, "W": 20.0}  #: mean trajectories to the target
PROTOTYPE = {
    ("ps-gde", "N"): 5752, ("ps-gde", "W"): 9538, ("de-best-2-bin", "N"): 5320, ("de-best-2-bin", "W"): 9242,
}  # fmt: skip
WRONG = 1e-3  #: an end above the optimum by more than this share is another optimum
BUDGET = 3000.0


@dataclass(frozen=True)
class Tally:
    """What many seeds took, and how many ended elsewhere."""

    trajectories: FloatArray
    missed: int

    @property
    def words(self) -> str:
        """Median, largest, and how many seeds."""
        t = self.trajectories
        return f"median {np.median(t):.1f}, largest {t.max():.1f}, {len(t)} seeds"


def run() -> list[Row]:
    """Search every box."""
    case = paper()
    rows = [row for kind in ("N", "W", "S") for row in _noise_free(case, kind)]
    rows += [row for kind in ("N", "W") for row in _noisy(case, kind)]
    return rows + [_population(case, name, kind) for name, kind in PROTOTYPE]


def _noise_free(case: Paper, kind: str) -> Iterator[Row]:
    """Search to J <= 1e-6 J0, and once more until the search itself says that it is done."""
    asked = ASKED.get(kind)
    never = None if asked is None else 0.0
    tally = _search(case, kind, to_target=True)
    yield Row(
        PART, f"box {kind}: mean trajectories to 1e-6 J0", _mean(tally), at_most=asked, note=tally.words
    )
    yield Row(PART, f"box {kind}: did not get there", tally.missed, at_most=never)
    tally = _search(case, kind, to_target=False)
    yield Row(PART, f"box {kind}: mean trajectories until confirmed", _mean(tally), note=tally.words)
    yield Row(PART, f"box {kind}: ended in a wrong optimum", tally.missed, at_most=never)


def _noisy(case: Paper, kind: str) -> Iterator[Row]:
    """Search to the maximum-likelihood cost, and until the search itself says that it is done."""
    to = f"box {kind}, 1-sigma noise"
    tally = _search(case, kind, to_target=True, noise=True)
    yield Row(PART, f"{to}: mean trajectories to the ML cost", _mean(tally), note=tally.words)
    yield Row(PART, f"{to}: did not get there", tally.missed)
    tally = _search(case, kind, to_target=False, noise=True)
    yield Row(PART, f"{to}: mean trajectories until confirmed", _mean(tally), note=tally.words)
    yield Row(PART, f"{to}: ended in a wrong optimum", tally.missed, at_most=0.0)


def _mean(tally: Tally) -> float:
    return float(tally.trajectories.mean())


def _search(case: Paper, kind: str, *, to_target: bool, noise: bool = False) -> Tally:
    """Run the default search on every seed of a box, to the target or to its own end."""
    spent, missed = [], 0
    for seed in range(SEEDS):
        problem = case.problem(kind, seed, noise)
        least = optimum(problem, case.vehicle) if noise else 0.0
        slack = NEAR * (least if noise else problem.reference(len(problem.prices) - 1))
        near = least + slack if to_target or not noise else least * (1.0 + WRONG)
        stop = optimize.Stop(budget=BUDGET, target_cost=near if to_target else -np.inf)
        outcome = optimize.minimize(optimize.create(), problem, seed=seed, stop=stop)
        spent.append(outcome.trajectories)
        missed += not outcome.cost <= near
    return Tally(np.array(spent), missed)


def _population(case: Paper, name: str, kind: str) -> Row:
    """Run an optimizer without local search on a box to J <= 1e-6 J0."""
    spent = []
    for seed in range(SEEDS_OF_POPULATIONS):
        problem = case.problem(kind, seed, noise=False)
        target = NEAR * problem.reference(len(problem.prices) - 1)
        stop = optimize.Stop(generations=10**6, budget=60_000.0, target_cost=target)
        outcome = optimize.minimize(optimize.create(name), problem, seed=seed, stop=stop)
        spent.append(outcome.trajectories if outcome.status == "target" else np.inf)
    note = f"{SEEDS_OF_POPULATIONS} seeds, to 1e-6 J0; the prototype took {PROTOTYPE[name, kind]}"
    return Row(PART, f"{name}, box {kind}: median trajectories", float(np.median(spent)), note=note)
