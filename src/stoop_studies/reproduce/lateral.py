"""The 18 lateral and directional terms of eq. (1), and the paper's claim that CQ0, Cl0 and Cn0 absorb errors of measurement.

For the claim, sensors of a symmetric aircraft are biased, and three models are fitted to the flight.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.parallel import Run
from stoop.problem.layout import Nuisance
from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, holds, number, reproduces
from stoop_studies.problems.paper import LATERAL, Paper, aircraft, box, lateral_flight, of_known_truth
from stoop_studies.reproduce.noise import RECOVERY_HEAD, Recovery
from stoop_studies.reproduce.suite import PaperExperiment, bound_deviations, fitted, minus, rms, tabulated

WORK: Final = "stoop_studies.reproduce.lateral:work"
TERMS: Final = ("CQ0", "Cl0", "Cn0")
OTHERS: Final = tuple(n for n in LATERAL if n not in TERMS)
#: rad, rad/s, m/s2: twice the noise
BIASES: Final = {"beta": 0.01, "p": 0.01, "r": 0.01, "phi": 0.01, "ay": 0.1}
CASES: Final = (*BIASES, "all")
ZERO, FREE, BIASED = MODELS = ("terms zero", "terms free", "biases free")
FITS_HEAD: Final = (
    "biased", "model", "noise", "seed", "cost", "error_rms", "error_worst", *LATERAL, *(f"{c}_bias" for c in BIASES),
)  # fmt: skip
LEAD: Final = """\
The paper's model has 18 lateral and directional terms that its experiment leaves out. Here they are found from a \
maneuver with rudder and aileron, on all six degrees of freedom and from all twelve channels, with truths of our own. \
Then the paper's reason for CQ0, Cl0 and Cn0 is tried: that measurement errors which were not filtered out show up \
in them."""
WORDS: Final = """\
The truth is symmetric: the three terms are zero. Its sensors are biased by twice their noise, one at a time and all \
five together. Three models are fitted: with the terms at zero, with the terms free, and with the terms at zero but \
the five biases free. Errors are those of the other 15 coefficients, in standard deviations that noise alone would \
cause (Cramer-Rao), so that 1 is what a perfect fit of noisy data has. Bounds are twice as wide as those of box W, \
so that none is met."""


@functools.cache
def truth() -> Paper:
    """Return a symmetric aircraft and its flight with rudder and aileron."""
    vehicle = aircraft().with_numbers({n: {"value": 0.0} for n in TERMS})
    return Paper(vehicle, lateral_flight(vehicle), OTHERS)


def measured(case: str, seed: int, noise: bool) -> FloatArray:
    """Return readings (n, 12) of biased sensors; ``case`` is one channel, or all five."""
    readings = truth().measured(seed, noise)
    for channel, bias in BIASES.items():
        if case in (channel, "all"):
            readings[:, truth().vehicle.outputs.index(channel)] += bias
    return readings


def work(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Fit one model to one flight, with the default optimizer to its end; one result per stop, of which each is None.

    Arguments are ``case``: of `CASES`; ``model``: of `MODELS`; ``seed``: of box, noise and search; ``noise``: whether there
    is any.
    """
    model, seed = str(arguments["model"]), int(arguments["seed"])
    case = replace(truth(), names=LATERAL) if model == FREE else truth()
    # priors of the biases so weak that the data decide
    biases = BIASES.items() if model == BIASED else ()
    nuisances = [Nuisance(f"sensors.{c}.bias", 0, None, 0.0, 20.0 * b) for c, b in biases]
    layout = case.bounded(*bounds(case.names, seed), nuisances)
    problem = case.misfit(layout, measured(str(arguments["case"]), seed, bool(arguments["noise"])))
    return [fitted(problem, seed)] * len(stops)


def bounds(names: Sequence[str], seed: int) -> tuple[FloatArray, FloatArray]:
    """Return boxes twice as wide as box W about the coefficients, and boxes about zero for the asymmetry terms.

    A model that lacks something puts coefficients far off; bounds that it meets would hide how far.
    """
    low, high = box("W", seed, np.array([truth().vehicle.value(n) for n in OTHERS]))
    margin = 0.5 * (high - low)
    low, high = low - margin, high + margin
    table = dict(zip(OTHERS, zip(low.tolist(), high.tolist(), strict=True), strict=True))
    middles = np.random.default_rng(30_000 + seed).uniform(-0.01, 0.01, len(TERMS))
    table |= {n: (float(m) - 0.02, float(m) + 0.02) for n, m in zip(TERMS, middles, strict=True)}
    pairs = np.array([table[n] for n in names])
    return pairs[:, 0], pairs[:, 1]


@functools.cache
def deviations(terms: bool) -> FloatArray:
    """Return the standard deviations that noise alone gives (Cramer-Rao), SI: of the other coefficients, (15,), or the terms.

    The terms, (3,), are free among all 18.
    """
    case = replace(truth(), names=LATERAL) if terms else truth()
    problem = case.misfit(case.bounded(*bounds(case.names, 0)), case.measured(0, noise=False))
    sigma = bound_deviations(of_known_truth(case.vehicle, problem, noise=False))
    found = dict(zip((p.name for p in problem.layout.parameters), sigma.tolist(), strict=True))
    return np.array([found[n] for n in (TERMS if terms else OTHERS)])


def _key(case: str, model: str, noise: bool, seed: int) -> str:
    return f"asymmetry/{case}/{model}/{'noise' if noise else 'clean'}/{seed:06d}"


@dataclass(frozen=True, eq=False)
class Fits:
    """Fits of all models to one flight."""

    costs: Mapping[str, float]  #: model -> J
    #: model -> (15,) errors of the other coefficients in standard deviations of the noise
    errors: Mapping[str, FloatArray]
    values: Mapping[str, Mapping[str, float]]  #: model -> estimates

    @classmethod
    def of(cls, case: str, noise: bool, seed: int, results: Results) -> Fits:
        """Return the fits of a case."""
        found = {m: results[_key(case, m, noise, seed)] for m in MODELS}
        true, sigma = np.array([truth().vehicle.value(n) for n in OTHERS]), deviations(terms=False)
        errors = {m: (np.array([t["values"][n] for n in OTHERS]) - true) / sigma for m, t in found.items()}
        return cls(
            {m: t["cost"] for m, t in found.items()}, errors, {m: t["values"] for m, t in found.items()}
        )

    @property
    def absorbed(self) -> float:
        """Share of the misfit that the terms take up."""
        return 1.0 - self.costs[FREE] / self.costs[ZERO]

    @property
    def visible(self) -> bool:
        """Whether a term is off zero by more than three standard deviations of the noise."""
        terms = np.abs([self.values[FREE][n] for n in TERMS])
        return bool((terms > 3.0 * deviations(terms=True)).any())

    def worst(self, model: str) -> float:
        """Return the largest error, in standard deviations."""
        return float(np.abs(self.errors[model]).max())

    def rms(self, model: str) -> float:
        """Return the root-mean-square error, in standard deviations."""
        return float(rms(self.errors[model]))


class Lateral(PaperExperiment):
    """The lateral and directional terms of eq. (1)."""

    name, runs, parts = "lateral", 20, ("biases",)

    def searches(self, setting: Setting) -> list[Run]:
        """Return all runs of the recovery; one fit without noise of each case and model, and noisy ones with all biases."""
        clean = [(case, model, False, setting.seed) for case in CASES for model in MODELS]
        noisy = [("all", model, True, seed) for model in MODELS for seed in setting.seeds]
        return Recovery.searches(self.name, setting) + [
            Run(_key(c, m, noise, seed), WORK, {"case": c, "model": m, "noise": noise, "seed": seed})
            for c, m, noise, seed in clean + noisy
        ]

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        found = Recovery.of(self.name, setting, results)
        fits = {case: Fits.of(case, False, setting.seed, results) for case in CASES}
        noisy = [Fits.of("all", True, seed, results) for seed in setting.seeds]
        pooled = {m: float(np.sqrt(np.mean([f.rms(m) ** 2 for f in noisy]))) for m in MODELS}
        every = [(case, False, setting.seed, fit) for case, fit in fits.items()]
        every += [("all", True, seed, fit) for seed, fit in zip(setting.seeds, noisy, strict=True)]
        return Findings(
            f"Eq. (1): the 18 lateral and directional terms, box {setting.box}",
            LEAD,
            (*found.claims, *_claims(fits, pooled)),
            (
                Section("Eighteen values from one maneuver", (found.table,)),
                Section("Asymmetry terms and biased sensors", (Prose(WORDS), *_tables(fits, noisy, pooled))),
            ),
            RECOVERY_HEAD,
            found.rows(setting.seeds),
            {"biases": (FITS_HEAD, tuple(row for case in every for row in _rows(*case)))},
        )


def _claims(fits: Mapping[str, Fits], pooled: Mapping[str, float]) -> list[Claim]:
    every = fits["all"]
    return [
        reproduces(
            "The asymmetry terms absorb most of what biased sensors cause (half of the misfit, or more)",
            every.absorbed >= 0.5,
            "share of the misfit that they take up: "
            + ", ".join(f"{case} {100 * fit.absorbed:.0f} %" for case, fit in fits.items()),
        ),
        reproduces(
            "With the asymmetry terms free the other coefficients are no worse than noise makes them",
            every.rms(FREE) <= 1.0,
            f"with all biases their errors are {every.rms(FREE):.1f} standard deviations, "
            f"{every.rms(ZERO):.1f} with the terms at zero",
        ),
        reproduces(
            "They show the bias: CQ0, Cl0 or Cn0 leaves zero where a sensor is biased",
            all(fits[case].visible for case in BIASES),
            f"by more than 3 standard deviations for {', '.join(c for c in BIASES if fits[c].visible) or 'none'}",
        ),
        holds(
            "Freeing the biases themselves instead removes the error",
            every.costs[BIASED] < 0.01 * every.costs[ZERO] and pooled[BIASED] < 1.5,
            f"J falls from {number(every.costs[ZERO])} to {number(every.costs[BIASED], 2)}; with noise "
            + ", ".join(f"{pooled[m]:.1f} with {m}" for m in MODELS),
        ),
    ]


def _tables(
    fits: Mapping[str, Fits], noisy: Sequence[Fits], pooled: Mapping[str, float]
) -> tuple[Table, ...]:
    """Return misfit, terms, errors without noise, errors with it, and each coefficient's error."""
    units = {"ay": "m/s2", "p": "rad/s", "r": "rad/s"}
    size = {c: f"{b:g} {units.get(c, 'rad')}" for c, b in BIASES.items()} | {"all": "as each"}
    costs = [
        (case, size[case], *(number(f.costs[m], 4) for m in MODELS), f"{100 * f.absorbed:.1f} %")
        for case, f in fits.items()
    ]
    terms = [(case, *(minus(f"{f.values[FREE][n]:.5f}") for n in TERMS)) for case, f in fits.items()]
    terms.append(("noise alone, ±", *(f"{s:.5f}" for s in deviations(terms=True))))
    errors = [
        (case, *(text for m in MODELS for text in (f"{f.rms(m):.2f}", f"{f.worst(m):.1f}")))
        for case, f in fits.items()
    ]
    each = [(n, *(minus(f"{fits['all'].errors[m][i]:+.1f}") for m in MODELS)) for i, n in enumerate(OTHERS)]
    return (
        Table(
            "Misfit without noise; 18,000 readings",
            ("biased", "by", *(f"J, {m}" for m in MODELS), "taken up by the terms"),
            tuple(costs),
        ),
        Table("What the terms take up", ("biased", *TERMS), tuple(terms)),
        Table(
            "Errors of the other 15 coefficients without noise, in standard deviations",
            ("biased", *(text for m in MODELS for text in (f"{m}: rms", "worst"))),
            tuple(errors),
        ),
        tabulated(
            f"All five biased and noisy, {len(noisy)} seeds",
            {
                "model": lambda m: m,
                "mean J": lambda m: number(float(np.mean([f.costs[m] for f in noisy])), 5),
                "errors, rms": lambda m: f"{pooled[m]:.2f}",
                "worst": lambda m: f"{max(f.worst(m) for f in noisy):.1f}",
            },
            MODELS,
        ),
        Table(
            "All five biased, no noise: each coefficient's error in standard deviations",
            ("parameter", *MODELS),
            tuple(each),
        ),
    )


def _rows(case: str, noise: bool, seed: int, fit: Fits) -> Iterator[tuple[Cell, ...]]:
    """Give one row per model; errors are those of the other 15 in standard deviations, nothing stands for not free."""
    columns = (*LATERAL, *(f"sensors.{c}.bias" for c in BIASES))
    for m in MODELS:
        estimates = (fit.values[m].get(n) for n in columns)
        yield (case, m, noise, seed, fit.costs[m], fit.rms(m), fit.worst(m), *estimates)
