"""What each component of the covariance is worth: coverage, errors in standard errors, and widths without it.

The covariance is a sum, so that one fit tells what every smaller sum would say, of its numbers, of figures that are computed from
them (trims, modes, limits, control; to first order), and of readings of a window that is held back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any, Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.estimate.fit import Options
from stoop.prediction.predict import expected_biases, predict, predictor
from stoop.problem import on_circle
from stoop.strategy import Strategy, fit
from stoop.strategy.decision import Fitted
from stoop.vehicle import Vehicle
from stoop_analysis.propagation.rotor_figures import rotor_figures
from stoop_analysis.propagation.wing_figures import wing_figures
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import decision_fleet, feedback, misspecified, scenes, study
from stoop_studies.verify.propagate import ROTOR, WING

STEP: Final = 0.3  #: standard errors, of the differences by which figures are linearized
FAR: Final = 4.0  #: standard errors; a larger error costs the score no more
LEAST: Final = 1e-4  #: relative to the size of a figure; one that the numbers hardly move is not compared
INERTIA: Final = 0.1  #: standard deviation of a held moment of inertia, relative
MOMENTS: Final = tuple(f"mass.inertia.{axis}" for axis in ("xx", "yy", "zz"))
#: component -> group by whose numbers its worth is judged
WORTH: Final = {
    "color": "lacking",
    "windows": "feedback",
    "maneuvers": "wrong file",
    "held": "held",
    "model": "lacking",
}
LEFT_OUT: Final = ((), *((n,) for n in WORTH), *combinations(("color", "maneuvers", "model"), 2))
KINDS: Final = ("numbers", "figures", "readings")
THINNED: Final = 20  #: samples, from one reading of a window that is compared to the next
NOTHING: Final = "nothing"  #: is left out
Flown = tuple[Any, Vehicle, str]  #: a scene, the vehicle that flew, and a method that is named


def _fleet(name: str, seed: int) -> Flown:
    posed = decision_fleet.pose(name, seed)
    return posed, posed.start.with_numbers({n: {"value": v} for n, v in posed.truth.items()}), ""


def _held(seed: int) -> Flown:
    """Return a flight whose user holds the moments of inertia at values that are wrong by as much as their priors say."""
    posed, truth, method = _fleet("aircraft-calm", seed)
    drawn = 1.0 + INERTIA * np.random.default_rng(seed).standard_normal(len(MOMENTS))
    held = {
        n: {"value": truth.value(n) * float(x), "prior": INERTIA * truth.value(n), "free": False}
        for n, x in zip(MOMENTS, drawn, strict=True)
    }
    return replace(posed, start=posed.start.with_numbers(held)), truth, method


def _lacking(name: str, seed: int) -> Flown:
    truth, count = misspecified.CASES[name]
    return misspecified.flown(truth, seed, count), misspecified.TRUTHS[truth].vehicle(), "output-error"


def _scene(fly: Callable[[int], scenes.Scene], seed: int) -> Flown:
    scene = fly(seed)
    return scene, scene.start.with_numbers({n: {"value": v} for n, v in scene.truth.items()}), ""


#: case -> group, and from a seed to what is fitted
CASES: Final[Mapping[str, tuple[str, Callable[[int], Flown]]]] = {
    **{
        n: ("wrong file" if one.user or one.tried else "fleet", partial(_fleet, n))
        for n, one in decision_fleet.CASES.items()
    },
    **{
        n: ("right" if n.startswith("exact") else "lacking", partial(_lacking, n)) for n in misspecified.CASES
    },
    **{f"feedback-{n}": ("feedback", partial(_scene, one.fly)) for n, one in feedback.CASES.items()},
    "held": ("held", _held),
    "ar1": ("right", partial(_scene, scenes.in_autoregressive_noise)),
    "white": ("right", partial(_scene, scenes.in_white_noise)),
}


@study.work
def compare(case: str, seed: int) -> dict[str, Any]:
    """Identify a flight; return the errors of its numbers and figures, and what each component adds to their variances."""
    scene, truth, method = CASES[case][1](seed)
    try:
        done = fit(
            Strategy.default(), scene.start, scene.flights, scene.windows,
            options=Options(seed=seed, method=method, budget=8000.0),
        )  # fmt: skip
    except StoopError as error:
        return {"failed": str(error)}
    bars, names = done.tested.bars, [p.name for p in done.estimate.problem.layout.parameters]
    free = [i for i in bars.free if i < len(names) and np.isfinite(bars.std[i])]
    parts = {c.name: bars.part(c.name)[np.ix_(free, free)] for c in bars.components}
    own, values = [names[i] for i in free], done.estimate.estimates
    known = [j for j, n in enumerate(own) if n in scene.truth]
    out: dict[str, Any] = {"numbers": {
        "errors": [values[own[j]] - scene.truth[own[j]] for j in known],
        "sizes": [abs(scene.truth[own[j]]) for j in known],
        "variances": {c: np.diag(part)[known].tolist() for c, part in parts.items()},
    }}  # fmt: skip
    model = done.estimate.problem.layout.vehicle.with_numbers({n: {"value": v} for n, v in values.items()})
    with suppress(StoopError):  # nothing trims
        out["figures"] = _figures(model, truth, own, bars, free, parts)
    if isinstance(scene, decision_fleet.Posed):
        out["readings"] = _readings(scene, done)
    return out


def _readings(posed: decision_fleet.Posed, done: Fitted) -> dict[str, Any]:
    """Return errors of predicted readings of the window that is held back, and what each component adds to their variances."""
    bars, vehicle = done.tested.bars, done.estimate.problem.layout.vehicle
    biases, found = [expected_biases(done.estimate, posed.ahead.flight)], {}
    for name in (one.name for one in bars.components):
        model = predictor(done.estimate, bars.part("noise", name), done.options.treatment.recorded_motion)
        found[name] = predict(model, posed.flights, [posed.ahead], biases)
    pieces, readings = found["noise"].prepared.pieces, found["noise"].readings
    each = [on_circle(p.measured - y, vehicle.outputs) for p, y in zip(pieces, readings, strict=True)]
    errors = np.concatenate(each)[::THINNED].ravel()
    there = np.isfinite(errors)
    variances = {c: np.concatenate(p.deviations)[::THINNED].ravel()[there] ** 2 for c, p in found.items()}
    variances |= {c: v - variances["noise"] for c, v in variances.items() if c != "noise"}
    return {
        "errors": errors[there].tolist(), "variances": {c: v.tolist() for c, v in variances.items()},
    }  # fmt: skip


def _figures(
    model: Vehicle,
    truth: Vehicle,
    names: Sequence[str],
    bars: ErrorBars,
    free: Sequence[int],
    parts: Mapping[str, FloatArray],
) -> dict[str, Any]:
    """Return errors of figures of a model, and what each component adds to their variances, to first order."""
    figures, domain = (rotor_figures, ROTOR) if model.rotors else (wing_figures, WING)
    rows = [i for i, n in enumerate(names) if n in model.rows]
    steps, center = STEP * bars.std[free][rows], np.array([model.value(names[i]) for i in rows])
    lanes = center[:, None] + np.hstack([np.zeros((len(rows), 1)), np.diag(steps), -np.diag(steps)])
    moved = model.parameter_rows(dict(zip([names[i] for i in rows], lanes, strict=True)), lanes.shape[1])
    found = {s.name: s for _, s in figures(model, moved, domain).figures}
    true = figures(truth, np.repeat(truth.parameter_rows(), 2, axis=1), domain).figures
    errors, sizes, slopes = [], [], []
    for _, one in true:
        drawn = found[one.name].draws if one.name in found else np.full(2 * len(rows), np.nan)
        slope = (drawn[: len(rows)] - drawn[len(rows) :]) / (2.0 * steps)
        if np.isfinite(
            [*slope, one.estimate, found[one.name].estimate if one.name in found else np.nan]
        ).all():
            errors.append(found[one.name].estimate - one.estimate)
            sizes.append(abs(one.estimate))
            slopes.append(slope)
    G = np.array(slopes).reshape(-1, len(rows))
    whole = np.einsum("fi,ij,fj->f", G, np.sum([*parts.values()], axis=0)[np.ix_(rows, rows)], G)
    kept = np.sqrt(np.maximum(whole, 0.0)) > LEAST * np.array(sizes)
    variances = {
        c: np.einsum("fi,ij,fj->f", G, p[np.ix_(rows, rows)], G)[kept].tolist() for c, p in parts.items()
    }
    return {
        "errors": np.array(errors)[kept].tolist(), "sizes": np.array(sizes)[kept].tolist(), "variances": variances,
    }  # fmt: skip


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return coverage, errors and widths with all components and without each."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for case, results in samples.items():
        own = [one for one in results if "failed" not in one]
        for name in (case, CASES[case][0]):
            groups.setdefault(name, []).extend(own)
    records = [row for name, own in groups.items() for kind in KINDS for row in _rows(name, kind, own)]
    kinds = {group for group, _ in CASES.values()}
    summary = [row for row in records if row["case"] in kinds]
    return Findings.of("Components of the covariance", list(_claims(summary)), records, {"groups": summary})


def _rows(name: str, kind: str, results: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield coverage, root-mean-square error in standard errors, width, and logarithmic score, by what is left out."""
    own = [one[kind] for one in results if one.get(kind, {}).get("errors")]
    base: list[float] = []
    for left_out in LEFT_OUT if own else ():
        each, scores = [], []
        for one in own:
            used = [v for c, v in one["variances"].items() if c not in left_out]
            whole = np.sum(list(one["variances"].values()), axis=0)
            variance = np.maximum(np.sum(used, axis=0), 1e-12 * whole)
            ratio = np.array(one["errors"]) / np.sqrt(variance)
            each.append(np.column_stack([ratio, 0.5 * np.log(variance / whole)]))
            scores.append(
                float(np.mean(-0.5 * np.minimum(ratio**2, FAR**2) - 0.5 * np.log(variance / whole)))
            )
        ratio, width = np.vstack(each).T
        base = base or scores
        worth = np.array(base) - scores
        yield {
            "case": name, "of": kind, "without": " + ".join(left_out) or NOTHING, "fits": len(own), "count": len(ratio),
            "coverage": float(np.mean(np.abs(ratio) <= NORMAL_95)), "rms": float(np.sqrt(np.mean(ratio**2))),
            "median": float(np.median(np.abs(ratio))) / 0.6745, "width": float(np.exp(np.mean(width))),
            "worth": float(worth.mean()), "worth_se": float(worth.std() / np.sqrt(len(worth))),
        }  # fmt: skip


def _claims(summary: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    """Yield the coverage of each group, and whether each component is worth having in one of them."""
    for row in (one for one in summary if one["without"] == NOTHING):
        words = f"{row['of']} of the group {row['case']}: 95 % intervals hold the truth in"
        figures = f"of {row['count']} in {row['fits']} fits; rms of z {row['rms']:.2f}"
        yield study.within(words, (0.93, 0.97), row["coverage"], figures)
    for one in summary:
        if one["of"] == "numbers" and WORTH.get(one["without"]) == one["case"]:
            words = f"The component {one['without']} is worth having in the group {one['case']}"
            worth = f"{one['worth']:.3f} ± {one['worth_se']:.3f} of the score"
            yield holds(words, one["worth"] > 2.0 * one["worth_se"], worth)


EXPERIMENT: Final = study.Verification(
    "components", show, runs=6, work="compare", cases=tuple(CASES), parts=("groups",)
)
