"""Estimates and the Cramer-Rao bound: scatter and bias under noise, and many parameters found again with and without it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.base.numbers import finite_or_none
from stoop.parallel import Run
from stoop.report.plots import Series, plot
from stoop.report.sheet import Figure, Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, counted, holds, number
from stoop_studies.problems import pose
from stoop_studies.problems.paper import NEAR
from stoop_studies.reproduce.suite import (
    Group,
    PaperExperiment,
    bound_deviations,
    by_columns,
    minus,
    rms,
    search_run,
    tabulated,
)

METHODS: Final = {"default": "ps-gde-lm", "PS-GDE": "ps-gde"}
STOP: Final = 500  #: generations of PS-GDE under noise; the default ends by itself
LONG: Final = 2000  #: generations of PS-GDE where many parameters are found again
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
beyond 3 would be one in 370. A run ends elsewhere if it costs more than 1.001 times what a dive from the truth ends \
at: in another optimum, or not at its end after {stop} iterations. Runs are not told the truth."""
HEAD: Final = (
    "method", "parameter", "truth", "bound", "scatter", "scatter_over_bound", "mean_error", "mean_error_over_standard_error",
    "largest_difference_over_bound", "runs", "elsewhere",
)  # fmt: skip
RECOVERY_HEAD: Final = (
    "method", "noise", "seed", "parameter", "truth", "estimate", "deviation_bound", "cost", "evaluations",
)  # fmt: skip


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

    def searches(self, setting: Setting) -> list[Run]:
        """Return all runs, and the least cost about the truth of each seed."""
        problem, seeds = f"paper-{setting.box}+noise", setting.seeds
        runs = [
            search_run(f"{who}/{s:06d}", who, problem, s, STOP if who == "ps-gde" else None)
            for who in METHODS.values()
            for s in seeds
        ]
        return runs + [Run(f"truth/{s:06d}", OPTIMUM, {"problem": problem, "seed": s}) for s in seeds]

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        posed = pose(f"paper-{setting.box}", setting.seed)
        assert posed.truth is not None  # noqa: S101 - this problem knows it
        names, truth, sigma = posed.parameters, posed.truth, bound_deviations(posed)
        groups = {
            m: Group.of(m, None, truth, [results[f"{who}/{s:06d}"] for s in setting.seeds])
            for m, who in METHODS.items()
        }
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
        columns: dict[str, Sequence[str]] = {
            "parameter": names,
            "truth": [number(float(t), 5) for t in truth],
            "bound": [f"{100.0 * s / abs(t):.2f} %" for s, t in zip(sigma, truth, strict=True)],
        }
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
        words = Prose(WORDS.format(spread=np.sqrt(0.5 / setting.runs), stop=STOP))
        return Findings(
            f"Noise: estimates and the Cramer-Rao bound, box {setting.box}",
            LEAD,
            tuple(_claims(scatters, elsewhere, setting.runs)),
            (Section("Scatter and bias", (table, words, figure)), Section("What it took", (effort,))),
            HEAD,
            tuple(_rows(names, sigma, groups, scatters, elsewhere)),
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


@dataclass(frozen=True, eq=False)
class Recovery:
    """Estimates of both methods of the parameters of a problem, whose truth and Cramer-Rao bound are (D,)."""

    parameters: tuple[str, ...]
    truth: FloatArray
    sigma: FloatArray
    groups: dict[tuple[str, bool], Group]  #: method and whether there is noise -> its runs

    @staticmethod
    def searches(problem: str, setting: Setting) -> list[Run]:
        """Return every method and seed, with and without noise; with noise in box W, which does not cut the scatter off."""
        return [
            search_run(
                _recovery_key(method, noise, seed),
                METHODS[method],
                f"{problem}+noise" if noise else problem,
                seed,
                LONG if method == "PS-GDE" else None,
                box="W" if noise else setting.box,
            )
            for method in METHODS
            for noise in (False, True)
            for seed in setting.seeds
        ]

    @classmethod
    def of(cls, problem: str, setting: Setting, results: Results) -> Recovery:
        """Return the estimates of all seeds."""
        posed = pose(problem, setting.seed, box=setting.box)
        assert posed.truth is not None  # noqa: S101 - these problems know it
        groups = {
            (m, noise): Group.of(
                m, None, posed.truth, [results[_recovery_key(m, noise, s)] for s in setting.seeds]
            )
            for m in METHODS
            for noise in (False, True)
        }
        return cls(posed.parameters, posed.truth, bound_deviations(posed), groups)

    def scores(self, method: str) -> FloatArray:
        """Return errors (n, D) with noise, in standard deviations of the bound."""
        return np.asarray((self.groups[method, True].values - self.truth) / self.sigma)

    @property
    def claims(self) -> list[Claim]:
        """Whether values without noise are exact (to a thousandth of what noise would change), and those with it efficient."""
        exact, efficient = [], []
        for method in METHODS:
            clean, z = self.groups[method, False], self.scores(method)
            errors = clean.errors
            many = int((errors * np.abs(self.truth) / self.sigma <= 1e-3).all(axis=1).sum())
            exact.append(
                holds(
                    f"{method}: all {errors.shape[1]} values without noise, to a thousandth of what noise would change, "
                    "in every run",
                    many == len(errors),
                    f"{counted(many, len(errors))}, largest relative error {number(float(errors.max()), 2)}, "
                    f"median {np.median(clean.evaluations):.0f} evaluations",
                )
            )
            band, ratio = 3.0 * np.sqrt(1.0 / (2.0 * z.size)), float(np.sqrt(np.mean(z**2)))
            efficient.append(
                holds(
                    f"{method}: errors with noise as large as the Cramer-Rao bound says",
                    abs(ratio - 1.0) <= band,
                    f"root mean square {number(ratio, 4)} of the bound over {z.size} estimates; "
                    f"1 ± {band:.3f} if independent",
                )
            )
        return exact + efficient

    @property
    def table(self) -> Table:
        """Errors by parameter."""
        columns: dict[str, Sequence[str]] = {
            "parameter": self.parameters,
            "truth": [number(float(v), 6) for v in self.truth],
            "bound": [f"{100.0 * s / abs(t):.2f} %" for s, t in zip(self.sigma, self.truth, strict=True)],
        }
        for method in METHODS:
            z, errors = self.scores(method), self.groups[method, False].errors
            columns |= {
                f"{method}: largest error without noise": [number(float(v), 2) for v in errors.max(axis=0)],
                f"{method}: scatter over bound": [number(float(v)) for v in rms(z)],
                f"{method}: bias over bound": [minus(f"{v:+.2f}") for v in z.mean(axis=0)],
            }
        words = (
            "Errors without noise are relative; the bound is the standard deviation that noise must cause (Cramer-Rao). "
            "Noisy runs search box W, whose bounds do not cut the scatter off"
        )
        return by_columns(words, columns)

    def rows(self, seeds: Sequence[int]) -> tuple[tuple[Cell, ...], ...]:
        """Return every estimate, under `RECOVERY_HEAD`."""
        known = list(zip(self.parameters, self.truth.tolist(), self.sigma.tolist(), strict=True))
        return tuple(
            (METHODS[method], noise, seed, name, t, float(v), s, float(cost), float(spent))
            for (method, noise), g in self.groups.items()
            for seed, values, cost, spent in zip(seeds, g.values, g.costs, g.evaluations, strict=True)
            for (name, t, s), v in zip(known, values, strict=True)
        )


def _recovery_key(method: str, noise: bool, seed: int) -> str:
    return f"recovery/{METHODS[method]}/{'noise' if noise else 'clean'}/{seed:06d}"
