"""Coverage and bias under an autopilot in gusts, by the method that stoop identify takes by itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import pandas as pd

from stoop.base.numbers import finite_or_none
from stoop.base.units import KNOT
from stoop.estimate.fit import Options
from stoop.strategy.run import fit
from stoop_plan.input_design.quick_fit import FIT_ALONE
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import closed_loop, scenes, study

#: kn, wind at 20 ft
LEVELS: Final = {"calm": 0.0, "light": 15.0, "moderate": 30.0, "severe": 45.0}
#: coverage of 95 % intervals
POOLED: Final = (0.90, 0.98)
#: mean error, in standard errors
MAX_BIAS: Final = 1.0


@dataclass(frozen=True)
class Case:
    """Flights of one vehicle at one level of turbulence."""

    words: str
    fly: Callable[[int], scenes.Scene]


CASES: Final[Mapping[str, Case]] = {
    f"{name}-{level}": Case(
        f"the {name} in {level} {'air' if level == 'calm' else 'turbulence'}", partial(scene, wind * KNOT)
    )
    for name, scene in (("aircraft", closed_loop.aircraft_scene), ("quadrotor", closed_loop.quadrotor_scene))
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
    found = fit(FIT_ALONE, scene.start, scene.flights, scene.windows, options=Options(seed=seed))
    estimate, method = found.estimate, found.setup.options.method
    return {**study.errors_of(estimate, scene.truth, found.tested.bars), "method": method}


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return coverage and bias of each case."""
    return coverage_and_bias("Flights in gusts under feedback", CASES, samples)


def coverage_and_bias(title: str, cases: Mapping[str, Case], samples: study.Samples) -> Findings:
    """Return coverage and bias of each case of a study."""
    claims, records, summary = list[Claim](), list[dict[str, Any]](), list[dict[str, Any]]()
    for key, case in cases.items():
        results = samples[key]
        scatter, std, coverage, _ = study.error_statistics(results)
        errors = np.array([r["errors"] for r in results], dtype=np.float64)
        bias, names, pooled = errors.mean(axis=0) / std, results[0]["names"], float(coverage.mean())
        worst = int(np.argmax(np.abs(np.nan_to_num(bias))))  # NaN where no flight has a standard error
        claims += [
            study.within(
                f"For {case.words} the pooled coverage is", POOLED, pooled, f"of {len(results)} flights' intervals"
            ),
            holds(
                f"For {case.words} no parameter is biased by {MAX_BIAS:g} standard error",
                bool(abs(bias[worst]) < MAX_BIAS),
                f"at most {abs(bias[worst]):.2f} ({names[worst]})",
            ),
        ]  # fmt: skip
        taken = Counter(r["method"] for r in results)
        common = {"case": key, "flights": len(results)}
        each = {"coverage": coverage, "sharpness": std / scatter, "bias": bias}
        records += study.records_of(pd.DataFrame({**common, "parameter": names, **each}))
        summary.append({
            **common, "case": case.words, "coverage": pooled,
            "method": ", ".join(f"{name} {count}" for name, count in taken.most_common()),
            "sharpness": finite_or_none(float(np.nanmean(std / scatter))),
            "bias": abs(bias[worst]), "parameter": names[worst], "unfinished": study.unfinished(results),
        })  # fmt: skip
    return Findings.of(title, claims, records, summary=summary)


EXPERIMENT: Final = study.Verification("feedback", show, runs=24, work="identify", cases=tuple(CASES))
