"""Size and power of the tests of what a model lacks, over simulated flights of right and of defective vehicle files."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from stoop.assessment.error_bars import error_bars
from stoop.assessment.extensions import LIMITS, extension_tests
from stoop.base.numbers import finite_or_none
from stoop.estimate import methods
from stoop.estimate.fit import Options
from stoop.report.sheet import Prose, Section
from stoop_studies.findings import Claim, Findings, Setting, counted, holds
from stoop_studies.verify import study
from stoop_studies.verify.defects import DURATION, FLIGHTS, KINDS, RIGHT, defects, fly

REPEATS: Final = 5  #: flights of a right model for each of a defective one: the size is to be known better
MOST_SUGGESTED: Final = 0.05  #: share of right models
GUSTS: Final = "turbulence"  #: the table of a vehicle file
LEAST_NAMED: Final = 0.9  #: share of flights, of a defect and of all
LEAST_DEFECTS: Final = 20  #: kinds
MOST_TIME: Final = 1.0  #: of the fit's
LEAD: Final = f"""\
Each seed draws maneuvers that move all controls ({len(FLIGHTS)} of {DURATION:.0f} s for the fixed wing), sensor biases, white \
noise and starting values. The vehicle that flies differs from the file that is identified in one thing, or in none. Gusts are \
looked for before the fit; every extension of the catalogue is tested after it, at a level of {100 * LIMITS.level:g} % for all \
tests of a fit together."""
WORDS: Final = """\
A defect is named where the strongest extension, or one that the report calls hard to tell from it, is the defect or what the \
data cannot tell from it (a lag and a delay of one control, to first order). Harm is the largest error of an estimate of the \
defective model, in its standard errors: median over the flights."""
SHOWN: Final[study.Columns] = {
    "words": ("what the file lacks", str),
    "size": ("size", str),
    "kind": ("vehicle", str),
    "flights": ("flights", "d"),
    "suggested": ("something suggested, %", study.percent),
    "first": ("named first, %", study.percent),
    "named": ("named, %", study.percent),
    "rivals": ("rivals", ".1f"),
    "harm": ("harm, standard errors", ".1f"),
    "outside": ("outside 95 %, %", study.percent),
    "most_often": ("most often named", str),
}


@study.work
def examine(case: str, seed: int) -> dict[str, Any]:
    """Fly a defect, identify the user's file, and test what it lacks; right models are flown `REPEATS` times."""
    seeds = [seed] if case not in RIGHT else [REPEATS * seed + k for k in range(REPEATS)]
    return {"flights": [_examined(case, s) for s in seeds]}


def _examined(case: str, seed: int) -> dict[str, Any]:
    defect, scene = defects()[case], fly(case, seed)
    method = KINDS[defect.kind].method
    options = Options(seed=seed, method=method)
    begun = time.perf_counter()
    choice = methods.choose_method(method, scene.start, scene.flights.values(), scene.windows)
    _, fit = choice.fit(scene.start, scene.flights, scene.windows, options)
    fitted = time.perf_counter()
    bars = error_bars(fit)
    assessed = time.perf_counter()
    tests = extension_tests(fit, bars)
    done = time.perf_counter()
    std = dict(zip(fit.estimates, bars.std[: len(fit.estimates)].tolist(), strict=True))
    off = {n: abs(fit.estimates[n] - v) / std[n] for n, v in scene.truth.items() if std[n] > 0.0}
    wanted, best = defect.names | defect.alike, next(iter(tests.found), None)
    # Gusts are no number: they are found before the fit, and told.
    seen = [GUSTS] if any(one.code == "gusts-ignored" for one in choice.notices) else []
    named = {*seen, *(() if best is None else (best.name, *best.rivals))}
    found = [*seen, *(one.name for one in tests.found)]
    return {
        "found": found,
        "value": None if best is None else best.value,
        "rivals": 0 if best is None else len(best.rivals),
        "first": bool(found) and found[0] in wanted,
        "named": not wanted.isdisjoint(named),
        "tested": tests.tested,
        "harm": finite_or_none(max(off.values(), default=0.0)),
        "outside": float(np.mean([z > 1.96 for z in off.values()])) if off else 0.0,
        "status": fit.outcome.status,
        "fit_seconds": fitted - begun,
        "test_seconds": done - assessed,
    }


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return size, power and time."""
    records = [_record(case, [f for r in samples[case] for f in r["flights"]]) for case in CASES]
    lines = [{"case": case, **record} for case, record in zip(CASES, records, strict=True)]
    flights = [f for case in CASES for r in samples[case] for f in r["flights"]]
    right = [line for line in lines if line["case"] in RIGHT]
    wrong = [line for line in lines if line["case"] not in RIGHT]
    return Findings.tabulated(
        "What a model lacks: size and power of the tests",
        LEAD,
        _claims(right, wrong, flights),
        (
            Section("Right models", (study.page_table("Share of fits", SHOWN, right),)),
            Section("Defects", (study.page_table("Share of fits", SHOWN, wrong), Prose(WORDS))),
        ),
        lines,
    )


def _record(case: str, flights: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return a row of the table."""
    defect = defects()[case]
    firsts = [f["found"][0] for f in flights if f["found"]]
    common = max(sorted(set(firsts)), key=firsts.count, default="")

    def share(key: str) -> float:
        return float(np.mean([f[key] for f in flights]))

    wanted = bool(defect.names)
    return {
        "words": defect.words,
        "size": defect.size,
        "kind": defect.kind,
        "flights": len(flights),
        "suggested": float(np.mean([bool(f["found"]) for f in flights])),
        "first": share("first") if wanted else None,
        "named": share("named") if wanted else None,
        "rivals": share("rivals"),
        "harm": float(np.median([f["harm"] or 0.0 for f in flights])),
        "outside": share("outside"),
        "most_often": common,
        "tested": float(np.median([f["tested"] for f in flights])),
        "fit_seconds": float(np.median([f["fit_seconds"] for f in flights])),
        "test_seconds": float(np.median([f["test_seconds"] for f in flights])),
    }


def _claims(
    right: Sequence[Mapping[str, Any]],
    wrong: Sequence[Mapping[str, Any]],
    flights: Sequence[Mapping[str, Any]],
) -> Iterator[Claim]:
    count = sum(line["flights"] for line in right)
    suggested = round(sum(line["suggested"] * line["flights"] for line in right))
    yield holds(
        f"Of right models at most {100 * MOST_SUGGESTED:g} % are said to lack something",
        suggested <= MOST_SUGGESTED * count,
        counted(suggested, count),
    )
    whole = sum(line["flights"] for line in wrong)
    named = round(sum(line["named"] * line["flights"] for line in wrong))
    yield holds(
        f"The defect, or one that cannot be told from it, is named in at least {100 * LEAST_NAMED:g} % of flights",
        named >= LEAST_NAMED * whole,
        f"{counted(named, whole)}, {100 * named / max(whole, 1):.1f} %",
    )
    good = [line for line in wrong if line["named"] >= LEAST_NAMED]
    yield holds(
        f"At least {LEAST_DEFECTS} kinds of defects are named in at least {100 * LEAST_NAMED:g} % of their flights each",
        len(good) >= LEAST_DEFECTS,
        counted(len(good), len(wrong)),
    )
    ratio = float(np.median([f["test_seconds"] / f["fit_seconds"] for f in flights]))
    yield holds("The tests take at most as long as the fit", ratio <= MOST_TIME, f"median {ratio:.2f} times")


CASES: Final = tuple(defects())
EXPERIMENT: Final = study.Verification("extensions", show, runs=20, work="examine", cases=CASES)
