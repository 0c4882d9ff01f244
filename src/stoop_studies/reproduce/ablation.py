"""Ablation: which idea of the paper helps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from stoop.base.numbers import finite_or_none
from stoop.parallel import Plan
from stoop.report.plots import Series, plot
from stoop.report.sheet import Figure, Prose, Section
from stoop_studies.findings import Claim, Findings, Results, Setting, counted, holds, number, reproduces
from stoop_studies.reproduce.races import BUDGET, PAPER, Race, holm, mann_whitney, races, runs
from stoop_studies.reproduce.suite import PaperExperiment, planned, tabulated

WHOLE: Final = "PS-GDE"
VARIANTS: Final[dict[str, Any]] = {
    WHOLE: PAPER,
    "without sorting": PAPER | {"mutation": "unordered"},
    "without chaos": PAPER | {"initialization": "uniform"},
    "without dive": PAPER | {"search": "none"},
    "schedule as printed": PAPER | {"swapped": True},
    "Levenberg-Marquardt dive": PAPER | {"search": "levenberg"},
    "all off": PAPER | {"mutation": "unordered", "initialization": "uniform", "search": "none"},
    "sorting alone": PAPER | {"initialization": "uniform", "search": "none"},
}
SURE: Final = 0.05
LEAD: Final = """\
PS-GDE joins three ideas: a mutation whose three picks are sorted by cost, a chaotic first population, and a dive \
along the gradient every twentieth generation. Here each is taken away in turn, the dive is replaced by \
Levenberg-Marquardt, and the schedule is used as printed (dives in 19 of 20 generations). Runs end at 1e-6 of the \
trivial model's cost J0, or at 60,000 evaluations."""
WORDS: Final = """\
The p-value is of a two-sided Mann-Whitney test of the evaluations to the target against PS-GDE whole, runs that did \
not get there last; Holm's correction makes the column hold as a whole. Expected running time is all evaluations, \
those of lost runs included, over the number of runs that got there. "Without sorting" keeps the three picks of \
eq. (12) as drawn."""
HEAD: Final = (
    "variant", "runs", "reached", "median_evaluations", "expected_running_time", "median_cost", "p_value", "p_holm",
)  # fmt: skip


class Ablation(PaperExperiment):
    """Which idea helps."""

    name, runs = "ablation", 50

    def plan(self, setting: Setting) -> Plan:
        """Return all runs."""
        return planned(self.name, setting, runs(VARIANTS, setting))

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        found = races(VARIANTS, setting, results)
        raw = {name: mann_whitney(race, found[WHOLE]) for name, race in found.items() if name != WHOLE}
        sure = holm(raw)
        table = tabulated(
            f"{BUDGET:.0f} evaluations at most",
            {
                "variant": lambda name: name,
                "reached": lambda name: counted(found[name].solved, len(found[name].hits)),
                "median evaluations": lambda name: _count(found[name].median),
                "expected running time": lambda name: (
                    f"{found[name].expected:.0f}" if found[name].solved else "–"
                ),
                "p": lambda name: _p(sure[name]) if name in sure else "–",
            },
            found,
        )
        return Findings(
            f"Ablation: which idea of PS-GDE helps, box {setting.box}",
            LEAD,
            tuple(_claims(found, sure)),
            (Section("Races to the target", (table, Prose(WORDS), _figure(found))),),
            HEAD,
            tuple(
                (
                    name, len(r.hits), r.solved, finite_or_none(r.median), finite_or_none(r.expected),
                    float(np.median(r.costs)), raw.get(name), sure.get(name),
                )
                for name, r in found.items()
            ),
        )  # fmt: skip


def _claims(found: Mapping[str, Race], sure: Mapping[str, float]) -> list[Claim]:
    helps = {
        "without sorting": "Sorting the three picks helps",
        "without chaos": "The chaotic start helps",
        "without dive": "The dive along the gradient helps",
    }
    whole, printed, name = found[WHOLE], found["schedule as printed"], "Levenberg-Marquardt dive"
    return [
        *(
            reproduces(words, sure[n] < SURE and _slower(found[n], whole), _against(found, sure, n))
            for n, words in helps.items()
        ),
        holds(
            "Steps 4 and 5 are swapped in print: as printed the search does not converge",
            printed.solved == 0,
            f"{counted(printed.solved, len(printed.hits))} reach the target, "
            f"median cost {number(float(np.median(printed.costs)))}",
        ),
        holds(
            "A Levenberg-Marquardt dive on the same schedule is better than steepest descent",
            sure[name] < SURE and _slower(whole, found[name]),
            _against(found, sure, name),
        ),
    ]


def _slower(one: Race, other: Race) -> bool:
    """Whether one needs more than the other: in the median, or where both are lost in the mean."""
    return (one.median, one.expected) > (other.median, other.expected)


def _against(found: Mapping[str, Race], sure: Mapping[str, float], name: str) -> str:
    return (
        f"median {_count(found[name].median)} evaluations {name}, {_count(found[WHOLE].median)} for {WHOLE}; "
        f"p {'' if sure[name] < 1e-4 else '= '}{_p(sure[name])}"
    )


def _count(evaluations: float) -> str:
    return f"{evaluations:.0f}" if np.isfinite(evaluations) else f"> {BUDGET:.0f}"


def _p(value: float) -> str:
    return "< 0.0001" if value < 1e-4 else f"{value:.4f}"


def _figure(found: Mapping[str, Race]) -> Figure:
    curves = []
    for name, race in found.items():
        reached = np.sort(race.hits[np.isfinite(race.hits)])
        if reached.size:
            x = np.concatenate([reached[:1], reached, [BUDGET]])
            y = np.concatenate([[0.0], np.arange(1.0, reached.size + 1.0), [reached.size]]) / len(race.hits)
            curves.append(Series(name, x, y, "steps"))
    drawing = plot(
        curves, "evaluations", "share of runs", "Share of runs that reached the target by evaluations",
        log_x=True, y_range=(0.0, 1.02),
    )  # fmt: skip
    return Figure("Share of runs that reached the target", drawing)
