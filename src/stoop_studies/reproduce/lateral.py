"""The 18 lateral and directional terms of eq. (1), and the paper's claim that CQ0, Cl0 and Cn0 absorb errors of measurement.

For the claim, sensors of a symmetric aircraft are biased, and three models are fitted to the flight.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.problem.layout import Nuisance
from stoop_studies.findings import Claim, Findings, Results, Setting, holds, number, reproduces
from stoop_studies.problems.paper import LATERAL, Paper, aircraft, box, lateral_flight, of_known_truth
from stoop_studies.reproduce.recovery import Fits, ModelFits, ModelStudy, Recovery, fitted
from stoop_studies.reproduce.suite import bound_deviations, rms

WORK: Final = "stoop_studies.reproduce.lateral:work"
TERMS: Final = ("CQ0", "Cl0", "Cn0")
OTHERS: Final = tuple(n for n in LATERAL if n not in TERMS)
#: rad, rad/s, m/s2: twice the noise
BIASES: Final = {"beta": 0.01, "p": 0.01, "r": 0.01, "phi": 0.01, "ay": 0.1}
CASES: Final = (*BIASES, "all")
ZERO, FREE, BIASED = MODELS = ("terms zero", "terms free", "biases free")


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


def scores(fit: Fits, model: str) -> FloatArray:
    """Return the errors (15,) of the other coefficients in standard deviations of the noise."""
    errors = [fit.values[model][n] - truth().vehicle.value(n) for n in OTHERS]
    return np.array(errors) / deviations(terms=False)


def absorbed(fit: Fits) -> float:
    """Return the share of the misfit that the terms take up."""
    return 1.0 - fit.costs[FREE] / fit.costs[ZERO]


def visible(fit: Fits) -> bool:
    """Return whether a term is off zero by more than three standard deviations of the noise."""
    terms = np.abs([fit.values[FREE][n] for n in TERMS])
    return bool((terms > 3.0 * deviations(terms=True)).any())


class Lateral(ModelStudy):
    """The lateral and directional terms of eq. (1)."""

    name, runs, parts = "lateral", 20, ("biases",)

    def fits(self, setting: Setting) -> dict[tuple[str, bool], ModelFits]:
        """Return the fits of each case without noise, and with noise those of all biases."""
        clean = {(case, False): range(setting.seed, setting.seed + 1) for case in CASES}
        return {
            (case, noise): ModelFits(WORK, f"asymmetry/{case}", MODELS, noise, seeds, {"case": case})
            for (case, noise), seeds in {**clean, ("all", True): setting.seeds}.items()
        }

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        found, searches = Recovery.of(self.name, setting, results), self.fits(setting)
        every = {key: own.fits(results) for key, own in searches.items()}
        fits, noisy = {case: every[case, False][0] for case in CASES}, every["all", True]
        pooled = {m: float(np.sqrt(np.mean([rms(scores(f, m)) ** 2 for f in noisy]))) for m in MODELS}
        rows = [
            _record(case, m, noise, seed, fit)
            for (case, noise), own in searches.items()
            for seed, fit in zip(own.seeds, every[case, noise], strict=True)
            for m in MODELS
        ]
        title = f"Eq. (1): the 18 lateral and directional terms, box {setting.box}"
        claims = (*found.claims, *_claims(fits, pooled))
        return Findings.of(title, claims, found.records(setting.seeds), {"biases": rows}, found.summary)


def _claims(fits: Mapping[str, Fits], pooled: Mapping[str, float]) -> list[Claim]:
    every = fits["all"]
    free, zero = (float(rms(scores(every, m))) for m in (FREE, ZERO))
    return [
        reproduces(
            "The asymmetry terms absorb most of what biased sensors cause (half of the misfit, or more)",
            absorbed(every) >= 0.5,
            "share of the misfit that they take up: "
            + ", ".join(f"{case} {100 * absorbed(fit):.0f} %" for case, fit in fits.items()),
        ),
        reproduces(
            "With the asymmetry terms free the other coefficients are no worse than noise makes them",
            free <= 1.0,
            f"with all biases their errors are {free:.1f} standard deviations, {zero:.1f} with the terms at zero",
        ),
        reproduces(
            "They show the bias: CQ0, Cl0 or Cn0 leaves zero where a sensor is biased",
            all(visible(fits[case]) for case in BIASES),
            f"by more than 3 standard deviations for {', '.join(c for c in BIASES if visible(fits[c])) or 'none'}",
        ),
        holds(
            "Freeing the biases themselves instead removes the error",
            every.costs[BIASED] < 0.01 * every.costs[ZERO] and pooled[BIASED] < 1.5,
            f"J falls from {number(every.costs[ZERO])} to {number(every.costs[BIASED], 2)}; with noise "
            + ", ".join(f"{pooled[m]:.1f} with {m}" for m in MODELS),
        ),
    ]


def _record(case: str, model: str, noise: bool, seed: int, fit: Fits) -> dict[str, Cell]:
    """Return a row; errors are those of the other 15 in standard deviations, nothing stands for what is not free."""
    errors, values = scores(fit, model), fit.values[model]
    row: dict[str, Cell] = {"biased": case, "model": model, "noise": noise, "seed": seed}
    row |= {
        "cost": fit.costs[model],
        "error_rms": float(rms(errors)),
        "error_worst": float(np.abs(errors).max()),
    }
    row |= {n: values.get(n) for n in LATERAL}
    return row | {f"{c}_bias": values.get(f"sensors.{c}.bias") for c in BIASES}
