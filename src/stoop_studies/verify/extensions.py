"""Size and power of the tests of model extensions, over simulated flights of right and of defective vehicle files."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.extensions import extension_tests
from stoop.base.numbers import finite_or_none
from stoop.estimate.fit import Options
from stoop.strategy.run import fit as fit_by
from stoop_plan.input_design.quick_fit import FIT_ALONE
from stoop_studies.findings import Claim, Findings, Setting, counted, holds
from stoop_studies.verify import study
from stoop_studies.verify.defects import KINDS, RIGHT, defects, fly

#: flights of a right model for each of a defective one: the size is to be known better
REPEATS: Final = 5
#: share of right models
MOST_SUGGESTED: Final = 0.05
#: the table of a vehicle file
GUSTS: Final = "turbulence"
#: share of flights, of a defect and of all
LEAST_NAMED: Final = 0.9
#: kinds
LEAST_DEFECTS: Final = 20
#: of the fit's time
MOST_TIME: Final = 1.0


@study.work
def examine(case: str, seed: int) -> dict[str, Any]:
    """Fly a defect, identify the user's file, and test its extensions; right models are flown `REPEATS` times."""
    seeds = [seed] if case not in RIGHT else [REPEATS * seed + k for k in range(REPEATS)]
    return {"flights": [_examined(case, s) for s in seeds]}


def _examined(case: str, seed: int) -> dict[str, Any]:
    defect, scene = defects()[case], fly(case, seed)
    method = KINDS[defect.kind].method
    options = Options(seed=seed, method=method)
    begun = time.perf_counter()
    fit = fit_by(FIT_ALONE, scene.start, scene.flights, scene.windows, options=options).estimate
    fitted = time.perf_counter()
    bars = ErrorBars.of(fit)
    assessed = time.perf_counter()
    tests = extension_tests(fit, bars)
    done = time.perf_counter()
    std = dict(zip(fit.estimates, bars.std[: len(fit.estimates)].tolist(), strict=True))
    off = {n: abs(fit.estimates[n] - v) / std[n] for n, v in scene.truth.items() if std[n] > 0.0}
    wanted, best = defect.names | defect.alike, next(iter(tests.found), None)
    # Gusts are no number: they are found before the fit, and told.
    seen = [GUSTS] if any(one.code == "gusts-ignored" for one in fit.notices) else []
    named = {*seen, *(() if best is None else (best.name, *best.rivals))}
    found = [*seen, *(one.name for one in tests.found)]
    return {
        "found": found, "value": None if best is None else best.value, "rivals": 0 if best is None else len(best.rivals),
        "first": bool(found) and found[0] in wanted, "named": not wanted.isdisjoint(named), "tested": tests.tested,
        "harm": finite_or_none(max(off.values(), default=0.0)),
        "outside": float(np.mean([z > 1.96 for z in off.values()])) if off else 0.0, "status": fit.outcome.status,
        "fit_seconds": fitted - begun, "test_seconds": done - assessed,
    }  # fmt: skip


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return size, power and time."""
    flights = {case: [f for r in samples[case] for f in r["flights"]] for case in CASES}
    rows = [{"case": case, **_record(case, own)} for case, own in flights.items()]
    right, wrong = ([r for r in rows if (r["case"] in RIGHT) == so] for so in (True, False))
    claims = _claims(right, wrong, [f for own in flights.values() for f in own])
    return Findings.of("Missing parts of a model: size and power of the tests", claims, rows)


def _record(case: str, flights: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return a row of the table."""
    defect, firsts = defects()[case], [f["found"][0] for f in flights if f["found"]]

    def share(key: str) -> float:
        return float(np.mean([f[key] for f in flights]))

    def median(key: str) -> float:
        return float(np.median([f[key] or 0.0 for f in flights]))

    wanted = bool(defect.names)
    return {
        "words": defect.words, "size": defect.size, "kind": defect.kind, "flights": len(flights),
        "suggested": float(np.mean([bool(f["found"]) for f in flights])), "first": share("first") if wanted else None,
        "named": share("named") if wanted else None, "rivals": share("rivals"), "harm": median("harm"),
        "outside": share("outside"), "most_often": max(sorted(set(firsts)), key=firsts.count, default=""),
        "tested": median("tested"), "fit_seconds": median("fit_seconds"), "test_seconds": median("test_seconds"),
    }  # fmt: skip


def _claims(
    right: Sequence[Mapping[str, Any]],
    wrong: Sequence[Mapping[str, Any]],
    flights: Sequence[Mapping[str, Any]],
) -> Iterator[Claim]:
    count, whole = (sum(line["flights"] for line in lines) for lines in (right, wrong))
    suggested = round(sum(line["suggested"] * line["flights"] for line in right))
    yield holds(
        f"Of right models at most {100 * MOST_SUGGESTED:g} % are said to lack something",
        suggested <= MOST_SUGGESTED * count,
        counted(suggested, count),
    )
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
