"""Coverage and bias under an autopilot in gusts, by the method that stoop identify takes by itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import pandas as pd

from stoop.assessment.error_bars import error_bars
from stoop.base.numbers import finite_or_none
from stoop.base.units import KNOT
from stoop.estimate.fit import Options
from stoop.estimate.methods import choose_method
from stoop.report.sheet import Prose, Section
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import closed_loop, scenes, study

LEVELS: Final = {"calm": 0.0, "light": 15.0, "moderate": 30.0, "severe": 45.0}  #: kn, wind at 20 ft
POOLED: Final = (0.90, 0.98)  #: coverage of 95 % intervals
MAX_BIAS: Final = 1.0  #: mean error, in standard errors
LEAD: Final = f"""\
The twin-boom aircraft flies the four maneuvers of the study of coverage under an autopilot that holds its attitude by noisy \
readings, and the quadrotor of stoop flies doublets about all axes under its own for \
{closed_loop.LEGS * closed_loop.LEG:.0f} s, both in calm air and in the Dryden turbulence that MIL-F-8785C calls light, \
moderate and severe. The lateral model (reduce = "lateral") of the same aircraft takes V, alpha, q and theta from the record, in \
moderate turbulence. The vehicle files that the fits begin with know of no gusts; starting values are up to \
{100 * scenes.START_ERROR:.0f} % wrong (quadrotor {100 * closed_loop.QUADROTOR_ERROR:.0f} %). No method is named."""
WORDS: Final = """\
Coverage is the share of 95 % intervals that hold the truth, over all parameters and flights. Bias is the mean error of a \
parameter over its mean standard error; the largest of all parameters is shown with its parameter."""
SUMMARY: Final[study.Columns] = {
    "case": ("case", str),
    "flights": ("flights", "d"),
    "method": ("method taken", str),
    "coverage": ("coverage, %", study.percent),
    "sharpness": ("sharpness", ".2f"),
    "bias": ("largest bias, standard errors", ".2f"),
    "parameter": ("of", str),
    "unfinished": ("unfinished", "d"),
}


@dataclass(frozen=True)
class Case:
    """Flights of one vehicle at one level of turbulence."""

    words: str
    fly: Callable[[int], scenes.Scene]


CASES: Final[Mapping[str, Case]] = {
    f"{name}-{level}": Case(
        f"the {words} in {level} {'air' if level == 'calm' else 'turbulence'}",
        partial(scene, wind * KNOT),
    )
    for name, words, scene in (
        ("aircraft", "aircraft", closed_loop.aircraft_scene),
        ("quadrotor", "quadrotor", closed_loop.quadrotor_scene),
    )
    for level, wind in LEVELS.items()
} | {
    "aircraft-moderate-lateral": Case(
        "the lateral model of the aircraft in moderate turbulence",
        partial(closed_loop.lateral_scene, LEVELS["moderate"] * KNOT),
    )  # last, so that the others keep their random numbers
}


@study.work
def identify(case: str, seed: int) -> dict[str, Any]:
    """Fly a case and identify it without naming a method; a standard error is None where a bound holds the parameter."""
    # another stream of random numbers for each case: equal gusts would make their errors alike
    return identified(CASES[case].fly(1000 * list(CASES).index(case) + seed), seed)


def identified(scene: scenes.Scene, seed: int) -> dict[str, Any]:
    """Return errors and standard errors of a scene by the method that is taken where none is named."""
    choice = choose_method("", scene.start, scene.flights.values(), scene.windows)
    method, fit = choice.fit(scene.start, scene.flights, scene.windows, Options(seed=seed))
    bars, names = error_bars(fit), [p.name for p in fit.problem.layout.parameters]
    std = dict(zip(names, np.where(bars.at_bound, np.nan, bars.std), strict=False))
    return {
        "names": list(scene.truth),
        "errors": [fit.estimates[name] - value for name, value in scene.truth.items()],
        "sigma": study.or_none(np.array([std[name] for name in scene.truth])),
        "status": fit.outcome.status,
        "method": method,
    }


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return coverage and bias of each case."""
    return coverage_and_bias("Flights in gusts under feedback", LEAD, CASES, samples)


def coverage_and_bias(title: str, lead: str, cases: Mapping[str, Case], samples: study.Samples) -> Findings:
    """Return coverage and bias of each case of a study."""
    claims: list[Claim] = []
    records: list[dict[str, Any]] = []
    summary = []
    for key, case in cases.items():
        results = samples[key]
        scatter, std, coverage, _ = study.error_statistics(results)
        errors = np.array([r["errors"] for r in results], dtype=np.float64)
        bias, names = errors.mean(axis=0) / std, results[0]["names"]
        worst = int(np.argmax(np.abs(np.nan_to_num(bias))))  # NaN where no flight has a standard error
        low, high = POOLED
        claims += [
            holds(
                f"For {case.words} the pooled coverage is {100 * low:.0f} to {100 * high:.0f} %",
                low <= float(coverage.mean()) <= high,
                f"{100 * coverage.mean():.1f} % of {len(results)} flights' intervals",
            ),
            holds(
                f"For {case.words} no parameter is biased by {MAX_BIAS:g} standard error",
                bool(abs(bias[worst]) < MAX_BIAS),
                f"at most {abs(bias[worst]):.2f} ({names[worst]})",
            ),
        ]
        taken = Counter(r["method"] for r in results)
        method = ", ".join(f"{name} {count}" for name, count in taken.most_common())
        common = {"case": key, "flights": len(results)}
        each = {"coverage": coverage, "sharpness": std / scatter, "bias": bias}
        records += study.records_of(pd.DataFrame({**common, "parameter": names, **each}))
        summary.append(
            {
                **common,
                "method": method,
                "case": case.words,
                "coverage": float(coverage.mean()),
                "sharpness": finite_or_none(float(np.nanmean(std / scatter))),
                "bias": abs(bias[worst]),
                "parameter": names[worst],
                "unfinished": sum(r["status"] not in ("converged", "target") for r in results),
            }
        )
    table = study.page_table("Without a named method", SUMMARY, summary)
    return Findings.tabulated(
        title,
        lead,
        claims,
        (Section("What holds", (table, Prose(WORDS))),),
        records,
    )


EXPERIMENT: Final = study.Verification("feedback", show, runs=24, work="identify", cases=tuple(CASES))
