"""Error bars of a designed input against those of a 3-2-1-1, as predicted and as achieved."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pandas as pd

from stoop.base.arrays import FloatArray
from stoop.estimate.fit import Options, fit
from stoop.problem.windows import Window
from stoop.report.plots import plot
from stoop.report.series import Series
from stoop.report.sheet import Figure
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop_plan.input_design.information import Knowledge, Limits, Setup
from stoop_plan.input_design.optimization import Plan, design, textbook_maneuver
from stoop_plan.input_design.sensitivity import sensor_noise
from stoop_studies.findings import Findings, Setting, holds
from stoop_studies.verify.scenes import aircraft
from stoop_studies.verify.study import Samples, Verification, records_of, work

PLAN: Final = Plan(duration=20.0, rate=50.0, evaluations=2000, seed=0)
FAMILY: Final = "square"
BOX: Final = 8.0  #: predicted standard errors of the textbook's flight: no estimate may meet a bound
INPUTS: Final = ("textbook", "designed")
RATIO_LIMIT: Final = 0.7  #: of the textbook's mean standard error is what a design must come down to


@functools.cache
def setup() -> Setup:
    """Return the aircraft in steady flight; nothing is known of its coefficients."""
    vehicle = aircraft()
    point = trim(vehicle)
    return Setup(vehicle, point, Limits.about(vehicle, point), Knowledge.none(), sensor_noise(vehicle))


@functools.cache
def maneuvers() -> Mapping[str, Maneuver]:
    """Return both inputs; the designed one is searched once in each process."""
    own = design(setup(), PLAN, FAMILY).maneuver
    return dict(zip(INPUTS, (textbook_maneuver(setup(), PLAN), own), strict=True))


def predicted(name: str) -> FloatArray:
    """Return the standard errors (D,) that are predicted for an input, SI."""
    return setup().std(setup().forecast(maneuvers()[name]))


@functools.cache
def start() -> Vehicle:
    """Return the vehicle to identify: boxes so wide that no estimate meets a bound."""
    reach = BOX * predicted("textbook")
    boxes = {
        name: {"bounds": (float(value - r), float(value + r))}
        for name, value, r in zip(setup().names, setup().values, reach, strict=True)
    }
    return setup().vehicle.with_numbers(boxes)


@work
def identify(case: str, seed: int) -> dict[str, Any]:
    """Fly one of :data:`INPUTS` with the noise of a seed, and return the errors of the estimates."""
    flight = simulate_flight(start(), maneuvers()[case], seed, name="flown")
    done = fit(start(), {"flown": flight}, [Window("flown", 0.0, PLAN.duration)], Options(seed=seed))
    errors = np.array([done.estimates[n] for n in setup().names]) - setup().values
    return {"errors": errors.tolist(), "status": done.outcome.status}


def mean_ratio(std: FloatArray, reference: FloatArray) -> float:
    """Return the mean of the ratios of two sets of standard errors, over the parameters that both determine."""
    both = np.isfinite(std) & np.isfinite(reference) & (reference > 0.0)
    return float(np.mean(std[both] / reference[both])) if both.any() else float("nan")


def show(setting: Setting, samples: Samples) -> Findings:
    """Return how the standard errors of both inputs compare."""
    runs, ratios = setting.runs, dict[str, float]()
    columns: dict[str, FloatArray] = {f"{i}_predicted": predicted(i) for i in INPUTS}
    for i in INPUTS:
        errors = np.array([r["errors"] for r in samples[i]])
        columns[f"{i}_achieved"] = np.sqrt(np.mean(errors**2, axis=0))
    claims = []
    for kind in ("predicted", "achieved"):
        textbook, designed = (columns[f"{i}_{kind}"] for i in INPUTS)
        columns[f"ratio_{kind}"] = designed / textbook
        ratio = ratios[f"ratio_{kind}"] = mean_ratio(designed, textbook)
        claim = holds(
            f"the designed input lowers the mean {kind} standard error by at least 30 %",
            ratio <= RATIO_LIMIT,
            f"by {100.0 * (1.0 - ratio):.0f} %, {runs} flights of each",
        )
        claims.append(claim)
    over = float(np.mean([columns[f"{i}_achieved"] / columns[f"{i}_predicted"] for i in INPUTS]))
    claim = holds(
        "what is predicted is what is achieved, within 10 % on the mean over parameters and inputs",
        abs(over - 1.0) < 0.1,
        f"achieved over predicted {over:.2f}",
    )
    claims.append(claim)
    names, values = list(setup().names), setup().values
    records = records_of(pd.DataFrame({"parameter": names, "truth": values, **columns, "flights": runs}))
    records.append({**dict.fromkeys(records[0]), "parameter": "mean", **ratios, "flights": runs})
    place = np.arange(1.0, len(names) + 1.0)
    curves = [
        *(Series(kind, place, columns[f"ratio_{kind}"], "points") for kind in ("predicted", "achieved")),
        Series("textbook", place[[0, -1]], np.ones(2)),
    ]
    axes = "coefficient, in the order of the table", "designed over 3-2-1-1"
    figure = Figure("Standard errors of the designed input over the 3-2-1-1's", plot(curves, *axes, "Ratios"))
    return Findings.of("Designed input against a 3-2-1-1", claims, records, figures=(figure,))


EXPERIMENT: Final = Verification("design", show, runs=100, work="identify", cases=INPUTS)
