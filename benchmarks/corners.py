"""The default search where the truth is far from most of the box: in a corner of it, or among 32 parameters.

- The paper's ten longitudinal coefficients in boxes 8 and 30 times as wide as each value: every value lies a twentieth of the
  box from one of its bounds, which one is drawn with the seed.
- All 32 coefficients of eq. (1) in six degrees of freedom, twelve channels, 30 s at 100 Hz, each anywhere in a box eight
  times as wide (box W of the paper's problems).

No noise, starting values, priors or equation-error estimate; cost in trajectories of the whole record. A run ends when the
search itself says that its optimum is confirmed; one that has not ended after 10 000 trajectories counts with these. An end
above one millionth of the trivial model's cost is a wrong optimum. ``STOOP_CORNERS=development`` takes the seeds on which the
search was developed; the others were used for nothing but the published figures.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from benchmarks.case import MANEUVER
from benchmarks.table import Row
from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.problem import Misfit
from stoop.simulation.fly import fly
from stoop_studies.problems.paper import NEAR, Paper, aircraft, box, paper

PART = "corners"
SEEDS: Final = range(1000, 1100)
DEVELOPMENT: Final = range(100)
MARGIN: Final = 0.05  #: of the box, from the truth to the nearer bound
BUDGET: Final = 10_000.0

#: by case: how a seed is posed, and the most trajectories asked for, half of what the search took before
CASES: Final[dict[str, tuple[Callable[[int], Misfit], float]]] = {
    "corner of a box 8 times as wide": (lambda seed: in_corner(8.0, seed), 0.5 * 471.0),
    "corner of a box 30 times as wide": (lambda seed: in_corner(30.0, seed), 0.5 * 2372.0),
    "32 parameters in a box 8 times as wide": (lambda seed: of_eq_1(seed), 0.5 * 5148.0),
}


def run() -> list[Row]:
    """Search every case on every seed."""
    development = os.environ.get("STOOP_CORNERS") == "development"
    seeds = DEVELOPMENT if development else SEEDS
    return [row for name, (pose, most) in CASES.items() for row in _rows(name, pose, most, seeds)]


def in_corner(width: float, seed: int) -> Misfit:
    """Pose the paper's ten coefficients in a box `width` times as wide as each value, the truth in a corner of it."""
    case = paper()
    return case.misfit(case.bounded(*corner(width, seed, case.truth)), case.measured(seed, noise=False))


def corner(width: float, seed: int, truth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return bounds, (D,) each, in a corner of which the truth lies; the seed draws the corner."""
    upper = np.random.default_rng(20_000 + seed).random(len(truth)) < 0.5
    size = width * np.abs(truth)
    low = truth - np.where(upper, 1.0 - MARGIN, MARGIN) * size
    return low, low + size


def of_eq_1(seed: int) -> Misfit:
    """Pose all 32 coefficients in box W."""
    case = _six_degrees_of_freedom()
    return case.misfit(case.bounded(*box("W", seed, case.truth)), case.flown.outputs)


@functools.cache
def _six_degrees_of_freedom() -> Paper:
    vehicle = aircraft()
    free = (p.name for p in vehicle.parameters if p.free and not p.name.startswith("sensors."))
    return Paper(vehicle, fly(vehicle, MANEUVER), tuple(free))


def _rows(name: str, pose: Callable[[int], Misfit], most: float, seeds: range) -> Iterator[Row]:
    """Search one case until each run ends itself."""
    spent, ended, wrong = [], 0, 0
    for seed in seeds:
        problem = pose(seed)
        stop = optimize.Stop(generations=10**9, budget=BUDGET)
        outcome = optimize.minimize(optimize.create(), problem, seed=seed, stop=stop)
        spent.append(outcome.trajectories)
        confirmed = outcome.status == "converged"
        ended += confirmed
        wrong += confirmed and outcome.cost > NEAR * problem.reference(len(problem.prices) - 1)
    note = f"median {np.median(spent):.1f}, largest {max(spent):.0f}, seeds {seeds[0]} to {seeds[-1]}"
    yield Row(PART, f"{name}: mean trajectories until confirmed", float(np.mean(spent)), "", most, note=note)
    yield Row(PART, f"{name}: 90 % point", float(np.quantile(spent, 0.9)))
    yield Row(PART, f"{name}: ended", 100.0 * ended / len(seeds), "%", at_least=100.0)
    yield Row(PART, f"{name}: ended in a wrong optimum", wrong, at_most=0.0)
