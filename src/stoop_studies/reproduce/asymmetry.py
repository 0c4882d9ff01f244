"""The paper's claim that CQ0, Cl0 and Cn0 absorb what is left of measurement errors: biased sensors, fitted."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.parallel import Run
from stoop.problem.layout import Nuisance
from stoop_studies.findings import Results, Setting
from stoop_studies.problems.paper import LATERAL, Paper, aircraft, box, lateral_flight, of_known_truth
from stoop_studies.reproduce.estimates import bound_deviations, fitted

WORK: Final = "stoop_studies.reproduce.asymmetry:work"
TERMS: Final = ("CQ0", "Cl0", "Cn0")
OTHERS: Final = tuple(n for n in LATERAL if n not in TERMS)
BIASES: Final = {
    "beta": 0.01,
    "p": 0.01,
    "r": 0.01,
    "phi": 0.01,
    "ay": 0.1,
}  #: rad, rad/s, m/s2: twice the noise
CASES: Final = (*BIASES, "all")
MODELS: Final = ("terms zero", "terms free", "biases free")
REACH: Final = 0.02  #: half the width of the terms' boxes
WEAK: Final = 20.0  #: prior standard deviation of a bias over its true size, so that the data decide


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
    """Fit one model to one flight, with the default optimizer to its end.

    Parameters
    ----------
    arguments : mapping
        ``case``: of `CASES`; ``model``: of `MODELS`; ``seed``: of box, noise and search; ``noise``: whether there
        is any.
    stops : sequence
        One None per result.
    """
    model, seed = str(arguments["model"]), int(arguments["seed"])
    case = replace(truth(), names=LATERAL) if model == "terms free" else truth()
    layout = case.bounded(*bounds(case.names, seed), nuisances(model))
    problem = case.misfit(layout, measured(str(arguments["case"]), seed, bool(arguments["noise"])))
    return [fitted(problem, seed)] * len(stops)


def nuisances(model: str) -> list[Nuisance]:
    """Return the biases of the sensors, where the model has them."""
    if model != "biases free":
        return []
    return [Nuisance(f"sensors.{c}.bias", 0, None, 0.0, WEAK * b) for c, b in BIASES.items()]


def bounds(names: Sequence[str], seed: int) -> tuple[FloatArray, FloatArray]:
    """Return boxes twice as wide as box W about the coefficients, and boxes about zero for the asymmetry terms.

    A model that lacks something puts coefficients far off; bounds that it meets would hide how far.
    """
    case = truth()
    low, high = box("W", seed, np.array([case.vehicle.value(n) for n in OTHERS]))
    margin = 0.5 * (high - low)
    low, high = low - margin, high + margin
    table = dict(zip(OTHERS, zip(low.tolist(), high.tolist(), strict=True), strict=True))
    middles = np.random.default_rng(30_000 + seed).uniform(-0.5 * REACH, 0.5 * REACH, len(TERMS))
    table |= {n: (float(m) - REACH, float(m) + REACH) for n, m in zip(TERMS, middles, strict=True)}
    pairs = np.array([table[n] for n in names])
    return pairs[:, 0], pairs[:, 1]


@functools.cache
def deviations() -> FloatArray:
    """Return the standard deviation (15,) that noise alone gives the other coefficients (Cramer-Rao), SI."""
    return _bound(truth())


@functools.cache
def term_deviations() -> FloatArray:
    """Return the same (3,) of the asymmetry terms, free among all 18."""
    return _bound(replace(truth(), names=LATERAL))[[LATERAL.index(n) for n in TERMS]]


def _bound(case: Paper) -> FloatArray:
    """Return the bound (D,) in the order of the case's names."""
    problem = case.misfit(case.bounded(*bounds(case.names, 0)), case.measured(0, noise=False))
    sigma = bound_deviations(of_known_truth(case.vehicle, problem, noise=False))
    found = dict(zip((p.name for p in problem.layout.parameters), sigma.tolist(), strict=True))
    return np.array([found[n] for n in case.names])


def key(case: str, model: str, noise: bool, seed: int) -> str:
    """Return the name of one fit."""
    return f"asymmetry/{case}/{model}/{'noise' if noise else 'clean'}/{seed:06d}"


def runs(setting: Setting) -> list[Run]:
    """Return one fit without noise of each case and model, and with all biases one per seed with noise."""
    clean = [(case, model, False, setting.seed) for case in CASES for model in MODELS]
    noisy = [("all", model, True, seed) for model in MODELS for seed in setting.seeds]
    return [
        Run(key(c, m, noise, seed), WORK, {"case": c, "model": m, "noise": noise, "seed": seed})
        for c, m, noise, seed in clean + noisy
    ]


@dataclass(frozen=True, eq=False)
class Fits:
    """Fits of all models to one flight.

    Attributes
    ----------
    costs : mapping
        Model -> J.
    errors : mapping
        Model -> (15,) errors of the other coefficients in standard deviations of the noise.
    values : mapping
        Model -> estimates.
    """

    costs: Mapping[str, float]
    errors: Mapping[str, FloatArray]
    values: Mapping[str, Mapping[str, float]]

    @property
    def absorbed(self) -> float:
        """Share of the misfit that the terms take up."""
        return 1.0 - self.costs["terms free"] / self.costs["terms zero"]

    def worst(self, model: str) -> float:
        """Return the largest error, in standard deviations."""
        return float(np.abs(self.errors[model]).max())

    def rms(self, model: str) -> float:
        """Return the root-mean-square error, in standard deviations."""
        return float(np.sqrt(np.mean(self.errors[model] ** 2)))


def fits(case: str, noise: bool, seed: int, results: Results) -> Fits:
    """Return the fits of a case."""
    found = {m: results[key(case, m, noise, seed)] for m in MODELS}
    true, sigma = np.array([truth().vehicle.value(n) for n in OTHERS]), deviations()
    errors = {m: (np.array([t["values"][n] for n in OTHERS]) - true) / sigma for m, t in found.items()}
    return Fits({m: t["cost"] for m, t in found.items()}, errors, {m: t["values"] for m, t in found.items()})
