"""Ordered SHADE beside L-SHADE, jSO and BIPOP-CMA-ES on the noiseless BBOB functions in ten variables.

24 functions, instances 1 to 5 (ordered SHADE's constants were chosen on 6 to 15), 50,000 evaluations, target 1e-8
above the optimum; the seed is the instance. L-SHADE and jSO are told the budget, as they must be. Whether ordered
SHADE solves significantly fewer instances than L-SHADE is asked twice, each time one-sided and exactly: by
McNemar's test of the 120 pairs, and by turning the signs of the 24 functions' differences, because instances of one
function are alike. Expected running time (ERT) is all evaluations of a function over the instances solved.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import comb
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from benchmarks.table import Row
from stoop import optimize
from stoop.base.arrays import BoolArray, FloatArray
from stoop_studies.problems.bbob import FUNCTIONS, pose

PART = "bbob"
OWN = "ordered-shade"
RIVAL = "l-shade"
NAMES = (OWN, RIVAL, "jso", "cma")
INSTANCES = range(1, 6)
BUDGET = 50_000.0
LEVEL = 0.05  #: of the tests


@dataclass(frozen=True)
class Runs:
    """One optimizer on every instance.

    Attributes
    ----------
    spent : (24, instances), evaluations, to the target or to the end of the budget
    solved : (24, instances)
    """

    spent: FloatArray
    solved: BoolArray

    @property
    def ert(self) -> FloatArray:
        """Expected running time of each function, (24,); inf where no instance was solved."""
        with np.errstate(divide="ignore"):
            ratio: FloatArray = self.spent.sum(axis=1) / self.solved.sum(axis=1)
        return ratio


def run() -> list[Row]:
    """Search every instance with every optimizer."""
    runs = {name: campaign(name) for name in NAMES}
    total = runs[OWN].solved.size
    rows = [
        Row(PART, f"{name}: solved", float(r.solved.sum()), note=f"of {total}; {_never(r)}")
        for name, r in runs.items()
    ]
    return rows + _tests(runs[OWN], runs[RIVAL]) + [_ahead(runs[OWN], runs[n], n) for n in NAMES[1:]]


def campaign(name: str, instances: range = INSTANCES) -> Runs:
    """Run one optimizer on all functions, as many at a time as there are processors."""
    jobs = [(name, k, i) for k in range(1, FUNCTIONS + 1) for i in instances]
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        results = list(pool.map(_search, jobs))
    table = np.array(results).reshape(FUNCTIONS, len(instances), 2)
    return Runs(table[:, :, 0], table[:, :, 1] == 1.0)


def _search(job: tuple[str, int, int]) -> tuple[float, bool]:
    """Return evaluations, and whether the target was reached."""
    name, function, instance = job
    posed = pose(f"bbob-{function:02d}", instance)
    stop = optimize.Stop(generations=10**9, budget=BUDGET, target_cost=posed.target)
    outcome = optimize.minimize(optimize.create(name, BUDGET), posed.problem, seed=instance, stop=stop)
    return outcome.trajectories, outcome.status == "target"


def _never(runs: Runs) -> str:
    """Say which functions were not solved on every instance."""
    missing = (~runs.solved).sum(axis=1)
    words = [f"f{k + 1} {m}" for k, m in enumerate(missing) if m]
    return "unsolved: " + ", ".join(words) if words else "all"


def _tests(own: Runs, rival: Runs) -> list[Row]:
    gained, lost = int((own.solved & ~rival.solved).sum()), int((rival.solved & ~own.solved).sum())
    note = f"only {OWN}: {gained}, only {RIVAL}: {lost}"
    differences = own.solved.sum(axis=1) - rival.solved.sum(axis=1)
    return [
        Row(
            PART,
            f"{OWN} solves fewer than {RIVAL}: p, McNemar",
            mcnemar(gained, lost),
            at_least=LEVEL,
            note=note,
        ),
        Row(
            PART,
            f"{OWN} solves fewer than {RIVAL}: p, by function",
            sign_flips(differences),
            at_least=LEVEL,
            note=f"{int((differences > 0).sum())} functions better, {int((differences < 0).sum())} worse",
        ),
    ]


def mcnemar(gained: int, lost: int) -> float:
    """Return the chance of gaining no more than `gained` of the discordant pairs if both were equally likely."""
    n = gained + lost
    return sum(comb(n, k) for k in range(gained + 1)) / 2.0**n


def sign_flips(differences: NDArray[np.integer]) -> float:
    """Return the chance of a sum no larger than that of the differences if each sign were a toss."""
    sizes = np.abs(differences)
    chances = np.ones(1)  # of every sum from -sum(sizes) to sum(sizes), in steps of one
    for size in sizes.tolist():
        toss = np.zeros(2 * size + 1)
        toss[0] += 0.5
        toss[-1] += 0.5
        chances = np.convolve(chances, toss)
    return float(chances[: int(differences.sum() + sizes.sum()) + 1].sum())


def _ahead(own: Runs, rival: Runs, name: str) -> Row:
    """Compare expected running times on the functions that both solve at least once."""
    both = np.isfinite(own.ert) & np.isfinite(rival.ert)
    ratios = rival.ert[both] / own.ert[both]
    behind = ", ".join(
        f"f{k + 1} {1.0 / r:.2g}x" for k, r in zip(np.flatnonzero(both), ratios, strict=True) if r < 1.0
    )
    return Row(
        PART,
        f"ERT of {name} over that of {OWN}",
        float(np.exp(np.log(ratios).mean())),
        at_least=1.0 if name == RIVAL else None,
        note=f"geometric mean of {int(both.sum())} functions both solve; slower on: {behind or 'none'}",
    )
