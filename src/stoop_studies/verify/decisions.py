"""What each decision of a fit is worth: coverage, bias, prediction and time with and without it.

A vehicle is identified with the default decisions, with none, and without each decision that applied, alone and in pairs. Without
a decision that was not needed the fit is the default one, bit for bit, and is not repeated.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any, Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.goodness_of_fit import theil
from stoop.base.arrays import FloatArray
from stoop.base.numbers import finite_or_none
from stoop.base.units import KNOT
from stoop.errors import IdentificationError
from stoop.estimate.fit import Options
from stoop.prediction.predict import expected_biases, predict, predictor
from stoop.strategy import DECISIONS, Decided, Strategy, run
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import closed_loop, defects, scenes, study

#: between the seeds of a vehicle's flights and of the one that is predicted
HELD_BACK: Final = 100_000
WIND: Final = 30.0 * KNOT
DEFAULT: Final = Strategy.default()
#: standard errors of a mean difference, from which it is no chance
SIGNIFICANT: Final = 2.0
CASES: Final[Mapping[str, Callable[[int], scenes.Scene]]] = {
    "aircraft-calm": partial(closed_loop.aircraft_scene, 0.0),
    "aircraft-gusts": partial(closed_loop.aircraft_scene, WIND),
    "aircraft-outliers": scenes.in_spikes,
    "aircraft-unequal": scenes.in_unequal_noise,
    "aircraft-late": scenes.with_late_vanes,
    "aircraft-wrong-inertia": partial(defects.fly, "inertia"),
    "aircraft-wrong-lag": partial(defects.fly, "lag-all"),
    "quadrotor-calm": partial(closed_loop.quadrotor_scene, 0.0),
    "quadrotor-gusts": partial(closed_loop.quadrotor_scene, WIND),
    "quadrotor-wrong-mass": partial(defects.fly, "mass"),
}
FIGURES: Final = ("coverage", "bias", "log_likelihood", "theil", "seconds")


def strategies(default: Decided) -> Iterator[tuple[str, Strategy]]:
    """Yield no decision, and the default ones without each that applied and without each pair."""
    applied = [one.name for one in default.decisions if one.state == "applied"]
    yield "all", Strategy.textbook()
    for many in (1, 2):
        yield from ((" + ".join(names), DEFAULT.without(*names)) for names in combinations(applied, many))


@study.work
def compare(case: str, seed: int) -> dict[str, Any]:
    """Identify a vehicle with and without its decisions."""
    scene, other = CASES[case](seed), CASES[case](seed + HELD_BACK)
    default, figures = _identified(scene, other, DEFAULT, seed)
    if default is None:
        return {"failed": True, "without": {}}
    without = {name: _identified(scene, other, own, seed)[1] for name, own in strategies(default)}
    return {"failed": False, "default": figures, "without": without, "method": default.options.method}


def _identified(
    scene: scenes.Scene, other: scenes.Scene, strategy: Strategy, seed: int
) -> tuple[Decided | None, dict[str, Any]]:
    """Return a fit and its `FIGURES`; a fit that fails has none."""
    began = time.perf_counter()
    try:
        done = run(strategy, scene.start, scene.flights, scene.windows, options=Options(seed=seed))
    except IdentificationError as error:
        return None, {"error": str(error)}
    seconds = time.perf_counter() - began
    found = study.errors_of(done.estimate, _compared(scene, done), done.tested.bars)
    errors, sigma = (np.array(found[key], dtype=np.float64) for key in ("errors", "sigma"))
    given = np.isfinite(sigma) & (sigma > 0.0)
    ratio = errors[given] / sigma[given]
    likelihood, theils = _prediction(done, other)
    values = (
        float(np.sum(np.abs(ratio) <= NORMAL_95)) / len(errors),
        float(np.sqrt(np.mean(ratio**2))) if ratio.size else np.nan, likelihood, theils, seconds,
    )  # fmt: skip
    return done, {
        **{name: finite_or_none(value) for name, value in zip(FIGURES, values, strict=True)},
        "status": done.estimate.outcome.status,
    }


def _compared(scene: scenes.Scene, done: Decided) -> dict[str, float]:
    """Return the truth of the numbers that were estimated."""
    return {n: v for n, v in scene.truth.items() if n in done.estimate.estimates}


def _prediction(done: Decided, other: scenes.Scene) -> tuple[float, float]:
    """Return the log-likelihood of a sample and the median of Theil's coefficient in the first flight of another scene."""
    window = replace(other.windows[0], flight="held back")
    flights = {window.flight: replace(other.flights[other.windows[0].flight], name=window.flight)}
    model = predictor(done.estimate, done.tested.bars.covariance)
    ahead = predict(model, flights, [window], [expected_biases(done.estimate, window.flight)])
    outputs = done.estimate.problem.layout.vehicle.outputs
    measured = np.concatenate([piece.measured for piece in ahead.prepared.pieces])
    readings = np.concatenate(ahead.readings)
    own = [theil(measured[:, i], readings[:, i]) for i in range(len(outputs))]
    return float(np.mean(ahead.log_likelihood(outputs))), float(np.nanmedian(own))


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return what changes without each decision, by vehicles where it applied."""
    pooled = [one for own in samples.values() for one in own]
    records = [
        {"case": case, **row}
        for case, own in {"every": pooled, **samples}.items()
        for row in _rows([one for one in own if not one["failed"]])
    ]
    every = [row for row in records if row["case"] == "every"]
    single = [row for row in every if " + " not in row["without"]]
    idle = sorted({one.name for one in DECISIONS} - {row["without"] for row in single})
    claims = [_claim(row) for row in single if row["without"] != "all"]
    applied = holds("Every decision applied somewhere", not idle, f"never: {', '.join(idle) or 'none'}")
    return Findings.of("What decisions are worth", [applied, *claims], records, summary=every)


def _rows(results: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the mean difference of each figure without a decision, with its standard error."""
    for name in dict.fromkeys(n for one in results for n in one["without"]):
        both = [(one["default"], one["without"][name]) for one in results if name in one["without"]]
        row: dict[str, Any] = {"without": name, "applied": len(both)}
        for figure in FIGURES:
            pairs = [(a[figure], b.get(figure)) for a, b in both]
            change = np.array([b - a for a, b in pairs if a is not None and b is not None])
            row[figure] = finite_or_none(float(change.mean()) if change.size else np.nan)
            row[f"{figure}_se"] = finite_or_none(_standard_error(change))
        yield {**row, "failed": sum("error" in without for _, without in both)}


def _standard_error(values: FloatArray) -> float:
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else np.nan


def _claim(row: Mapping[str, Any]) -> Claim:
    """Return whether coverage, error or prediction becomes worse without a decision by more than chance."""
    signs = {"coverage": -1.0, "bias": 1.0, "log_likelihood": -1.0, "theil": 1.0}
    worse = [
        figure
        for figure, sign in signs.items()
        if row[figure] is not None
        and row[f"{figure}_se"]
        and sign * row[figure] > SIGNIFICANT * row[f"{figure}_se"]
    ]
    figures = f"worse without it: {', '.join(worse) or 'nothing'}; {row['applied']} vehicles, {row['failed']} failed"
    return holds(f"The decision {row['without']} earns its place", bool(worse or row["failed"]), figures)


EXPERIMENT: Final = study.Verification("decisions", show, runs=10, work="compare", cases=tuple(CASES))
