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
from stoop_studies.findings import Claim, Findings, Results, Setting, counted, holds
from stoop_studies.problems import pose
from stoop_studies.problems.paper import NEAR
from stoop_studies.reproduce.suite import METHODS, Group, PaperExperiment, Searches, bound_deviations, rms

STOPS: Final = {
    "default": (None,),
    "PS-GDE": (500,),
}  #: generations of each method; the default ends by itself
OPTIMUM: Final = "stoop_studies.reproduce.noise:optimum"
EACH: Final = (0.85, 1.15)  #: scatter over the bound of each coefficient


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
        title = f"Noise: estimates and the Cramer-Rao bound, box {setting.box}"
        rows = list(_records(names, sigma, groups, scatters, elsewhere))
        return Findings.of(title, _claims(scatters, elsewhere, setting.runs), rows)


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
