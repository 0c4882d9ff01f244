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
from stoop_studies.reproduce.bound import deviations
from stoop_studies.reproduce.plans import planned, searched

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
class Sample:
    """Estimates of one method.

    Attributes
    ----------
    values : (n, D)
    costs : (n,)
    evaluations : (n,)
    """

    values: FloatArray
    costs: FloatArray
    evaluations: FloatArray


@dataclass(frozen=True, eq=False)
class Scatter:
    """How estimates lie about the truth.

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


@dataclass(frozen=True)
class Noise:
    """Estimates under noise."""

    name: str = "noise"
    runs: int = 200
    box: str = "W"
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan:
        """Return all runs, and the least cost about the truth of each seed."""
        runs = [_run(method, s, setting) for method in METHODS for s in setting.seeds]
        return planned(self.name, setting, [*runs, *(_truth_run(s, setting) for s in setting.seeds)])

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        posed = pose(f"paper-{setting.box}", setting.seed)
        assert posed.truth is not None  # noqa: S101 - this problem knows it
        sigma = deviations(posed)
        samples = {m: _sample([results[_key(m, s)] for s in setting.seeds]) for m in METHODS}
        least = np.array([results[_key("truth", s)]["cost"] for s in setting.seeds])
        scatters = {m: scatter(sample.values, posed.truth, sigma) for m, sample in samples.items()}
        elsewhere = {m: int((s.costs > least * (1.0 + WRONG)).sum()) for m, s in samples.items()}
        names = posed.parameters
        words = WORDS.format(spread=np.sqrt(0.5 / setting.runs), stop=STOPS["PS-GDE"])
        return Findings(
            f"Noise: estimates and the Cramer-Rao bound, box {setting.box}",
            LEAD,
            tuple(_claims(scatters, elsewhere, setting.runs)),
            (
                Section(
                    "Scatter and bias",
                    (_table(names, posed.truth, sigma, scatters), Prose(words), _figure(scatters)),
                ),
                Section("What it took", (_effort(samples, elsewhere, least),)),
            ),
            HEAD,
            tuple(_rows(names, posed.truth, sigma, samples, scatters, elsewhere)),
        )


def optimum(arguments: Mapping[str, Any], stops: list[int | None]) -> list[Any]:
    """Return the least cost about the truth of ``problem`` with ``seed``: a dive from the truth ends there."""
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
    return f"{METHODS.get(who, who)}/{seed:06d}"


def _run(method: str, seed: int, setting: Setting) -> Run:
    return searched(_key(method, seed), METHODS[method], f"paper-{setting.box}+noise", seed, STOPS[method])


def _truth_run(seed: int, setting: Setting) -> Run:
    return Run(_key("truth", seed), OPTIMUM, {"problem": f"paper-{setting.box}+noise", "seed": seed})


def _sample(told: list[Mapping[str, Any]]) -> Sample:
    return Sample(*(np.array([t[c] for t in told], dtype=float) for c in ("values", "cost", "evaluations")))


def _claims(scatters: Mapping[str, Scatter], elsewhere: Mapping[str, int], count: int) -> list[Claim]:
    said = []
    for method in METHODS:
        s = scatters[method]
        low, high = float(s.ratios.min()), float(s.ratios.max())
        said += [
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
    return said


def _table(
    names: tuple[str, ...], truth: FloatArray, sigma: FloatArray, scatters: Mapping[str, Scatter]
) -> Table:
    head = ["parameter", "truth", "bound"]
    columns = []
    for method, s in scatters.items():
        head += [f"{method}: scatter over bound", f"{method}: bias"]
        columns += [[f"{v:.3f}" for v in s.ratios], [f"{v:+.2f}".replace("-", "−") for v in s.bias]]
    bounds = [f"{100.0 * s / abs(t):.2f} %" for s, t in zip(sigma, truth, strict=True)]
    rows = tuple(zip(names, [number(float(t), 5) for t in truth], bounds, *columns, strict=True))
    pooled = [text for s in scatters.values() for text in (f"{s.pooled:.3f}", "")]
    return Table("Each coefficient, and all pooled", tuple(head), (*rows, ("pooled", "", "", *pooled)))


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


def _effort(samples: Mapping[str, Sample], elsewhere: Mapping[str, int], least: FloatArray) -> Table:
    rows = tuple(
        (
            m,
            str(len(s.costs)),
            f"{np.median(s.evaluations):.0f}",
            number(float(np.max(s.costs / least - 1.0)), 2),
            counted(elsewhere[m], len(s.costs)),
        )
        for m, s in samples.items()
    )
    words = "The default runs to its own end, PS-GDE for 500 iterations"
    head = (
        "method",
        "seeds",
        "median evaluations",
        "largest cost above the optimum, relative",
        "ended elsewhere",
    )
    return Table(words, head, rows)


def _rows(
    names: tuple[str, ...],
    truth: FloatArray,
    sigma: FloatArray,
    samples: Mapping[str, Sample],
    scatters: Mapping[str, Scatter],
    elsewhere: Mapping[str, int],
) -> Iterator[tuple[Cell, ...]]:
    """Give a row per method and coefficient, and one of all pooled; differences are those from the default's."""
    for m, s in scatters.items():
        errors = samples[m].values - truth
        apart = np.abs(samples[m].values - samples["default"].values).max(axis=0) / sigma
        columns = (truth, sigma, s.ratios * sigma, s.ratios, errors.mean(axis=0), s.bias, apart)
        ends = (len(errors), elsewhere[m])
        for i, name in enumerate(names):
            yield (METHODS[m], name, *(finite_or_none(c[i]) for c in columns), *ends)
        yield (METHODS[m], "pooled", None, None, None, s.pooled, None, None, float(apart.max()), *ends)
