"""Error bars of a designed input against those of a 3-2-1-1, as predicted and as achieved."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.design.robust import mean_ratio
from stoop.parallel import Plan, Run
from stoop.report.plots import Series, Strip, plot, stacked_plots
from stoop.report.sheet import Figure, Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, holds, number
from stoop_studies.verify.designed.scene import FAMILY, INPUTS, PLAN, maneuvers, predicted, setup

WORK: Final = "stoop_studies.verify.designed.scene:identify"
LOWER: Final = 0.7  #: of the textbook's mean standard error is what a design must come down to
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


@dataclass(frozen=True, eq=False)
class Both:
    """Standard errors (D,) of both inputs, in the order of `INPUTS`."""

    predicted: Mapping[str, FloatArray]
    achieved: Mapping[str, FloatArray]

    @staticmethod
    def ratio(of: Mapping[str, FloatArray]) -> float:
        """Return the mean of designed over textbook."""
        textbook, designed = (of[name] for name in INPUTS)
        return mean_ratio(designed, textbook)


@dataclass(frozen=True)
class Designed:
    """Designed against textbook input."""

    name: str = "design"
    runs: int = 100
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan:
        """Return one run per input and seed."""
        runs = (Run(_key(i, s), WORK, {"input": i, "seed": s}) for s in setting.seeds for i in INPUTS)
        return Plan(self.name, {"experiment": self.name}, tuple(runs))

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        errors = {i: np.array([results[_key(i, s)]["errors"] for s in setting.seeds]) for i in INPUTS}
        both = Both(
            {i: predicted(i) for i in INPUTS}, {i: np.sqrt(np.mean(e**2, axis=0)) for i, e in errors.items()}
        )
        limits = setup().limits
        lead = LEAD.format(
            duration=PLAN.duration, family=FAMILY, evaluations=PLAN.evaluations, optimizer=PLAN.optimizer,
            amplitude=math.degrees(max(limits.amplitude.values())), slew=math.degrees(limits.slew),
        )  # fmt: skip
        return Findings(
            "Designed input against a 3-2-1-1",
            lead,
            tuple(_claims(both, setting.runs)),
            (Section("Error bars", (_table(both), Prose(_words(setting.runs)), _figure(both))), _flown()),
            HEAD,
            tuple(_rows(both, setting.runs)),
        )


def _key(name: str, seed: int) -> str:
    return f"{name}/{seed:06d}"


def _words(runs: int) -> str:
    return WORDS.format(runs=runs, spread=100.0 / math.sqrt(2.0 * runs))


def _claims(both: Both, runs: int) -> Iterator[Claim]:
    for words, of in (("predicted", both.predicted), ("achieved", both.achieved)):
        ratio = Both.ratio(of)
        yield holds(
            f"the designed input lowers the mean {words} standard error by at least 30 %",
            ratio <= LOWER,
            f"by {100.0 * (1.0 - ratio):.0f} %, {runs} flights of each",
        )
    kept = np.concatenate([both.achieved[i] / both.predicted[i] for i in INPUTS])
    yield holds(
        "what is predicted is what is achieved, within 10 % on the mean over parameters and inputs",
        abs(float(kept.mean()) - 1.0) < 0.1,
        f"achieved over predicted {float(kept.mean()):.2f}",
    )


def _columns(both: Both) -> tuple[FloatArray, ...]:
    columns = (*(both.predicted[i] for i in INPUTS), *(both.achieved[i] for i in INPUTS))
    return (*columns, columns[1] / columns[0], columns[3] / columns[2])


def _table(both: Both) -> Table:
    head = (
        "parameter",
        "truth",
        "3-2-1-1: predicted",
        "designed",
        "3-2-1-1: achieved",
        "designed",
        "predicted ratio",
        "achieved ratio",
    )
    rows = [
        (name, number(float(truth), 4), *(number(float(c[i]), 3) for c in _columns(both)))
        for i, (name, truth) in enumerate(zip(setup().names, setup().values, strict=True))
    ]
    ends = (number(Both.ratio(both.predicted), 3), number(Both.ratio(both.achieved), 3))
    return Table("Standard errors", head, (*rows, ("mean", "", "", "", "", "", *ends)))


def _figure(both: Both) -> Figure:
    *_, promised, kept = _columns(both)
    place = np.arange(1.0, len(promised) + 1.0)
    edge = Series("textbook", place[[0, -1]], np.ones(2))
    curves = [Series("predicted", place, promised, "points"), Series("achieved", place, kept, "points"), edge]
    drawing = plot(
        curves, "coefficient, in the order of the table", "designed over 3-2-1-1", "Ratios of standard errors"
    )
    return Figure("Standard errors of the designed input over those of the 3-2-1-1", drawing)


def _flown() -> Section:
    told = maneuvers()
    moves = {name: told[name].deflections() for name in INPUTS}
    strips = [
        Strip(
            f"{control}, deg", tuple(Series(n, told[n].time, np.degrees(moves[n][control])) for n in INPUTS)
        )
        for control in moves[INPUTS[0]]
    ]
    drawing = stacked_plots(strips, "time, s", "Deflections of both inputs")
    return Section("What was flown", (Figure("Deflections from the trim", drawing),))


def _rows(both: Both, runs: int) -> Iterator[tuple[Cell, ...]]:
    for i, (name, truth) in enumerate(zip(setup().names, setup().values, strict=True)):
        yield (name, float(truth), *(float(c[i]) for c in _columns(both)), runs)
    ends = (Both.ratio(both.predicted), Both.ratio(both.achieved))
    yield ("mean", None, None, None, None, None, *ends, runs)
