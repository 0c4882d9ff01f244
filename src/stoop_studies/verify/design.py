"""Error bars of a designed input against those of a 3-2-1-1, as predicted and as achieved."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.estimate.fit import Options, fit
from stoop.input_design import Knowledge, Limits, Setup, design
from stoop.input_design.information import sensor_noise
from stoop.input_design.optimization import Plan, mean_ratio, textbook_maneuver
from stoop.problem.windows import Window
from stoop.report.plots import Series, Strip, plot, stacked_plots
from stoop.report.sheet import Figure, Prose, Section, Table
from stoop.simulation import Maneuver, simulate_flight, trim
from stoop.vehicle import Vehicle
from stoop_studies.findings import Claim, Findings, Setting, holds, number
from stoop_studies.verify.experiment import Samples, Verification, work
from stoop_studies.verify.scenes import aircraft

PLAN: Final = Plan(duration=20.0, rate=50.0, evaluations=2000, seed=0)
FAMILY: Final = "square"
BOX: Final = 8.0  #: predicted standard errors of the textbook's flight: no estimate may meet a bound
INPUTS: Final = ("textbook", "designed")
RATIO_LIMIT: Final = 0.7  #: of the textbook's mean standard error is what a design must come down to
LEAD: Final = """\
The twin-boom aircraft flies {duration:.0f} s on all six degrees of freedom, twice: with a 3-2-1-1 on elevator, aileron and \
rudder one after the other (steps as long as the time allows, or half as long, whichever tells more), and with the input that \
stoop design proposes ({family}: levels of alternating sign on all controls at once, their lengths searched with {evaluations} \
trials of {optimizer}). Both keep to {amplitude:.1f} deg, {slew:.0f} deg/s and the default envelope. Of each, many flights with \
other noise are identified: 32 coefficients, initial state, noise covariance. Achieved is the root-mean-square error of the \
estimates about the truth."""
WORDS: Final = """\
Both columns of ratios are those of the designed input over the textbook's, below 1 is better. A root-mean-square error from \
{runs} flights is known to {spread:.0f} %."""
HEAD: Final = (
    "parameter", "truth", "textbook_predicted", "designed_predicted", "textbook_achieved", "designed_achieved",
    "ratio_predicted", "ratio_achieved", "flights",
)  # fmt: skip


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
def identify(name: str, seed: int) -> dict[str, Any]:
    """Fly one of :data:`INPUTS` with the noise of a seed, and return the errors of the estimates."""
    flight = simulate_flight(start(), maneuvers()[name], seed, name="flown")
    done = fit(start(), {"flown": flight}, [Window("flown", 0.0, PLAN.duration)], Options(seed=seed))
    errors = np.array([done.estimates[n] for n in setup().names]) - setup().values
    return {"errors": errors.tolist(), "status": done.outcome.status}


@dataclass(frozen=True, eq=False)
class Both:
    """Standard errors (D,) of both inputs, by the names of `INPUTS`, from so many flights of each."""

    predicted: Mapping[str, FloatArray]
    achieved: Mapping[str, FloatArray]
    flights: int

    @staticmethod
    def ratio(of: Mapping[str, FloatArray]) -> float:
        """Return the mean of designed over textbook."""
        textbook, designed = (of[name] for name in INPUTS)
        return mean_ratio(designed, textbook)

    @property
    def ratios(self) -> tuple[float, float]:
        """Mean ratio as predicted and as achieved."""
        return self.ratio(self.predicted), self.ratio(self.achieved)

    @property
    def columns(self) -> tuple[FloatArray, ...]:
        """What stands under `HEAD` behind the truth."""
        columns = (*(self.predicted[i] for i in INPUTS), *(self.achieved[i] for i in INPUTS))
        return (*columns, columns[1] / columns[0], columns[3] / columns[2])

    @property
    def rows(self) -> Iterator[tuple[str, float, list[float]]]:
        """Give name, truth and columns of each parameter."""
        table = np.column_stack(self.columns).tolist()
        yield from zip(setup().names, map(float, setup().values), table, strict=True)


def show(setting: Setting, samples: Samples) -> Findings:
    """Return how the standard errors of both inputs compare."""
    errors = {i: np.array([r["errors"] for r in samples[i]]) for i in INPUTS}
    achieved = {i: np.sqrt(np.mean(e**2, axis=0)) for i, e in errors.items()}
    both, runs = Both({i: predicted(i) for i in INPUTS}, achieved, setting.runs), setting.runs
    limits = setup().limits
    lead = LEAD.format(
        duration=PLAN.duration, family=FAMILY, evaluations=PLAN.evaluations, optimizer=PLAN.optimizer,
        amplitude=math.degrees(max(limits.amplitude.values())), slew=math.degrees(limits.slew),
    )  # fmt: skip
    words = WORDS.format(runs=runs, spread=100.0 / math.sqrt(2.0 * runs))
    rows: list[tuple[Cell, ...]] = [(name, truth, *columns, runs) for name, truth, columns in both.rows]
    return Findings(
        "Designed input against a 3-2-1-1",
        lead,
        tuple(_claims(both)),
        (Section("Error bars", (_table(both), Prose(words), _figure(both))), _flown()),
        HEAD,
        (*rows, ("mean", None, None, None, None, None, *both.ratios, runs)),
    )


def _claims(both: Both) -> Iterator[Claim]:
    for words, ratio in zip(("predicted", "achieved"), both.ratios, strict=True):
        yield holds(
            f"the designed input lowers the mean {words} standard error by at least 30 %",
            ratio <= RATIO_LIMIT,
            f"by {100.0 * (1.0 - ratio):.0f} %, {both.flights} flights of each",
        )
    mean = float(np.concatenate([both.achieved[i] / both.predicted[i] for i in INPUTS]).mean())
    yield holds(
        "what is predicted is what is achieved, within 10 % on the mean over parameters and inputs",
        abs(mean - 1.0) < 0.1,
        f"achieved over predicted {mean:.2f}",
    )


def _table(both: Both) -> Table:
    head = (
        "parameter", "truth", "3-2-1-1: predicted", "designed", "3-2-1-1: achieved", "designed", "predicted ratio",
        "achieved ratio",
    )  # fmt: skip
    rows = [(name, number(truth, 4), *map(number, columns)) for name, truth, columns in both.rows]
    return Table("Standard errors", head, (*rows, ("mean", "", "", "", "", "", *map(number, both.ratios))))


def _figure(both: Both) -> Figure:
    *_, promised, achieved = both.columns
    place = np.arange(1.0, len(promised) + 1.0)
    curves = [
        Series("predicted", place, promised, "points"),
        Series("achieved", place, achieved, "points"),
        Series("textbook", place[[0, -1]], np.ones(2)),
    ]
    drawing = plot(
        curves, "coefficient, in the order of the table", "designed over 3-2-1-1", "Ratios of standard errors"
    )
    return Figure("Standard errors of the designed input over those of the 3-2-1-1", drawing)


def _flown() -> Section:
    own = maneuvers()
    moves = {name: own[name].deflections() for name in INPUTS}
    strips = [
        Strip(f"{c}, deg", tuple(Series(n, own[n].time, np.degrees(moves[n][c])) for n in INPUTS))
        for c in moves[INPUTS[0]]
    ]
    drawing = stacked_plots(strips, "time, s", "Deflections of both inputs")
    return Section("What was flown", (Figure("Deflections from the trim", drawing),))


EXPERIMENT: Final = Verification(
    "design", show, runs=100, work="stoop_studies.verify.design:identify", cases=INPUTS
)
