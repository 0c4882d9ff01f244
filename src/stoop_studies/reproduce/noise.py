"""Noise: scatter of estimates against the Cramer-Rao bound, bias against its standard error, runs that end elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.base.numbers import finite_or_none
from stoop.parallel import Plan, Run
from stoop.report.plots import Series, plot
from stoop.report.sheet import Figure, Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, counted, holds, number
from stoop_studies.problems import pose
from stoop_studies.problems.paper import NEAR
from stoop_studies.reproduce.estimates import Group, bound_deviations
from stoop_studies.reproduce.suite import PaperExperiment, minus, planned, search_run, tabulated

METHODS: Final = {"default": "ps-gde-lm", "PS-GDE": "ps-gde"}
STOPS: Final[Mapping[str, int | None]] = {"default": None, "PS-GDE": 500}
OPTIMUM: Final = "stoop_studies.reproduce.noise:optimum"
WRONG: Final = 1e-3  #: above the least cost about the truth by more than this share is not that optimum
POOLED: Final = (0.95, 1.05)
EACH: Final = (0.85, 1.15)
LEAD: Final = """\
Each seed adds white noise of the stated size to the six channels and draws another box. An unbiased estimate can \
scatter no less than the Cramer-Rao bound, which follows from the Jacobian of the noise-free readings at the truth; \
maximum likelihood comes down to it when the record is long. Box W is searched unless another is asked for: bounds \
of box N can lie within two standard deviations of the truth (CLq), and would cut the scatter off."""
WORDS: Final = """\
Scatter over bound is the standard deviation of the estimates about the truth over that of the bound; it is known no \
better than {spread:.3f} per coefficient from so many seeds. Bias is the mean error in its own standard errors: \
beyond 3 would be one in 370. A run ends elsewhere if it costs more than 1.001 times what a dive from the truth ends \
at: in another optimum, or not at its end after {stop} iterations. Runs are not told the truth."""
HEAD: Final = (
    "method", "parameter", "truth", "bound", "scatter", "scatter_over_bound", "mean_error", "mean_error_over_standard_error",
    "largest_difference_over_bound", "runs", "elsewhere",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Scatter:
    """Scatter of the estimates of one method about the truth.

    Attributes
    ----------
    ratios : (D,)
        Root-mean-square error over the bound's standard deviation.
    bias : (D,)
        Mean error in its own standard errors.
    pooled : float
        The ratio of all together.
    """

    ratios: FloatArray
    bias: FloatArray
    pooled: float


class Noise(PaperExperiment):
    """Estimates under noise."""

    name, runs, box = "noise", 200, "W"

    def plan(self, setting: Setting) -> Plan:
        """Return all runs, and the least cost about the truth of each seed."""
        problem, seeds = f"paper-{setting.box}+noise", setting.seeds
        runs = [
            search_run(_key(registered, s), registered, problem, s, STOPS[method])
            for method, registered in METHODS.items()
            for s in seeds
        ]
        optima = [Run(_key("truth", s), OPTIMUM, {"problem": problem, "seed": s}) for s in seeds]
        return planned(self.name, setting, [*runs, *optima])

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        posed = pose(f"paper-{setting.box}", setting.seed)
        assert posed.truth is not None  # noqa: S101 - this problem knows it
        names, truth, sigma = posed.parameters, posed.truth, bound_deviations(posed)
        groups = {
            m: Group.of(m, STOPS[m], truth, [results[_key(registered, s)] for s in setting.seeds])
            for m, registered in METHODS.items()
        }
        least = np.array([results[_key("truth", s)]["cost"] for s in setting.seeds])
        scatters = {m: scatter(g.values, truth, sigma) for m, g in groups.items()}
        elsewhere = {m: int((g.costs > least * (1.0 + WRONG)).sum()) for m, g in groups.items()}
        words = WORDS.format(spread=np.sqrt(0.5 / setting.runs), stop=STOPS["PS-GDE"])
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
        table = _table(names, truth, sigma, scatters)
        return Findings(
            f"Noise: estimates and the Cramer-Rao bound, box {setting.box}",
            LEAD,
            tuple(_claims(scatters, elsewhere, setting.runs)),
            (
                Section("Scatter and bias", (table, Prose(words), _figure(scatters))),
                Section("What it took", (effort,)),
            ),
            HEAD,
            tuple(_rows(names, sigma, groups, scatters, elsewhere)),
        )


def optimum(arguments: Mapping[str, Any], stops: list[int | None]) -> list[Any]:
    """Return the least cost about the truth of ``problem`` with ``seed``: a local refinement from the truth ends there."""
    posed = pose(str(arguments["problem"]), int(arguments["seed"]))
    return [{"cost": posed.target / (1.0 + NEAR)} for _ in stops]


def scatter(values: FloatArray, truth: FloatArray, sigma: FloatArray) -> Scatter:
    """Return how estimates (n, D) lie about the truth (D,), against the bound (D,)."""
    z = (values - truth) / sigma
    spread = z.std(axis=0, ddof=1) if len(z) > 1 else np.full(z.shape[1], np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        bias = z.mean(axis=0) / (spread / np.sqrt(len(z)))
    return Scatter(np.sqrt(np.mean(z**2, axis=0)), bias, float(np.sqrt(np.mean(z**2))))


def _key(who: str, seed: int) -> str:
    return f"{who}/{seed:06d}"


def _claims(scatters: Mapping[str, Scatter], elsewhere: Mapping[str, int], count: int) -> list[Claim]:
    found = []
    for method, s in scatters.items():
        low, high = float(s.ratios.min()), float(s.ratios.max())
        found += [
            holds(
                f"{method}: scatter over the bound lies within 0.95 to 1.05 pooled, within 0.85 to 1.15 each",
                POOLED[0] <= s.pooled <= POOLED[1] and EACH[0] <= low and high <= EACH[1],
                f"{s.pooled:.3f} pooled, {low:.3f} to {high:.3f}, {count} seeds",
            ),
            holds(
                f"{method}: no bias beyond 3.5 of its standard errors in any of the ten",
                float(np.abs(s.bias).max()) < 3.5,
                f"largest {float(np.abs(s.bias).max()):.2f}",
            ),
            holds(
                f"{method}: no run ends elsewhere than at the optimum about the truth",
                elsewhere[method] == 0,
                counted(elsewhere[method], count),
            ),
        ]
    return found


def _table(
    names: tuple[str, ...], truth: FloatArray, sigma: FloatArray, scatters: Mapping[str, Scatter]
) -> Table:
    columns = {
        "parameter": names,
        "truth": [number(float(t), 5) for t in truth],
        "bound": [f"{100.0 * s / abs(t):.2f} %" for s, t in zip(sigma, truth, strict=True)],
    }
    for method, s in scatters.items():
        columns[f"{method}: scatter over bound"] = [f"{v:.3f}" for v in s.ratios]
        columns[f"{method}: bias"] = [minus(f"{v:+.2f}") for v in s.bias]
    pooled = [text for s in scatters.values() for text in (f"{s.pooled:.3f}", "")]
    rows = (*zip(*columns.values(), strict=True), ("pooled", "", "", *pooled))
    return Table("Each coefficient, and all pooled", tuple(columns), rows)


def _figure(scatters: Mapping[str, Scatter]) -> Figure:
    curves = [Series(m, np.arange(1.0, len(s.ratios) + 1.0), s.ratios, "points") for m, s in scatters.items()]
    ends = np.array([0.5, len(next(iter(scatters.values())).ratios) + 0.5])
    curves += [Series("0.85 and 1.15", ends, np.full(2, edge)) for edge in EACH]
    drawing = plot(
        curves,
        "coefficient, in the order of the table",
        "scatter over bound",
        "Scatter over the bound by coefficient",
    )
    return Figure("Scatter over the Cramer-Rao bound", drawing)


def _rows(
    names: tuple[str, ...],
    sigma: FloatArray,
    groups: Mapping[str, Group],
    scatters: Mapping[str, Scatter],
    elsewhere: Mapping[str, int],
) -> Iterator[tuple[Cell, ...]]:
    """Give a row per method and coefficient, and one of all pooled; differences are those from the default's."""
    for m, s in scatters.items():
        values, truth = groups[m].values, groups[m].truth
        apart = np.abs(values - groups["default"].values).max(axis=0) / sigma
        columns = (truth, sigma, s.ratios * sigma, s.ratios, (values - truth).mean(axis=0), s.bias, apart)
        ends = (len(values), elsewhere[m])
        for i, name in enumerate(names):
            yield (METHODS[m], name, *(finite_or_none(c[i]) for c in columns), *ends)
        yield (METHODS[m], "pooled", None, None, None, s.pooled, None, None, float(apart.max()), *ends)
