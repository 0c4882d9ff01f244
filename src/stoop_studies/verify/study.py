"""The harness of ``stoop verify``: a study is a table of cases, a function from case and seed to a record, and a report.

A study is a module of this package with

- ``CASES``: names of cases, with whatever the function needs of each;
- a function ``(case, seed) -> record`` under `work`: numbers, texts, lists and tables of these, nothing else;
- a function ``show(setting, samples) -> Findings``: from the records of each case to claims, tables and rows (`Findings.of`);
- ``EXPERIMENT = Verification(NAME, show, runs, work, cases)``,

and one line in `EXPERIMENTS`. Runs, workers, store, resumption, CSV files, page and index are those of the harness.
"""

from __future__ import annotations

import functools
import importlib
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import FloatArray
from stoop.base.numbers import finite_or_none
from stoop.errors import StoopError
from stoop.parallel import Json, Plan, Run
from stoop_studies.findings import Claim, Experiment, Findings, Results, Setting, holds
from stoop_studies.outputs import Suite

if TYPE_CHECKING:
    import pandas as pd

    from stoop.assessment.error_bars import ErrorBars
    from stoop.estimate.estimate import Estimate

#: name -> module with an ``EXPERIMENT``, one line of help; in the order in which ``all`` runs them
EXPERIMENTS: Final[Mapping[str, tuple[str, str]]] = {
    name: (f"stoop_studies.verify.{name}", line)
    for name, line in (
        ("coverage", "how often 95 % intervals hold the truth (400 flights each)"),
        ("misspecified", "intervals of models that lack terms, gusts or sensor defects of the truth (100 flights each)"),
        ("feedback", "bias and coverage under an autopilot in gusts, by the default method (24 flights each)"),
        ("unstable", "bias and coverage for aircraft that only an autopilot holds (24 flights each)"),
        ("extensions", "missing parts of a model are named: size and power of the tests (20 flights a defect)"),
        ("components", "what each component of the covariance is worth (48 cases, 6 flights each)"),
        ("defaults", "from a log to a model by the defaults alone (40 flights of 20 made-up vehicles)"),
        ("decisions", "what each decision of a fit is worth (150 vehicles, real flights); reads --data DIR"),
        ("verdict", "how often the verdict refuses good models and trusts bad ones (416 cases)"),
        ("delays", "delays of inputs and outputs, fractions of a sample (40 flights, twice)"),
        ("outside", "flights of other people's models by recorders of other people, by the defaults alone (8 flights each)"),
        ("capture", "pose and late commands in a room, from log to model by the defaults (20 vehicles each)"),
        ("fleet", "changes of fleets told, dated and explained, and how often none is one (20 fleets each)"),
        ("gains", "margins and proposed gains of autopilots beside those of known vehicles (200 vehicles)"),
        ("lines", "wrong lines of mappings are named, right ones not accused (60 flights each); reads --data DIR"),
        ("servos", "lags and delays that a vehicle file leaves out (30 flights each)"),
        ("nist", "certified regressions of NIST, from both starts; reads --data DIR"),
        ("export", "exported aircraft flown by JSBSim beside our own simulation"),
        ("frequency", "95 % bands of frequency responses, inputs apart and together (200 flights each)"),
        ("windows", "windows that are proposed: maneuvers found, errors foretold (10 flights each); reads --data DIR"),
        ("design", "a designed input against a 3-2-1-1, predicted and achieved (100 flights each)"),
        ("structure", "whether the true terms are found among candidates (200 aircraft)"),
        ("propagate", "intervals of trims, modes, limits and control hold the truth (60 flights and more)"),
        ("jsbsim", "stock aircraft of JSBSim identified from their outputs (10 flights each)"),
        ("multirotor", "JSBSim's F450 identified from its outputs (10 flights, by speeds and by commands)"),
        ("propellers", "cut propellers and added weights on real quadrotors; reads --data DIR"),
        ("handbook", "a priori derivatives beside those of published airplanes; reads --data DIR"),
    )
}  # fmt: skip
SUITE: Final = Suite(
    "verify",
    "Claims of stoop, measured",
    "What the documentation says of stoop's own accuracy, with the runs that bear it out.",
    lambda setting: "" if setting.data is None else f" --data {shlex.quote(str(setting.data))}",
)
#: case -> the records of its seeds
Samples = Mapping[str, Sequence[Mapping[str, Any]]]
#: see `stoop.parallel.Run`
Work = Callable[[Mapping[str, Any], Sequence[int | None]], list[Any]]


def load_experiment(name: str) -> Experiment:
    """Return an experiment.

    Raises
    ------
    StoopError
        A package that it needs is not installed.
    """
    try:
        experiment: Experiment = importlib.import_module(EXPERIMENTS[name][0]).EXPERIMENT
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing in ("", "stoop", "stoop_studies"):
            raise
        raise StoopError(
            f"{name}: needs the package {missing}, which is not installed; pip install {missing}"
        ) from None
    return experiment


@dataclass(frozen=True)
class Verification:
    """A study of ``stoop verify``, a `stoop_studies.findings.Experiment`; its name is that of its module.

    Attributes
    ----------
    name : str
    show : callable
        From the setting and the records of each case to the findings.
    runs : int
        Seeds of each case unless others are asked for.
    work : str
        Name of the module's function of a case and a seed; empty where nothing takes long.
    cases : tuple of str
    parts : tuple of str
        Names of further tables.
    reads_data : bool
        Whether the work is given the folder of published data.
    times : case -> how many times as many seeds it has as the others
    """

    name: str
    show: Callable[[Setting, Samples], Findings]
    runs: int = 1
    work: str = ""
    cases: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    reads_data: bool = False
    times: Mapping[str, int] = field(default_factory=dict)

    def seeds(self, case: str, setting: Setting) -> range:
        """Return the seeds of a case."""
        return range(setting.seed, setting.seed + setting.runs * self.times.get(case, 1))

    def plan(self, setting: Setting) -> Plan | None:
        """Return one run per case and seed; None where there is nothing that takes long."""
        data = {"data": str(setting.data or "")} if self.reads_data else {}
        work = f"{EXPERIMENTS[self.name][0]}:{self.work}"
        runs = [
            Run(run_key(case, seed), work, {"case": case, "seed": seed, **data})
            for seed in sorted({seed for case in self.cases for seed in self.seeds(case, setting)})
            for case in self.cases
            if seed in self.seeds(case, setting)
        ]
        return Plan(self.name, {"experiment": self.name}, tuple(runs)) if runs else None

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what the runs, by key, show."""
        samples = {c: [results[run_key(c, seed)] for seed in self.seeds(c, setting)] for c in self.cases}
        return self.show(setting, samples)


def run_key(case: str, seed: int) -> str:
    """Return the name of a run."""
    return f"{case}/{seed:06d}"


def work(function: Callable[..., dict[str, Json]]) -> Work:
    """Turn a function of ``case`` and ``seed`` (and ``data``) into a work of `stoop.parallel.Run`."""

    @functools.wraps(function)
    def run(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
        return [function(**arguments)] * len(stops)

    return run


def records_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table as records; what is not finite is None."""
    columns = [
        [finite_or_none(v) if isinstance(v, float) else v for v in table[name].tolist()] for name in table
    ]
    return [dict(zip(map(str, table), row, strict=True)) for row in zip(*columns, strict=True)]


def or_none(values: FloatArray) -> list[float | None]:
    """Return numbers for JSON: nothing for what is not finite."""
    return [finite_or_none(v) for v in values]


def errors_of(
    fit: Estimate, truth: Mapping[str, float], bars: ErrorBars, **more: FloatArray
) -> dict[str, Any]:
    """Return the record of an identification: errors and standard errors of numbers whose truth is known.

    A standard error is None where a bound holds the parameter; ``more`` are further standard errors, in the order of the fit.
    """
    order = {p.name: i for i, p in enumerate(fit.problem.layout.parameters)}
    own = [order[name] for name in truth]
    at_bound = bars.at_bound[own]
    return {
        "names": list(truth),
        "errors": [fit.estimates[name] - value for name, value in truth.items()],
        **{k: or_none(np.where(at_bound, np.nan, v[own])) for k, v in {"sigma": bars.std, **more}.items()},
        "status": fit.outcome.status,
    }


def unfinished(results: Sequence[Mapping[str, Any]]) -> int:
    """Return how many identifications did not end by themselves."""
    return sum(r["status"] not in ("converged", "target") for r in results)


def within(statement: str, span: tuple[float, float], share: float, figures: str) -> Claim:
    """Return whether a share lies in a range; both are shown in percent."""
    low, high = span
    words = f"{statement} {100 * low:.0f} to {100 * high:.0f} %"
    return holds(words, low <= share <= high, f"{100 * share:.1f} % {figures}")


def error_statistics(
    results: Sequence[Mapping[str, Any]], sigma: str = "sigma"
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the root-mean-square error (k,) of each parameter, the mean standard error, coverage, and bias.

    Coverage is the share of 95 % intervals that hold the truth; one that is not given (None) does not. Bias is the mean
    error in standard errors of a mean.
    """
    errors, std = (np.array([r[key] for r in results], dtype=np.float64) for key in ("errors", sigma))
    given = np.isfinite(std)
    counts, total = given.sum(axis=0), np.where(given, std, 0.0).sum(axis=0)
    mean = np.where(counts > 0, total / np.maximum(counts, 1), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        coverage = (np.abs(errors) <= NORMAL_95 * std).mean(axis=0)
        bias = errors.mean(axis=0) / (errors.std(axis=0) / np.sqrt(len(errors)))
    return np.sqrt(np.mean(errors**2, axis=0)), mean, coverage, bias


def data_text(name: str) -> str:
    """Return a file of the studies' vehicles."""
    return files(__package__).joinpath("vehicles", name).read_text(encoding="utf-8")


def vehicle_text(name: str) -> str:
    """Return a vehicle file of the studies."""
    return data_text(f"{name}.toml")


def published_files(
    study: str, folder: Path | None, name: str, pattern: str, lacks: str, advice: str
) -> list[Path]:
    """Return the files of a published data set: those in a folder or in its folder ``name``, whichever has more.

    Raises
    ------
    StoopError
        No file has a name that matches the pattern.
    """
    places = [] if folder is None else [folder, folder / name]
    found = [[path for path in sorted(p.glob("*")) if re.fullmatch(pattern, path.name)] for p in places]
    best = max(found, key=len, default=[])
    if not best:
        where = "no folder is named" if folder is None else f"{folder}: {lacks}"
        raise StoopError(f"{study}: {where}; {advice}")
    return best
