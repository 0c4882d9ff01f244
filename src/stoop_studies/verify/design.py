"""Error bars of a designed input against those of a 3-2-1-1, as predicted and as achieved."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pandas as pd

from stoop.base.arrays import FloatArray
from stoop.estimate.fit import Options, fit
from stoop.input_design.information import Knowledge, Limits, Setup
from stoop.input_design.optimization import Plan, design, mean_ratio, textbook_maneuver
from stoop.input_design.sensitivity import sensor_noise
from stoop.problem.windows import Window
from stoop.report.plots import plot, stacked_plots
from stoop.report.series import Series, Strip
from stoop.report.sheet import Figure, Prose, Section
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop_studies.findings import Findings, Setting, holds, number
from stoop_studies.verify.scenes import aircraft
from stoop_studies.verify.study import Columns, Samples, Verification, page_table, records_of, work

PLAN: Final = Plan(duration=20.0, rate=50.0, evaluations=2000, seed=0)
FAMILY: Final = "square"
BOX: Final = 8.0  #: predicted standard errors of the textbook's flight: no estimate may meet a bound
INPUTS: Final = ("textbook", "designed")
RATIO_LIMIT: Final = 0.7  #: of the textbook's mean standard error is what a design must come down to
LEAD: Final = """\
The twin-boom aircraft flies {duration:.0f} s on all six degrees of freedom, twice: with a 3-2-1-1 on elevator, aileron and \
rudder one after the other (steps as long as the time allows, or half as long, whichever has more information), and with \
the input that \
stoop design proposes ({family}: levels of alternating sign on all controls at once, their lengths searched with {evaluations} \
trials of {optimizer}). Both keep to {amplitude:.1f} deg, {slew:.0f} deg/s and the default envelope. Of each, many flights with \
other noise are identified: 32 coefficients, initial state, noise covariance. Achieved is the root-mean-square error of the \
estimates about the truth."""
WORDS: Final = """\
Both columns of ratios are those of the designed input over the textbook's, below 1 is better. A root-mean-square error from \
{runs} flights is known to {spread:.0f} %."""
SHOWN: Final[Columns] = {
    "parameter": ("parameter", str),
    "truth": ("truth", lambda value: number(value, 4)),
    "textbook_predicted": ("3-2-1-1: predicted", number),
    "designed_predicted": ("designed", number),
    "textbook_achieved": ("3-2-1-1: achieved", number),
    "designed_achieved": ("designed", number),
    "ratio_predicted": ("predicted ratio", number),
    "ratio_achieved": ("achieved ratio", number),
}


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


def show(setting: Setting, samples: Samples) -> Findings:
    """Return how the standard errors of both inputs compare."""
    runs, limits, ratios = setting.runs, setup().limits, {}
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
    lead = LEAD.format(
        duration=PLAN.duration, family=FAMILY, evaluations=PLAN.evaluations, optimizer=PLAN.optimizer,
        amplitude=math.degrees(max(limits.amplitude.values())), slew=math.degrees(max(limits.slew.values())),
    )  # fmt: skip
    words = WORDS.format(runs=runs, spread=100.0 / math.sqrt(2.0 * runs))
    own = maneuvers()
    moves = {name: own[name].deflections() for name in INPUTS}
    strips = [
        Strip(f"{c}, deg", tuple(Series(n, own[n].time, np.degrees(moves[n][c])) for n in INPUTS))
        for c in moves[INPUTS[0]]
    ]
    flown = Figure(
        "Deflections from the trim", stacked_plots(strips, "time, s", "Deflections of both inputs")
    )
    table = page_table("Standard errors", SHOWN, records, missing="")
    return Findings.tabulated(
        "Designed input against a 3-2-1-1",
        lead,
        claims,
        (Section("Error bars", (table, Prose(words), _figure(columns))), Section("What was flown", (flown,))),
        records,
    )


def _figure(columns: Mapping[str, FloatArray]) -> Figure:
    place = np.arange(1.0, len(setup().names) + 1.0)
    curves = [
        *(Series(kind, place, columns[f"ratio_{kind}"], "points") for kind in ("predicted", "achieved")),
        Series("textbook", place[[0, -1]], np.ones(2)),
    ]
    drawing = plot(
        curves, "coefficient, in the order of the table", "designed over 3-2-1-1", "Ratios of standard errors"
    )
    return Figure("Standard errors of the designed input over those of the 3-2-1-1", drawing)


EXPERIMENT: Final = Verification("design", show, runs=100, work="identify", cases=INPUTS)
