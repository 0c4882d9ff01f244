"""Error rates of the verdict, over simulated flights of right and of defective vehicle files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from stoop.assessment.covariance import standard_errors
from stoop.estimate.fit import Options
from stoop.results.result import Result
from stoop.workflow.identification import fit
from stoop_studies.findings import Claim, Findings, Setting, counted, holds
from stoop_studies.verify import study
from stoop_studies.verify.defects import FLIGHTS, KINDS, RIGHT, defects, fly

#: flights of a right model for each of a defective one
REPEATS: Final = 5
#: standard errors by which a defect moves a parameter, from which the model is a bad one
HARM: Final = 3.0
#: share of good models refused, and of bad ones trusted
MOST_WRONG: Final = 0.05
GRADES: Final = ("trusted", "usable", "do not use")


@study.work
def examine(case: str, seed: int) -> dict[str, Any]:
    """Fly a defect, identify the user's file, and return the verdict; right models are flown `REPEATS` times."""
    seeds = [seed] if case not in RIGHT else [REPEATS * seed + k for k in range(REPEATS)]
    return {"flights": [_examined(case, s) for s in seeds]}


def _examined(case: str, seed: int) -> dict[str, Any]:
    scene = fly(case, seed, FLIGHTS[-1])
    held_back, fitted = (
        [w for w in scene.windows if (w.flight == FLIGHTS[-1]) == so] for so in (True, False)
    )
    options = Options(seed=seed, method=KINDS[defects()[case].kind].method)
    result = fit(scene.start, list(scene.flights.values()), fitted, held_back, options).result
    known = {n: one for n, one in result.parameters.items() if n in scene.truth}
    bars = dict(zip(result.covariance.names, standard_errors(result.covariance.matrix), strict=True))
    off = [abs(p.estimate - scene.truth[n]) / bars[n] for n, p in known.items() if bars[n] > 0.0]
    return {
        "grade": result.verdict.grade, "uses": list(result.verdict.justified),
        "against": [one.code for one in result.verdict.against], "harm": max(off, default=0.0),
        "off": _off(result, scene.truth), "seconds": result.seconds,
        "inside": [one.inside for m in result.maneuvers for one in m.channels.values() if one.inside >= 0.0],
    }  # fmt: skip


def _off(result: Result, truth: Mapping[str, float]) -> float | None:
    """Return the largest relative error of a parameter that a justified use needs: of each need, of its largest."""
    needs = [need for use in result.verdict.uses if use.justified for need in use.needs]
    largest = [max(need.parameters, key=lambda n: abs(result.parameters[n].estimate)) for need in needs]
    relative = [abs(result.parameters[n].estimate / truth[n] - 1.0) for n in largest if truth.get(n)]
    return max(relative, default=None)


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return the verdicts of each case, and how often they are wrong."""
    records = [_record(case, [f for r in samples[case] for f in r["flights"]]) for case in CASES]
    right, wrong = ([r for r in records if (r["case"] in RIGHT) == so] for so in (True, False))
    return Findings.of("Error rates of the verdict", _claims(right, wrong), records)


def _record(case: str, flights: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return a row of the table."""
    defect, bad = defects()[case], [f for f in flights if case not in RIGHT and f["harm"] > HARM]
    off = [f["off"] for f in flights if f["off"] is not None]
    return {
        "case": case, "words": defect.words, "size": defect.size, "kind": defect.kind, "flights": len(flights),
        "bad": len(bad), **{grade: sum(f["grade"] == grade for f in flights) for grade in GRADES},
        "bad_trusted": sum(f["grade"] == "trusted" for f in bad),
        "bad_refused": sum(f["grade"] == "do not use" for f in bad),
        "harm": float(np.median([f["harm"] for f in flights])), "off": float(np.median(off)) if off else None,
        "inside": float(np.mean([x for f in flights for x in f["inside"]] or [0.0])),
        "seconds": float(np.median([f["seconds"] for f in flights])),
    }  # fmt: skip


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
