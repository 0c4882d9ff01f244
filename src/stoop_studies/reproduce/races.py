"""Ablation and sweep: variants of PS-GDE raced to the target on the same seeds, which idea helps, and what its parameters do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.base.numbers import finite_or_none
from stoop.parallel import Run
from stoop_studies.findings import Claim, Findings, Results, Setting, counted, holds, number, reproduces
from stoop_studies.reproduce.suite import PaperExperiment, hits_of, search_run

BUDGET: Final = 60_000.0  #: evaluations after which a run counts as failed
PAPER: Final[dict[str, Any]] = {"name": "ps-gde"}
WHOLE: Final = "PS-GDE"
LEVENBERG: Final = "Levenberg-Marquardt search"
VARIANTS: Final[dict[str, Any]] = {
    WHOLE: PAPER,
    "without sorting": PAPER | {"mutation": "unordered"},
    "without chaos": PAPER | {"initialization": "uniform"},
    "without local search": PAPER | {"search": "none"},
    "schedule as printed": PAPER | {"swapped": True},
    LEVENBERG: PAPER | {"search": "levenberg"},
    "all off": PAPER | {"mutation": "unordered", "initialization": "uniform", "search": "none"},
    "sorting alone": PAPER | {"initialization": "uniform", "search": "none"},
}
HELPS: Final = {
    "without sorting": "Sorting the three picks helps",
    "without chaos": "The chaotic start helps",
    "without local search": "The local search along the gradient helps",
}


@dataclass(frozen=True)
class Knob:
    """A parameter of PS-GDE: its name in the paper and in a variant, the paper's value (or the one read into it), and others."""

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


@dataclass(frozen=True, eq=False)
class Race:
    """Runs of one variant: evaluations to 1e-6 J0 (inf where the budget ran out first), and costs at the end; (n,) each."""

    hits: FloatArray
    costs: FloatArray

    @property
    def solved(self) -> int:
        """How many reached the target."""
        return int(np.isfinite(self.hits).sum())

    @property
    def median(self) -> float:
        """Median evaluations of all runs; inf where fewer than half got there."""
        # the mean of the middle two is nan where both are inf
        return float(np.sort(self.hits)[(len(self.hits) - 1) // 2]) if len(self.hits) else np.inf

    @property
    def expected(self) -> float:
        """Expected running time: evaluations of all runs over how many got there; inf where none did."""
        return float(np.minimum(self.hits, BUDGET).sum() / self.solved) if self.solved else np.inf

    @property
    def texts(self) -> dict[str, str]:
        """Columns of a page: how many of how many, median (or that it is beyond the budget), expected running time."""
        return {
            "reached": counted(self.solved, len(self.hits)),
            "median evaluations": f"{self.median:.0f}" if np.isfinite(self.median) else f"> {BUDGET:.0f}",
            "expected running time": f"{self.expected:.0f}" if self.solved else "–",
        }

    @property
    def record(self) -> dict[str, Cell]:
        """Columns of a table of numbers."""
        return {
            "runs": len(self.hits),
            "reached": self.solved,
            "median_evaluations": finite_or_none(self.median),
            "expected_running_time": finite_or_none(self.expected),
        }


class Raced(PaperExperiment):
    """Variants on the same seeds."""

    variants: Mapping[str, Any]

    def searches(self, setting: Setting) -> list[Run]:
        """Return every variant on every seed; one that appears under two names is run once."""
        found = [
            search_run(_key(v, s), v, f"paper-{setting.box}", s, None, budget=BUDGET, to_target=True)
            for v in self.variants.values()
            for s in setting.seeds
        ]
        return list({run.key: run for run in found}.values())

    def races(self, setting: Setting, results: Results) -> dict[str, Race]:
        """Return the runs by variant."""
        found = {name: [results[_key(v, s)] for s in setting.seeds] for name, v in self.variants.items()}
        return {name: Race(hits_of(r), np.array([t["cost"] for t in r])) for name, r in found.items()}


def _key(variant: Mapping[str, Any], seed: int) -> str:
    return f"{' '.join(f'{k}={variant[k]}' for k in sorted(variant))}/{seed:06d}"


def mann_whitney(one: Race, other: Race) -> float:
    """Return the two-sided p-value (Mann and Whitney 1947) that evaluations to the target differ; failed runs come last."""
    from scipy.stats import mannwhitneyu

    a, b = (np.where(np.isfinite(r.hits), r.hits, 2.0 * BUDGET) for r in (one, other))
    if np.ptp(np.concatenate([a, b])) == 0.0:
        return 1.0
    return float(mannwhitneyu(a, b, alternative="two-sided", method="asymptotic").pvalue)


def holm(pvalues: Mapping[str, float]) -> dict[str, float]:
    """Return p-values that hold for all of them together (Holm 1979, Scand. J. Stat. 6, 65-70)."""
    worst, found = 0.0, dict(pvalues)
    for i, name in enumerate(sorted(pvalues, key=lambda n: pvalues[n])):
        found[name] = worst = max(worst, min(1.0, (len(pvalues) - i) * pvalues[name]))
    return found


class Ablation(Raced):
    """Which idea helps."""

    name, runs, variants = "ablation", 50, VARIANTS

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what the races show."""
        found = self.races(setting, results)
        raw = {name: mann_whitney(race, found[WHOLE]) for name, race in found.items() if name != WHOLE}
        sure = holm(raw)
        rows = [
            {"variant": name, **race.record, "median_cost": float(np.median(race.costs))}
            | {"p_value": raw.get(name), "p_holm": sure.get(name)}
            for name, race in found.items()
        ]
        title = f"Ablation: which idea of PS-GDE helps, box {setting.box}"
        return Findings.of(title, _claims(found, sure), rows)


def _claims(found: Mapping[str, Race], sure: Mapping[str, float]) -> Iterator[Claim]:
    whole, printed = found[WHOLE], found["schedule as printed"]
    medians = {name: race.texts["median evaluations"] for name, race in found.items()}

    def slower(one: Race, other: Race, name: str) -> bool:
        """Whether one surely needs more than the other: in the median, or where both fail in the mean."""
        return sure[name] < 0.05 and (one.median, one.expected) > (other.median, other.expected)

    def against(name: str) -> str:
        p = f"p {'' if sure[name] < 1e-4 else '= '}{_p(sure[name])}"
        return f"median {medians[name]} evaluations {name}, {medians[WHOLE]} for {WHOLE}; {p}"

    for name, words in HELPS.items():
        yield reproduces(words, slower(found[name], whole, name), against(name))
    yield holds(
        "Steps 4 and 5 are swapped in print: as printed the search does not converge",
        printed.solved == 0,
        f"{printed.texts['reached']} reach the target, median cost {number(float(np.median(printed.costs)))}",
    )
    yield holds(
        "A Levenberg-Marquardt search on the same schedule is better than steepest descent",
        slower(whole, found[LEVENBERG], LEVENBERG),
        against(LEVENBERG),
    )


def _p(value: float) -> str:
    return "< 0.0001" if value < 1e-4 else f"{value:.4f}"


def _label(knob: Knob, value: float) -> str:
    return f"{knob.name} = {value:g}"


#: variants by label; the paper's own values are one and the same
SWEPT: Final = {_label(k, v): PAPER if v == k.chosen else PAPER | {k.key: v} for k in KNOBS for v in k.values}


class Sweep(Raced):
    """What NC, pr, F and CR do, one at a time about the paper's values."""

    name, runs, variants = "sweep", 20, SWEPT

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what the races show."""
        found = self.races(setting, results)
        by_knob = {k: {v: found[_label(k, v)] for v in k.values} for k in KNOBS}
        half, chosen = found["F = 0.5"], found["F = 0.6"]
        stagnates = holds(
            "With F = 0.5 some runs stagnate, with 0.6 none",
            half.solved < len(half.hits) and chosen.solved == len(chosen.hits),
            f"{half.texts['reached']} reach the target with 0.5, {chosen.texts['reached']} with 0.6",
        )
        claims = (*(_influence(k, own) for k, own in by_knob.items()), stagnates)
        rows = [
            {"parameter": k.name, "value": float(v), **race.record}
            for k, own in by_knob.items()
            for v, race in own.items()
        ]
        title = f"Sweep: NC, pr, F and CR of PS-GDE, box {setting.box}"
        return Findings.of(title, claims, rows)


def _influence(knob: Knob, races: Mapping[float, Race]) -> Claim:
    times = {v: race.expected for v, race in races.items()}
    best, worst = min(times, key=lambda v: times[v]), max(times.values())

    def shown(time: float) -> str:
        return f"{time:.0f}" if np.isfinite(time) else "infinite"

    return (reproduces if knob.name in ("NC", "pr") else holds)(
        f"{knob.name} matters: from {knob.values[0]:g} to {knob.values[-1]:g} the running time changes 1.5-fold",
        worst > 1.5 * times[best],
        f"expected running time {shown(times[best])} at {best:g}, {shown(times[knob.chosen])} at {knob.chosen:g}, "
        f"up to {shown(worst)}",
    )
