"""Sweep: what NC, pr, F and CR do, one at a time about the paper's values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.numbers import finite_or_none
from stoop.parallel import Plan
from stoop.report.plots import Series, plot
from stoop.report.sheet import Figure, Prose, Section
from stoop_studies.findings import Claim, Findings, Results, Setting, counted, holds, reproduces
from stoop_studies.reproduce.races import BUDGET, PAPER, Race, races, runs
from stoop_studies.reproduce.suite import PaperExperiment, planned, tabulated


@dataclass(frozen=True)
class Knob:
    """A parameter of PS-GDE.

    Attributes
    ----------
    name : str
        As in the paper.
    key : str
        As in a variant.
    chosen : float
        The paper's value, or the one read into it.
    values : tuple of float
    """

    name: str
    key: str
    chosen: float
    values: tuple[float, ...]


KNOBS: Final = (
    Knob("NC", "period", 20, (2, 5, 10, 20, 40, 80)),
    Knob("pr", "share", 0.05, (0.02, 0.05, 0.1, 0.2, 0.4)),
    Knob("F", "scale", 0.6, (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)),
    Knob("CR", "rate", 0.9, (0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)),
)
MATTERS: Final = 1.5  #: times the expected running time of the best value
LEAD: Final = """\
The paper closes its description by saying that NC and pr influence the result, without showing it, and prints \
neither F nor CR. Here each of the four is varied while the others stay at NC = 20, pr = 0.05, F = 0.6, CR = 0.9. \
Runs end at 1e-6 of the trivial model's cost J0, or at 60,000 evaluations."""
WORDS: Final = """\
Expected running time is all evaluations, those of lost runs included, over the number of runs that got there: it \
weighs speed against reliability. Where a curve breaks off, no run got there."""
HEAD: Final = ("parameter", "value", "runs", "reached", "median_evaluations", "expected_running_time")


class Sweep(PaperExperiment):
    """What the parameters of PS-GDE do."""

    name, runs = "sweep", 20

    def plan(self, setting: Setting) -> Plan:
        """Return all runs."""
        return planned(self.name, setting, runs(variants(), setting))

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        found = races(variants(), setting, results)
        by_knob = {k: {v: found[_label(k, v)] for v in k.values} for k in KNOBS}
        return Findings(
            f"Sweep: NC, pr, F and CR of PS-GDE, box {setting.box}",
            LEAD,
            (*(_influence(k, own) for k, own in by_knob.items()), _stagnates(found)),
            tuple(_section(k, own) for k, own in by_knob.items()),
            HEAD,
            tuple(
                (
                    k.name,
                    float(v),
                    len(r.hits),
                    r.solved,
                    finite_or_none(r.median),
                    finite_or_none(r.expected),
                )
                for k, own in by_knob.items()
                for v, r in own.items()
            ),
        )


def variants() -> dict[str, Any]:
    """Return every variant by its label; the paper's own values are one and the same variant."""
    return {_label(k, v): PAPER if v == k.chosen else PAPER | {k.key: v} for k in KNOBS for v in k.values}


def _label(knob: Knob, value: float) -> str:
    return f"{knob.name} = {value:g}"


def _influence(knob: Knob, races: Mapping[float, Race]) -> Claim:
    times = {v: race.expected for v, race in races.items()}
    best, worst = min(times, key=lambda v: times[v]), max(times.values())
    verdict = reproduces if knob.name in ("NC", "pr") else holds
    return verdict(
        f"{knob.name} matters: from {knob.values[0]:g} to {knob.values[-1]:g} the running time changes {MATTERS:g}-fold",
        worst > MATTERS * times[best],
        f"expected running time {_count(times[best])} at {best:g}, {_count(times[knob.chosen])} at {knob.chosen:g}, "
        f"up to {_count(worst)}",
    )


def _stagnates(found: Mapping[str, Race]) -> Claim:
    half, chosen = found["F = 0.5"], found["F = 0.6"]
    return holds(
        "With F = 0.5 some runs stagnate, with 0.6 none",
        half.solved < len(half.hits) and chosen.solved == len(chosen.hits),
        f"{counted(half.solved, len(half.hits))} reach the target with 0.5, {counted(chosen.solved, len(chosen.hits))} with 0.6",
    )


def _count(evaluations: float) -> str:
    return f"{evaluations:.0f}" if np.isfinite(evaluations) else "infinite"


def _section(knob: Knob, races: Mapping[float, Race]) -> Section:
    table = tabulated(
        f"{knob.name}, the others as the paper has them",
        {
            knob.name: lambda v: f"{v:g}{' (chosen)' if v == knob.chosen else ''}",
            "reached": lambda v: counted(races[v].solved, len(races[v].hits)),
            "median evaluations": lambda v: (
                _count(races[v].median) if np.isfinite(races[v].median) else f"> {BUDGET:.0f}"
            ),
            "expected running time": lambda v: _count(races[v].expected) if races[v].solved else "–",
        },
        knob.values,
    )
    x = np.array(knob.values, dtype=float)
    y = np.array([(r.expected, r.median) for r in races.values()])
    y[~np.isfinite(y)] = np.nan
    drawing = plot(
        [Series("expected running time", x, y[:, 0]), Series("median", x, y[:, 1])],
        knob.name, "evaluations to 1e-6 J0", f"Evaluations to the target by {knob.name}",
        log_x=knob.name in ("NC", "pr"), log_y=True,
    )  # fmt: skip
    figure = Figure(f"Evaluations to the target by {knob.name}", drawing)
    return Section(knob.name, (table, figure, *((Prose(WORDS),) if knob is KNOBS[0] else ())))
