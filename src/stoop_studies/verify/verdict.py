"""Error rates of the verdict, over simulated flights of right and of defective vehicle files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from stoop.assessment.verdict import LIMITS
from stoop.estimate.fit import Options
from stoop.report.sheet import Prose, Section
from stoop.results.result import Result
from stoop.workflow.identification import identify
from stoop_studies.findings import Claim, Findings, Setting, counted, holds
from stoop_studies.verify import study
from stoop_studies.verify.defects import FLIGHTS, KINDS, RIGHT, defects, fly

REPEATS: Final = 5  #: flights of a right model for each of a defective one
HARM: Final = 3.0  #: standard errors by which a defect moves a parameter, from which the model is a bad one
MOST_WRONG: Final = 0.05  #: share of good models refused, and of bad ones trusted
GRADES: Final = ("trusted", "usable", "do not use")
LEAD: Final = f"""\
Each seed draws flights that move all controls, sensor biases, white noise and starting values. The vehicle that flies differs \
from the file that is identified in one thing, or in none. Of {len(FLIGHTS)} flights the last is held back and predicted. The \
verdict is the one that stoop identify publishes. A model is good where the file is right, and bad where a defect moves a \
parameter by more than {HARM:g} standard errors from its truth; defects that move less are counted apart."""
WORDS: Final = f"""\
Off is the largest error of a parameter that a justified use needs, relative to its true value, median over the flights in which \
a use is justified; a use allows a standard error of {100 * LIMITS.error:g} %. Harm is the largest error of any estimate, in its \
standard errors, median."""
SHOWN: Final[study.Columns] = {
    "words": ("what the file lacks", str),
    "size": ("size", str),
    "kind": ("vehicle", str),
    "flights": ("flights", "d"),
    "bad": ("bad", "d"),
    **{grade: (grade, "d") for grade in GRADES},
    "bad_trusted": ("bad and trusted", "d"),
    "harm": ("harm, standard errors", ".1f"),
    "off": ("off, %", study.percent),
}


@study.work
def examine(case: str, seed: int) -> dict[str, Any]:
    """Fly a defect, identify the user's file, and return the verdict; right models are flown `REPEATS` times."""
    seeds = [seed] if case not in RIGHT else [REPEATS * seed + k for k in range(REPEATS)]
    return {"flights": [_examined(case, s) for s in seeds]}


def _examined(case: str, seed: int) -> dict[str, Any]:
    scene = fly(case, seed, FLIGHTS[-1])
    held_back = [w for w in scene.windows if w.flight == FLIGHTS[-1]]
    fitted = [w for w in scene.windows if w.flight != FLIGHTS[-1]]
    options = Options(seed=seed, method=KINDS[defects()[case].kind].method)
    result = identify(scene.start, list(scene.flights.values()), fitted, held_back, options).result
    errors = {
        name: (one.estimate - scene.truth[name], one.std_error)
        for name, one in result.parameters.items()
        if name in scene.truth
    }
    return {
        "grade": result.verdict.grade,
        "uses": list(result.verdict.justified),
        "against": [one.code for one in result.verdict.against],
        "harm": max((abs(e) / s for e, s in errors.values() if s > 0.0), default=0.0),
        "off": _off(result, scene.truth),
        "seconds": result.seconds,
        "inside": [one.inside for m in result.maneuvers for one in m.channels.values() if one.inside >= 0.0],
    }


def _off(result: Result, truth: Mapping[str, float]) -> float | None:
    """Return the largest relative error of a parameter that a justified use needs: of each need, of its largest."""
    needs = [need for use in result.verdict.uses if use.justified for need in use.needs]
    largest = [max(need.parameters, key=lambda n: abs(result.parameters[n].estimate)) for need in needs]
    relative = [abs(result.parameters[n].estimate / truth[n] - 1.0) for n in largest if truth.get(n)]
    return max(relative, default=None)


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return the verdicts of each case, and how often they are wrong."""
    records = [_record(case, [f for r in samples[case] for f in r["flights"]]) for case in CASES]
    right = [record for record in records if record["case"] in RIGHT]
    wrong = [record for record in records if record["case"] not in RIGHT]
    return Findings.tabulated(
        "Error rates of the verdict",
        LEAD,
        _claims(right, wrong),
        (
            Section("Right models", (study.page_table("Fits by verdict", SHOWN, right),)),
            Section("Defects", (study.page_table("Fits by verdict", SHOWN, wrong), Prose(WORDS))),
        ),
        records,
    )


def _record(case: str, flights: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return a row of the table."""
    defect, bad = defects()[case], [case not in RIGHT and f["harm"] > HARM for f in flights]
    off = [f["off"] for f in flights if f["off"] is not None]
    return {
        "case": case,
        "words": defect.words,
        "size": defect.size,
        "kind": defect.kind,
        "flights": len(flights),
        "bad": sum(bad),
        **{grade: sum(f["grade"] == grade for f in flights) for grade in GRADES},
        "bad_trusted": sum(b and f["grade"] == "trusted" for b, f in zip(bad, flights, strict=True)),
        "bad_refused": sum(b and f["grade"] == "do not use" for b, f in zip(bad, flights, strict=True)),
        "harm": float(np.median([f["harm"] for f in flights])),
        "off": float(np.median(off)) if off else None,
        "inside": float(np.mean([x for f in flights for x in f["inside"]] or [0.0])),
        "seconds": float(np.median([f["seconds"] for f in flights])),
    }


def _claims(right: Sequence[Mapping[str, Any]], wrong: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    def total(lines: Sequence[Mapping[str, Any]], key: str) -> int:
        return sum(line[key] for line in lines)

    good, refused = total(right, "flights"), total(right, "do not use")
    yield holds(
        f"At most {100 * MOST_WRONG:g} % of good models are refused",
        refused <= MOST_WRONG * good,
        f"{counted(refused, good)}; {total(right, 'trusted')} trusted, {total(right, 'usable')} usable",
    )
    bad, trusted = total(wrong, "bad"), total(wrong, "bad_trusted")
    yield holds(
        f"At most {100 * MOST_WRONG:g} % of bad models are trusted",
        trusted <= MOST_WRONG * bad,
        f"{counted(trusted, bad)}; {total(wrong, 'bad_refused')} refused",
    )


CASES: Final = tuple(defects())
EXPERIMENT: Final = study.Verification("verdict", show, runs=8, work="examine", cases=CASES)
