"""The 18 lateral and directional terms of eq. (1), and whether the asymmetry terms absorb sensor biases."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from stoop.base.csv_text import Cell
from stoop.parallel import Plan
from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, holds, number, reproduces
from stoop_studies.problems.paper import LATERAL
from stoop_studies.reproduce import asymmetry, recovery
from stoop_studies.reproduce.asymmetry import BIASES, CASES, MODELS, OTHERS, TERMS, Fits
from stoop_studies.reproduce.suite import PaperExperiment, minus, planned, tabulated

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


class Lateral(PaperExperiment):
    """The lateral and directional terms of eq. (1)."""

    name, runs, parts = "lateral", 20, ("biases",)

    def plan(self, setting: Setting) -> Plan:
        """Return all runs of both parts."""
        return planned(self.name, setting, [*recovery.runs(self.name, setting), *asymmetry.runs(setting)])

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        found = recovery.recovery(self.name, setting, results)
        fits = {case: asymmetry.fits(case, False, setting.seed, results) for case in CASES}
        noisy = [asymmetry.fits("all", True, seed, results) for seed in setting.seeds]
        return Findings(
            f"Eq. (1): the 18 lateral and directional terms, box {setting.box}",
            LEAD,
            (*recovery.claims(found), *_claims(fits, noisy)),
            (
                Section("Eighteen values from one maneuver", (recovery.table(found),)),
                Section("Asymmetry terms and biased sensors", (Prose(WORDS), *_tables(fits, noisy))),
            ),
            recovery.HEAD,
            tuple(recovery.rows(found, setting.seeds)),
            {"biases": (FITS_HEAD, tuple(_fit_rows(fits, noisy, setting)))},
        )


def _claims(fits: Mapping[str, Fits], noisy: Sequence[Fits]) -> list[Claim]:
    every = fits["all"]
    shares = ", ".join(f"{case} {100 * fits[case].absorbed:.0f} %" for case in fits)
    rms = {m: _pooled(noisy, m) for m in MODELS}
    return [
        reproduces(
            "The asymmetry terms absorb most of what biased sensors cause (half of the misfit, or more)",
            every.absorbed >= 0.5,
            f"share of the misfit that they take up: {shares}",
        ),
        reproduces(
            "With the asymmetry terms free the other coefficients are no worse than noise makes them",
            every.rms("terms free") <= 1.0,
            f"with all biases their errors are {every.rms('terms free'):.1f} standard deviations, "
            f"{every.rms('terms zero'):.1f} with the terms at zero",
        ),
        reproduces(
            "They show the bias: CQ0, Cl0 or Cn0 leaves zero where a sensor is biased",
            all(_visible(fits[case]) for case in BIASES),
            f"by more than 3 standard deviations for {', '.join(c for c in BIASES if _visible(fits[c])) or 'none'}",
        ),
        holds(
            "Freeing the biases themselves instead removes the error",
            every.costs["biases free"] < 0.01 * every.costs["terms zero"] and rms["biases free"] < 1.5,
            f"J falls from {number(every.costs['terms zero'])} to {number(every.costs['biases free'], 2)}; with noise "
            + ", ".join(f"{rms[m]:.1f} with {m}" for m in MODELS),
        ),
    ]


def _pooled(noisy: Sequence[Fits], model: str) -> float:
    """Return the root mean square of the errors over seeds, in standard deviations."""
    return float(np.sqrt(np.mean([f.rms(model) ** 2 for f in noisy])))


def _visible(fit: Fits) -> bool:
    """Whether a term is off zero by more than three standard deviations of the noise."""
    sigma = asymmetry.term_deviations()
    return bool((np.abs([fit.values["terms free"][n] for n in TERMS]) > 3.0 * sigma).any())


def _tables(fits: Mapping[str, Fits], noisy: Sequence[Fits]) -> Iterator[Table]:
    """Give misfit, terms, errors without noise, errors with it, and each coefficient's error."""
    costs = [
        (case, _size(case), *(number(f.costs[m], 4) for m in MODELS), f"{100 * f.absorbed:.1f} %")
        for case, f in fits.items()
    ]
    head = ("biased", "by", *(f"J, {m}" for m in MODELS), "taken up by the terms")
    yield Table("Misfit without noise; 18,000 readings", head, tuple(costs))
    sigma = asymmetry.term_deviations()
    rows = [
        *((case, *(minus(f"{f.values['terms free'][n]:.5f}") for n in TERMS)) for case, f in fits.items()),
        ("noise alone, ±", *(f"{s:.5f}" for s in sigma)),
    ]
    yield Table("What the terms take up", ("biased", *TERMS), tuple(rows))
    errors = [
        (case, *(text for m in MODELS for text in (f"{f.rms(m):.2f}", f"{f.worst(m):.1f}")))
        for case, f in fits.items()
    ]
    head = ("biased", *(text for m in MODELS for text in (f"{m}: rms", "worst")))
    words = "Errors of the other 15 coefficients without noise, in standard deviations"
    yield Table(words, head, tuple(errors))
    yield tabulated(
        f"All five biased and noisy, {len(noisy)} seeds",
        {
            "model": lambda m: m,
            "mean J": lambda m: number(float(np.mean([f.costs[m] for f in noisy])), 5),
            "errors, rms": lambda m: f"{_pooled(noisy, m):.2f}",
            "worst": lambda m: f"{max(f.worst(m) for f in noisy):.1f}",
        },
        MODELS,
    )
    every = fits["all"]
    each = [(n, *(minus(f"{every.errors[m][i]:+.1f}") for m in MODELS)) for i, n in enumerate(OTHERS)]
    words = "All five biased, no noise: each coefficient's error in standard deviations"
    yield Table(words, ("parameter", *MODELS), tuple(each))


def _size(case: str) -> str:
    units = {"ay": "m/s2", "p": "rad/s", "r": "rad/s"}
    return f"{BIASES[case]:g} {units.get(case, 'rad')}" if case in BIASES else "as each"


def _fit_rows(
    fits: Mapping[str, Fits], noisy: Sequence[Fits], setting: Setting
) -> Iterator[tuple[Cell, ...]]:
    """Give one row per fit; errors are those of the other 15 in standard deviations, nothing stands for not free."""
    every = [(case, False, setting.seed, fit) for case, fit in fits.items()]
    every += [("all", True, seed, fit) for seed, fit in zip(setting.seeds, noisy, strict=True)]
    columns = (*LATERAL, *(f"sensors.{c}.bias" for c in BIASES))
    for case, noise, seed, fit in every:
        for m in MODELS:
            told = (fit.costs[m], fit.rms(m), fit.worst(m), *(fit.values[m].get(n) for n in columns))
            yield (case, m, noise, seed, *told)
