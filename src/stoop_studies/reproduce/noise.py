"""Estimates under noise and the Cramer-Rao bound: scatter and bias."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.base.numbers import finite_or_none
from stoop.parallel import Run
from stoop.report.plots import plot
from stoop.report.series import Series
from stoop.report.sheet import Figure, Prose, Section
from stoop_studies.findings import (
    Claim,
    Findings,
    Results,
    Setting,
    by_columns,
    counted,
    holds,
    number,
    tabulated,
)
from stoop_studies.problems import pose
from stoop_studies.problems.paper import NEAR
from stoop_studies.reproduce.recovery import parameter_columns
from stoop_studies.reproduce.suite import (
    METHODS,
    Group,
    PaperExperiment,
    Searches,
    bound_deviations,
    minus,
    rms,
)

STOPS: Final = {
    "default": (None,),
    "PS-GDE": (500,),
}  #: generations of each method; the default ends by itself
OPTIMUM: Final = "stoop_studies.reproduce.noise:optimum"
EACH: Final = (0.85, 1.15)  #: scatter over the bound of each coefficient
LEAD: Final = """\
Each seed adds white noise of the stated size to the six channels and draws another box. An unbiased estimate can \
scatter no less than the Cramer-Rao bound, which follows from the Jacobian of the noise-free readings at the truth; \
maximum likelihood comes down to it when the record is long. Box W is searched unless another is asked for: bounds \
of box N can lie within two standard deviations of the truth (CLq), and would cut the scatter off."""
WORDS: Final = """\
Scatter over bound is the standard deviation of the estimates about the truth over that of the bound; it is known no \
better than {spread:.3f} per coefficient from so many seeds. Bias is the mean error in its own standard errors: \
beyond 3 would be one in 370. A run ends elsewhere if it costs more than 1.001 times what a local refinement from the truth ends \
at: in another optimum, or not at its end after {stop} iterations. Runs are not told the truth."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """Scatter of the estimates of one method about the truth."""

    ratios: FloatArray  #: (D,), root-mean-square error over the bound's standard deviation
    bias: FloatArray  #: (D,), mean error in its own standard errors
    pooled: float  #: the ratio of all together


def scatter(values: FloatArray, truth: FloatArray, sigma: FloatArray) -> Scatter:
    """Return how estimates (n, D) lie about the truth (D,), against the bound (D,)."""
    z = (values - truth) / sigma
    spread = z.std(axis=0, ddof=1) if len(z) > 1 else np.full(z.shape[1], np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        bias = z.mean(axis=0) / (spread / np.sqrt(len(z)))
    return Scatter(rms(z), bias, float(np.sqrt(np.mean(z**2))))


def optimum(arguments: Mapping[str, Any], stops: list[int | None]) -> list[Any]:
    """Return the least cost about the truth of ``problem`` with ``seed``: a local refinement from the truth ends there."""
    posed = pose(str(arguments["problem"]), int(arguments["seed"]))
    return [{"cost": posed.target / (1.0 + NEAR)} for _ in stops]


class Noise(PaperExperiment):
    """Estimates under noise."""

    name, runs, box = "noise", 200, "W"

    def _searches(self, setting: Setting) -> Searches:
        return Searches("{who}/{seed:06d}", f"paper-{setting.box}+noise", setting.seeds, STOPS)

    def searches(self, setting: Setting) -> list[Run]:
        """Return all runs, and the least cost about the truth of each seed."""
        searches = self._searches(setting)
        return searches.runs() + [
            Run(f"truth/{s:06d}", OPTIMUM, {"problem": searches.problem, "seed": s}) for s in setting.seeds
        ]

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        posed = pose(f"paper-{setting.box}", setting.seed)
        assert posed.truth is not None  # noqa: S101 - this problem knows it
        names, truth, sigma = posed.parameters, posed.truth, bound_deviations(posed)
        groups = {m: own[0] for m, own in self._searches(setting).groups(results, truth).items()}
        least = np.array([results[f"truth/{s:06d}"]["cost"] for s in setting.seeds])
        scatters = {m: scatter(g.values, truth, sigma) for m, g in groups.items()}
        elsewhere = {m: int((g.costs > least * 1.001).sum()) for m, g in groups.items()}
        effort = tabulated(
            "The default runs to its own end, PS-GDE for 500 iterations",
            {
                "method": lambda g: g.method,
                "seeds": lambda g: str(len(g.costs)),
                "median evaluations": lambda g: f"{np.median(g.evaluations):.0f}",
                "largest cost above the optimum, relative": lambda g: number(
                    float(np.max(g.costs / least - 1.0)), 2
                ),
                "ended elsewhere": lambda g: counted(elsewhere[g.method], len(g.costs)),
            },
            groups.values(),
        )
        columns = parameter_columns(names, truth, sigma, 5)
        for method, s in scatters.items():
            columns[f"{method}: scatter over bound"] = [f"{v:.3f}" for v in s.ratios]
            columns[f"{method}: bias"] = [minus(f"{v:+.2f}") for v in s.bias]
        pooled = [text for s in scatters.values() for text in (f"{s.pooled:.3f}", "")]
        table = by_columns("Each coefficient, and all pooled", columns, ("pooled", "", "", *pooled))
        places = np.arange(1.0, len(names) + 1.0)
        curves = [Series(m, places, s.ratios, "points") for m, s in scatters.items()]
        ends = np.array([0.5, len(names) + 0.5])
        curves += [Series("0.85 and 1.15", ends, np.full(2, edge)) for edge in EACH]
        axes = "coefficient, in the order of the table", "scatter over bound"
        figure = Figure(
            "Scatter over the Cramer-Rao bound", plot(curves, *axes, "Scatter over the bound by coefficient")
        )
        words = Prose(WORDS.format(spread=np.sqrt(0.5 / setting.runs), stop=STOPS["PS-GDE"][0]))
        return Findings.tabulated(
            f"Noise: estimates and the Cramer-Rao bound, box {setting.box}",
            LEAD,
            _claims(scatters, elsewhere, setting.runs),
            (Section("Scatter and bias", (table, words, figure)), Section("What it took", (effort,))),
            list(_records(names, sigma, groups, scatters, elsewhere)),
        )


def _claims(scatters: Mapping[str, Scatter], elsewhere: Mapping[str, int], count: int) -> Iterator[Claim]:
    for method, s in scatters.items():
        low, high = float(s.ratios.min()), float(s.ratios.max())
        yield holds(
            f"{method}: scatter over the bound lies within 0.95 to 1.05 pooled, within 0.85 to 1.15 each",
            0.95 <= s.pooled <= 1.05 and EACH[0] <= low and high <= EACH[1],
            f"{s.pooled:.3f} pooled, {low:.3f} to {high:.3f}, {count} seeds",
        )
        yield holds(
            f"{method}: no bias beyond 3.5 of its standard errors in any of the ten",
            float(np.abs(s.bias).max()) < 3.5,
            f"largest {float(np.abs(s.bias).max()):.2f}",
        )
        yield holds(
            f"{method}: no run ends elsewhere than at the optimum about the truth",
            elsewhere[method] == 0,
            counted(elsewhere[method], count),
        )


def _records(
    names: tuple[str, ...],
    sigma: FloatArray,
    groups: Mapping[str, Group],
    scatters: Mapping[str, Scatter],
    elsewhere: Mapping[str, int],
) -> Iterator[dict[str, Cell]]:
    """Give a row per method and coefficient, and one of all pooled; differences are those from the default's."""
    for m, s in scatters.items():
        values, truth = groups[m].values, groups[m].truth
        columns = {
            "truth": truth,
            "bound": sigma,
            "scatter": s.ratios * sigma,
            "scatter_over_bound": s.ratios,
            "mean_error": (values - truth).mean(axis=0),
            "mean_error_over_standard_error": s.bias,
            "largest_difference_over_bound": np.abs(values - groups["default"].values).max(axis=0) / sigma,
        }
        ends = {"runs": len(values), "elsewhere": elsewhere[m]}
        for i, name in enumerate(names):
            cells = {column: finite_or_none(c[i]) for column, c in columns.items()}
            yield {"method": METHODS[m], "parameter": name, **cells, **ends}
        apart = float(columns["largest_difference_over_bound"].max())
        pooled = {"scatter_over_bound": s.pooled, "largest_difference_over_bound": apart}
        yield {"method": METHODS[m], "parameter": "pooled", **dict.fromkeys(columns), **pooled, **ends}
