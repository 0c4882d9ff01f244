"""Coverage of 95 % intervals on flights whose truth has terms, gusts and sensor defects that the fitted model lacks."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from stoop.assessment.error_bars import ErrorBars, marginal_information
from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE
from stoop.estimate import methods
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.load import parse_vehicle
from stoop_studies.findings import Claim, Findings, Setting
from stoop_studies.verify import scenes, study
from stoop_studies.verify.defects import edited, with_columns

AXES: Final[tuple[scenes.Step, ...]] = (
    ("elevator", "3-2-1-1", 1.0, 0.3, 0.08),
    ("rudder", "doublet", 5.0, 0.6, 0.08),
    ("aileron", "2-1-1", 9.0, 0.5, 0.06),
)  #: inputs of each maneuver, before what a seed draws
DELAY: Final = 2.0  #: s; by up to which an input comes later
STRETCH: Final = (0.6, 1.6)  #: range of the factors on step and amplitude
DEFLECTION_NOISE: Final = 0.05 * DEGREE  #: rad, white, on what is recorded of each control
QUIET: Final = 0.2  #: of the noise of the sensors, beside noisy deflections
VANE_SCALE: Final = 1.08  #: of the flow angles as the vanes read them
SERVO_LAG: Final = 0.04  #: s, first order, of all controls
TERMS: Final = {
    "CL": {"CLalpha2": ("alpha^2", -6.0)},
    "Cm": {"Cmalpha2": ("alpha^2", -1.5), "Cmbeta2": ("beta^2", 0.5)},
    "CQ": {"CQalphabeta": ("alpha*beta", -1.0)},
    "Cl": {"Clalphabeta": ("alpha*beta", -0.3), "Clalphar": ("alpha*r", 0.8), "Clalphap": ("alpha*p", 1.5)},
    "Cn": {"Cnalphabeta": ("alpha*beta", 0.25), "Cnalphap": ("alpha*p", -0.6), "Cnbeta3": ("beta^3", 1.0)},
}  #: coefficient to terms that the truth has and the model lacks


METHODS: Final = ("sigma", "conditional", "cramer_rao")
POOLED: Final = (0.90, 0.98)


def drawn_maneuver(rng: np.random.Generator) -> Maneuver:
    """Return a maneuver of the population: an input on each axis, with times, steps, signs and amplitudes drawn."""
    inputs = []
    for control, shape, start, step, amplitude in AXES:
        stretch = rng.uniform(*STRETCH, size=2)
        inputs.append(
            {
                "control": control, "shape": shape, "start": start + rng.uniform(0.0, DELAY), "step": step * stretch[0],
                "amplitude": amplitude * stretch[1] * rng.choice((-1.0, 1.0)),
            }
        )  # fmt: skip
    return Maneuver.model_validate({"duration": scenes.DURATION, "rate": scenes.RATE, "input": inputs})


@functools.cache
def richer_aircraft() -> Vehicle:
    """Return the aircraft with terms that the fitted model lacks."""
    terms = {
        f"aerodynamics.{c}.{name}": {"term": term, "value": value}
        for c, own in TERMS.items()
        for name, (term, value) in own.items()
    }
    return _changed(terms)


@functools.cache
def slower_aircraft() -> Vehicle:
    """Return the aircraft with a lag of its servos, and vanes of a wrong scale."""
    lags = {f"controls.{control}.lag": SERVO_LAG for control in scenes.aircraft().controls}
    return _changed(lags | {f"sensors.{vane}.scale": VANE_SCALE for vane in ("alpha", "beta")})


def _changed(entries: Mapping[str, Any]) -> Vehicle:
    """Return the aircraft with further entries of its file and the true values that `scenes` sets."""
    vehicle = parse_vehicle(edited(scenes.aircraft().text, entries), "twin-boom")
    values = {name: {"value": value} for name, value in scenes.TRUTHS.items()}
    return scenes.with_trim_thrust(vehicle.with_numbers(values))


def with_noisy_deflections(flight: Flight, rng: np.random.Generator) -> Flight:
    """Return the flight with noise on what is recorded of each control."""
    recorded = {c: flight.column(c) for c in scenes.aircraft().recorded}
    return with_columns(
        flight, {c: x + DEFLECTION_NOISE * rng.standard_normal(x.size) for c, x in recorded.items()}
    )


@dataclass(frozen=True)
class Truth:
    """What flies, and what the fitted model lacks of it."""

    words: str
    vehicle: Callable[[], Vehicle]
    numbers: tuple[int, ...]  #: of maneuvers that are fitted together
    noise: float = 1.0  #: of the sensors, over that of the vehicle file
    noisy_inputs: bool = False


TRUTHS: Final[Mapping[str, Truth]] = {
    "exact": Truth("nothing: the model is right", scenes.aircraft, (1, 4)),
    "terms": Truth("nonlinear aerodynamic terms", richer_aircraft, (1, 4, 8)),
    "gusts": Truth(
        "moderate turbulence (Dryden), fitted by output error", scenes.turbulent_aircraft, (1, 4, 8)
    ),
    "sensors": Truth("lag of the servos, scale of the vanes", slower_aircraft, (1, 4)),
    "inputs": Truth("noise of the recorded deflections", scenes.aircraft, (1, 4), QUIET, noisy_inputs=True),
}
CASES: Final = {f"{name}-{n}": (name, n) for name, truth in TRUTHS.items() for n in truth.numbers}


def flown(name: str, seed: int, count: int) -> scenes.Scene:
    """Return so many maneuvers of a truth, and the model at the right values of what it has.

    A larger number continues the smaller: the study is of intervals, not of the search.
    """
    truth, flights = TRUTHS[name], {}
    noise = {
        c: truth.noise * float(v)
        for c, v in zip(scenes.aircraft().outputs, scenes.sensor_noise(scenes.aircraft()), strict=True)
    }
    for i in range(count):
        rng = np.random.default_rng([seed, i])
        maneuver = drawn_maneuver(rng).model_copy(update={"noise": noise})
        vehicle = scenes.with_biases(truth.vehicle(), rng)
        flight = simulate_flight(vehicle, maneuver, seed=int(rng.integers(2**31)), name=f"maneuver{i}")
        flights[flight.name] = with_noisy_deflections(flight, rng) if truth.noisy_inputs else flight
    values = scenes.coefficients(scenes.aircraft())
    start = scenes.wrong_start(scenes.aircraft(), np.random.default_rng(seed))
    start = start.with_numbers({number: {"value": value} for number, value in values.items()})
    windows = tuple(Window(flight, 0.0, scenes.DURATION) for flight in flights)
    return scenes.Scene(start, flights, windows, values)


@study.work
def cover(case: str, seed: int) -> dict[str, Any]:
    """Fly a case and identify it; ``information`` is that about the parameters, initial states and biases unknown."""
    name, number = CASES[case]
    scene = flown(name, seed, number)
    options = Options(seed=seed, method="output-error")
    fitter = methods.find(options.method).fitter()
    fit = fitter(scene.start, scene.flights, scene.windows, options, None, None)
    bars, count = ErrorBars.of(fit), len(scene.truth)
    own = bars.free[bars.free < count]
    information = np.zeros((count, count))
    information[np.ix_(own, own)] = marginal_information(bars.uncertainty.information, len(own))
    errors = {"sigma": bars.std, "conditional": bars.conditional_std, "cramer_rao": bars.cramer_rao_std}
    return {
        "names": list(scene.truth),
        "estimates": [fit.estimates[n] for n in scene.truth],
        "information": information.tolist(),
        "status": fit.outcome.status,
        **{k: study.or_none(np.where(bars.at_bound, np.nan, v)[:count]) for k, v in errors.items()},
    }


def best_fitting(results: Sequence[Mapping[str, Any]]) -> FloatArray:
    """Return the parameters (k,) that fit all flights together best, to first order: their mean weighted by information.

    A fit that ends at a bound is no stationary point of its likelihood, and has no part in the mean.
    """
    inner = [r for r in results if None not in r["sigma"]]
    information = np.array([r["information"] for r in inner])
    estimates = np.array([r["estimates"] for r in inner])
    return np.linalg.solve(information.sum(axis=0), np.einsum("nij,nj->i", information, estimates))


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return the coverage of each case."""
    claims, summary, records = list[Claim](), list[dict[str, Any]](), list[dict[str, Any]]()
    for case, (name, number) in CASES.items():
        truth, results = TRUTHS[name], samples[case]
        best = best_fitting(samples[f"{name}-{truth.numbers[-1]}"])
        errors = [{**r, "errors": np.array(r["estimates"]) - best} for r in results]
        found = {key: study.error_statistics(errors, key) for key in METHODS}
        scatter, mean, coverage, bias = found["sigma"]
        pooled = {k: float(found[k][2].mean()) for k in METHODS}
        summary.append({
            "case": name, "maneuvers": number, "flights": len(results), "lacks": truth.words,
            "coverage": pooled["sigma"], "least": float(coverage.min()), "sharpness": float(np.mean(mean / scatter)),
            **{f"coverage_{k}": pooled[k] for k in METHODS[1:]},
        })  # fmt: skip
        each = {
            "case": name, "maneuvers": number, "parameter": results[0]["names"], "best_fitting": best,
            "coverage": coverage, "sharpness": mean / scatter, "bias_in_standard_errors": bias,
        }  # fmt: skip
        records += study.records_of(pd.DataFrame(each))
        if number > 1:
            given = (
                f"of {len(results)} flights' intervals; given the model {100 * pooled['conditional']:.1f} %"
            )
            words = f"What lacks is {truth.words}; {number} maneuvers: pooled coverage"
            claims.append(study.within(words, POOLED, pooled["sigma"], given))
    return Findings.of("Intervals of wrong models", claims, summary, {"parameters": records})


EXPERIMENT: Final = study.Verification(
    "misspecified", show, runs=100, work="cover", cases=tuple(CASES), parts=("parameters",)
)
