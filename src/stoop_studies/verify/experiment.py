"""The scaffold of an experiment: works by case and seed in a plan, their results by case, and pieces of its page."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Final

from stoop.base.arrays import FloatArray
from stoop.base.variables import VARIABLES
from stoop.parallel import Json, Plan, Run
from stoop.report.sheet import Table
from stoop_studies.findings import Findings, Results, Setting

Samples = Mapping[str, Sequence[Mapping[str, Any]]]  #: case -> the results of its seeds
Work = Callable[[Mapping[str, Any], Sequence[int | None]], list[Any]]  #: see `stoop.parallel.Run`
TRUTH_TABLE: Final = "White, one standard deviation"


@dataclass(frozen=True)
class Verification:
    """An experiment of ``stoop verify``, a `stoop_studies.findings.Experiment`.

    Attributes
    ----------
    name : str
        As on the command line.
    show : callable
        From the setting and the results of each case to what they show.
    runs : int
        Seeds per case when none are asked for.
    work : str
        "module:function" of what is done for one case and seed; empty where nothing takes long.
    cases : tuple of str
    parts : tuple of str
        Names of the further tables that it writes.
    reads_data : bool
        Whether its work is given the folder of published data.
    """

    name: str
    show: Callable[[Setting, Samples], Findings]
    runs: int = 1
    work: str = ""
    cases: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    reads_data: bool = False

    def plan(self, setting: Setting) -> Plan | None:
        """Return one run per case and seed; None where there is nothing that takes long."""
        data = {"data": str(setting.data or "")} if self.reads_data else {}
        runs = [
            Run(run_key(case, seed), self.work, {"case": case, "seed": seed, **data})
            for seed in setting.seeds
            for case in self.cases
        ]
        return Plan(self.name, {"experiment": self.name}, tuple(runs)) if runs else None

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what the runs, by key, show."""
        samples = {c: [results[run_key(c, seed)] for seed in setting.seeds] for c in self.cases}
        return self.show(setting, samples)


def run_key(case: str, seed: int) -> str:
    """Return the name of a run."""
    return f"{case}/{seed:06d}"


def work(function: Callable[[str, int], dict[str, Json]]) -> Work:
    """Turn a function of case and seed into a work of the parallel room; nothing is shared between stops."""

    @functools.wraps(function)
    def run(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
        result = function(str(arguments["case"]), int(arguments["seed"]))
        return [result for _ in stops]

    return run


def noise_table(noise: Mapping[str, float]) -> Table:
    """Return the standard deviations of white noise by channel, each with its unit."""
    rows = tuple((c, f"{sigma:g} {VARIABLES[c].unit}") for c, sigma in noise.items())
    return Table(TRUTH_TABLE, ("channel", "noise"), rows)


def or_none(values: FloatArray) -> list[float | None]:
    """Return numbers for JSON: nothing for what is not finite."""
    return [float(v) if v - v == 0.0 else None for v in values]


def vehicle_text(name: str) -> str:
    """Return a vehicle file of the experiments."""
    return files(__package__).joinpath("vehicles", f"{name}.toml").read_text(encoding="utf-8")
