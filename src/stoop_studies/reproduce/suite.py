"""What the experiments on the paper share: their form, plans and tables, groups of runs, and how the paper is read."""

from __future__ import annotations

import shlex
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from stoop import optimize
from stoop.assessment.covariance import standard_errors
from stoop.base.arrays import FloatArray
from stoop.optimize.normal_equations import dense
from stoop.parallel import Plan, Run
from stoop.problem.evidence import invert_rows
from stoop_studies.findings import Findings, Results, Setting, number
from stoop_studies.outputs import Suite
from stoop_studies.problems import Posed

SEARCH: Final = "stoop_studies.search:search"
#: methods as shown -> registered
METHODS: Final = {"GA": "ga", "PSO": "pso", "PS-GDE": "ps-gde", "default": "ps-gde-lm"}
SUCCESS: Final = 1e-2  #: largest relative error of a successful identification
EXACT: Final = 1e-6  #: the same of an exact one


class PaperExperiment(ABC):
    """An experiment on the paper's problem."""

    name: str  #: as on the command line
    runs: int  #: seeds per case when none are asked for
    box: str = "N"  #: which bounds when none are asked for
    parts: tuple[str, ...] = ()  #: names of the further tables that it writes

    def plan(self, setting: Setting) -> Plan | None:
        """Return all runs, None without any; a store of another box is refused."""
        runs = self.searches(setting)
        return Plan(self.name, {"experiment": self.name, "box": setting.box}, tuple(runs)) if runs else None

    def searches(self, setting: Setting) -> list[Run]:
        """Return all runs; none where there is nothing that takes long."""
        return []

    @abstractmethod
    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what the runs, by key, show."""


def minus(text: str) -> str:
    """Return a number with a true minus sign."""
    return text.replace("-", "−")


def percent(share: float) -> str:
    """Return a share in percent, three digits."""
    return f"{number(100.0 * share)} %"


def rms(values: FloatArray) -> FloatArray:
    """Return the root mean square over the first axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _options(setting: Setting) -> str:
    data = "" if setting.data is None else f" --data {shlex.quote(str(setting.data))}"
    return f" --box {setting.box}{data}"


SUITE: Final = Suite(
    "reproduce",
    "The PS-GDE paper, run again",
    "Table 1 and Figure 3 of the paper, what it claims in passing, and what its experiment leaves out.",
    _options,
)


@dataclass(frozen=True, eq=False)
class Group:
    """The runs of one method up to one number of iterations."""

    method: str
    iterations: int | None  #: none: to its own end
    truth: FloatArray  #: (D,), of a real flight the best values known
    values: FloatArray  #: (n, D), best of each run
    #: (n,) each: fitness J, evaluations up to the target (inf where that was not reached), and evaluations spent
    costs: FloatArray
    hits: FloatArray
    evaluations: FloatArray

    @property
    def errors(self) -> FloatArray:
        """Relative errors (n, D)."""
        return np.asarray(np.abs(self.values / self.truth - 1.0))

    @property
    def mean_error(self) -> float:
        """Mean relative error over runs and parameters."""
        return float(self.errors.mean())

    @property
    def error_of_means(self) -> float:
        """Mean relative error of the mean values, as the paper's columns have it."""
        return float(np.abs(self.values.mean(axis=0) / self.truth - 1.0).mean())

    @property
    def spread(self) -> FloatArray:
        """Standard deviation (D,) of the values over runs."""
        return np.asarray(self.values.std(axis=0, ddof=min(1, len(self.values) - 1)))

    def within(self, limit: float) -> int:
        """Return how many runs have every value within a relative error."""
        return int((self.errors <= limit).all(axis=1).sum())

    @property
    def mean_of_successful(self) -> FloatArray:
        """Mean values (D,) of the successful runs; NaN where there is none."""
        successful = self.values[(self.errors <= SUCCESS).all(axis=1)]
        return successful.mean(axis=0) if len(successful) else np.full(len(self.truth), np.nan)

    @property
    def reached(self) -> int:
        """How many runs reached the target."""
        return int(np.isfinite(self.hits).sum())

    @property
    def median_cost(self) -> float:
        """Median fitness."""
        return float(np.median(self.costs))

    @property
    def median_hit(self) -> float:
        """Median evaluations of the runs that reached the target; NaN where there is none."""
        return float(np.median(self.hits[np.isfinite(self.hits)])) if self.reached else np.nan

    @property
    def hits_text(self) -> str:
        """The median and how many runs reached the target; a dash where none did."""
        return f"{self.median_hit:.0f} ({self.reached})" if self.reached else "–"


@dataclass(frozen=True)
class Searches:
    """Searches of several methods on a problem with the same seeds, up to each of their numbers of iterations."""

    key: str  #: name of a run, a format of ``who``, ``seed`` and ``stop``
    problem: str
    seeds: range
    stops: Mapping[str, Sequence[int | None]]  #: method as shown -> iterations, None to its own end
    arguments: Mapping[str, Any] = field(default_factory=dict)  #: of the problem

    def runs(self) -> list[Run]:
        """Return one run per method, seed and number of iterations."""
        common = {"problem": self.problem, "history": 0, **self.arguments}
        return [
            Run(self._key(m, s, n), SEARCH, {"optimizer": METHODS[m], "seed": s, **common}, n)
            for m, stops in self.stops.items()
            for s in self.seeds
            for n in stops
        ]

    def groups(
        self, results: Results, truth: FloatArray, order: Sequence[int] | None = None
    ) -> dict[str, list[Group]]:
        """Return by method its runs up to each number of iterations; ``order`` picks among the values."""

        def group(method: str, stop: int | None) -> Group:
            own = [results[self._key(method, s, stop)] for s in self.seeds]
            values = np.array([r["values"] for r in own], dtype=float)
            costs, spent = (np.array([r[n] for r in own], dtype=float) for n in ("cost", "evaluations"))
            hits = np.array([np.inf if r.get("hit") is None else r["hit"] for r in own], dtype=float)
            picked = values if order is None else values[:, list(order)]
            return Group(method, stop, truth, picked, costs, hits, spent)

        return {m: [group(m, n) for n in stops] for m, stops in self.stops.items()}

    def _key(self, method: str, seed: int, stop: int | None) -> str:
        return self.key.format(who=METHODS[method], seed=seed, stop=stop)


def bound_deviations(posed: Posed, values: FloatArray | None = None) -> FloatArray:
    """Return the standard deviations (D,) of the Cramer-Rao bound in physical units.

    Residuals are in units of the noise, so their Jacobian J has the information J'J; nuisances are part of it. The bound is
    taken at the values (D,), the problem's truth when absent.

    Raises
    ------
    ValueError
        Neither values nor truth are known: a mistake of the caller.
    """
    place = posed.truth if values is None else values
    if place is None:
        raise ValueError("the bound is taken at the truth, which this problem does not know")
    zero = posed.values(np.zeros(len(place)))
    width = posed.values(np.ones(len(place))) - zero
    return width * unit_deviations(posed.problem, np.clip((place - zero) / width, 0.0, 1.0))


def unit_deviations(problem: optimize.Problem, x: FloatArray) -> FloatArray:
    """Return the same (D,) at a point (D,) of the unit box, in its units."""
    z, full = np.concatenate([x, np.zeros(problem.extra)]), len(problem.prices) - 1
    J, _ = problem.jacobian(z, full, problem.residuals(z[None], full)[0])
    return standard_errors(invert_rows(dense(J)).matrix)[: problem.dimension]
