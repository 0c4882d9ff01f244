"""GA, PSO, PS-GDE and the default on a multirotor, simulated and real: the runs and what each group of them found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.parallel import Plan, Run
from stoop_studies.findings import Results, Setting
from stoop_studies.problems import Posed, pose
from stoop_studies.reproduce.bound import deviations, unit_deviations
from stoop_studies.reproduce.groups import Group
from stoop_studies.reproduce.plans import planned, searched
from stoop_studies.reproduce.table1 import EXACT, ITERATIONS, METHODS, SUCCESS

PROBLEM: Final = "multirotor"
STOPS: Final = {"clean": ITERATIONS, "noise": ITERATIONS[-1:], "real": (100, 200)}  #: iterations of each case
NOISY_BOX: Final = "S"  #: begins at zero: the bounds of box N would cut the scatter off


@dataclass(frozen=True, eq=False)
class Case:
    """One of the three problems.

    Attributes
    ----------
    name : str
        ``clean``, ``noise`` or ``real``.
    parameters : tuple of str
    values : (D,)
        The truth; of the real flight the best that is known.
    sigma : (D,)
        Standard deviation that noise must cause (Cramer-Rao); of the real flight the standard error.
    least : float
        Cost that is held against the others: of the real flight the least that any run found.
    groups : tuple of Group
    """

    name: str
    parameters: tuple[str, ...]
    values: FloatArray
    sigma: FloatArray
    least: float
    groups: tuple[Group, ...]

    def of(self, method: str) -> tuple[Group, ...]:
        """Return the groups of one method, by iterations."""
        return tuple(g for g in self.groups if g.method == method)

    def last(self, method: str) -> Group:
        """Return the group of one method with the most iterations."""
        return self.of(method)[-1]

    def errors(self, group: Group) -> FloatArray:
        """Return relative errors (n, D)."""
        return np.asarray(np.abs(group.values / self.values - 1.0))

    def within(self, group: Group, limit: float) -> int:
        """Return how many runs have every value within a relative error."""
        return int((self.errors(group) <= limit).all(axis=1).sum())

    def spread(self, group: Group) -> FloatArray:
        """Return the standard deviation (D,) of the values over seeds."""
        return np.asarray(group.values.std(axis=0, ddof=min(1, len(group.values) - 1)))

    def rms(self, group: Group) -> FloatArray:
        """Return the root mean square (D,) of the relative errors over seeds."""
        return np.asarray(np.sqrt(np.mean(self.errors(group) ** 2, axis=0)))


def plan(setting: Setting) -> Plan:
    """Return every case, method, seed and number of iterations."""
    runs = [
        _run(case, method, seed, stop, setting)
        for case in cases(setting)
        for method in METHODS
        for seed in seeds(case, setting)
        for stop in STOPS[case]
    ]
    return planned(PROBLEM, setting, runs)


def cases(setting: Setting) -> tuple[str, ...]:
    """Return what is run: the real flight only where its data is."""
    return ("clean", "noise") if setting.data is None else ("clean", "noise", "real")


def seeds(case: str, setting: Setting) -> range:
    """Return the seeds of a case: half as many on the real flight, whose trajectories cost fifty times as much."""
    return setting.seeds if case != "real" else setting.seeds[: (setting.runs + 1) // 2]


def _run(case: str, method: str, seed: int, stop: int, setting: Setting) -> Run:
    problem, more = _asked(case, setting)
    return searched(_key(case, method, seed, stop), METHODS[method], problem, seed, stop, **more)


def _asked(case: str, setting: Setting) -> tuple[str, dict[str, Any]]:
    """Return the name of the problem and its arguments."""
    if case == "real":
        return "hexacopter", {"data": str(setting.data)}
    return (PROBLEM, {"box": setting.box}) if case == "clean" else (f"{PROBLEM}+noise", {"box": NOISY_BOX})


def _key(case: str, method: str, seed: int, stop: int) -> str:
    return f"{case}/{METHODS[method]}/{seed:06d}/{stop:05d}"


def found(setting: Setting, results: Results) -> dict[str, Case]:
    """Return what the runs found, by case."""
    return {case: _case(case, setting, results) for case in cases(setting)}


def _case(case: str, setting: Setting, results: Results) -> Case:
    name, more = _asked(case, setting)
    posed = pose(name, setting.seed, **more)
    groups = tuple(
        Group.of(method, stop, [results[_key(case, method, s, stop)] for s in seeds(case, setting)])
        for method in METHODS
        for stop in STOPS[case]
    )
    if posed.truth is not None:
        return Case(case, posed.parameters, posed.truth, deviations(posed), 0.0, groups)
    best = min(groups, key=lambda g: float(g.costs.min()))
    values = best.values[int(np.argmin(best.costs))]
    return Case(case, posed.parameters, values, _errors(posed, values), float(best.costs.min()), groups)


def _errors(posed: Posed, values: FloatArray) -> FloatArray:
    """Return standard errors (D,) at a point given by its values."""
    zero = posed.values(np.zeros(len(values)))
    width = posed.values(np.ones(len(values))) - zero
    return width * unit_deviations(posed.problem, np.clip((values - zero) / width, 0.0, 1.0))


def counts(case: Case, group: Group) -> tuple[int, int]:
    """Return how many runs have every value within 1 %, and within 1e-6."""
    return case.within(group, SUCCESS), case.within(group, EXACT)
