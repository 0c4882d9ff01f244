"""Table 1: GA, PSO and PS-GDE at four budgets, many runs each, beside the printed numbers and the default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.parallel import Plan
from stoop_studies.findings import Results, Setting
from stoop_studies.problems.experiment import TABLE_1
from stoop_studies.problems.paper import paper
from stoop_studies.reproduce import groups
from stoop_studies.reproduce.plans import planned, searched
from stoop_studies.reproduce.printed import MISPRINT, PRINTED

METHODS: Final = {
    "GA": "ga",
    "PSO": "pso",
    "PS-GDE": "ps-gde",
    "default": "ps-gde-lm",
}  #: as shown -> registered
ITERATIONS: Final = (500, 1000, 1500, 2000)
SUCCESS: Final = 1e-2  #: largest relative error of the ten
EXACT: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Group(groups.Group):
    """The runs of one method up to one number of iterations: ten values each, in the order of `TABLE_1`."""

    @property
    def errors(self) -> FloatArray:
        """Relative error (n, 10)."""
        return np.asarray(np.abs(self.values / truth() - 1.0))

    @property
    def mean_error(self) -> float:
        """Over runs and parameters."""
        return float(self.errors.mean())

    @property
    def error_of_means(self) -> FloatArray:
        """Relative error (10,) of the mean identified value, as the paper's columns have it."""
        return np.asarray(np.abs(self.values.mean(axis=0) / truth() - 1.0))

    @property
    def successful(self) -> int:
        """How many runs have all ten within 1 %."""
        return self.within(SUCCESS)

    def within(self, limit: float) -> int:
        """Return how many runs have all ten within a relative error."""
        return int((self.errors <= limit).all(axis=1).sum())

    @property
    def mean(self) -> FloatArray:
        """Mean identified value (10,) of all runs."""
        return np.asarray(self.values.mean(axis=0))

    @property
    def mean_of_successful(self) -> FloatArray:
        """The same of the successful runs; NaN where there is none."""
        chosen = self.values[(self.errors <= SUCCESS).all(axis=1)]
        return chosen.mean(axis=0) if len(chosen) else np.full(len(TABLE_1), np.nan)


def truth() -> FloatArray:
    """Return the true values (10,), in the order of `TABLE_1`."""
    return paper().truth


def plan(setting: Setting) -> Plan:
    """Return every method, seed and number of iterations."""
    runs = [
        searched(key(method, seed, stop), METHODS[method], f"paper-{setting.box}", seed, stop)
        for method in METHODS
        for seed in setting.seeds
        for stop in ITERATIONS
    ]
    return planned("table1", setting, runs)


def key(method: str, seed: int, stop: int) -> str:
    """Return the name of one run."""
    return f"{METHODS[method]}/{seed:06d}/{stop:05d}"


def grouped(setting: Setting, results: Results) -> list[Group]:
    """Return the runs by method and iterations."""
    order = columns()
    return [
        Group.of(method, stop, [results[key(method, seed, stop)] for seed in setting.seeds], order)
        for method in METHODS
        for stop in ITERATIONS
    ]


def columns() -> list[int]:
    """Return where each name of `TABLE_1` stands among the problem's parameters."""
    case = paper()
    names = [p.name for p in case.vehicle.parameters if p.name in TABLE_1]
    return [names.index(n) for n in TABLE_1]


def printed_costs() -> dict[str, FloatArray]:
    """Return what each printed column costs with the Q used here, channel by channel (6,).

    "PSO, mended" has the misprint corrected.
    """
    found = {name: np.array(values) for name, values in PRINTED.items()}
    found["PSO, mended"] = found["PSO"].copy()
    found["PSO, mended"][TABLE_1.index(MISPRINT[0])] = MISPRINT[1]
    return {name: paper().cost(values) for name, values in found.items()}
