"""What each decision of a fit is worth: estimates, intervals, prediction and time with and without it.

A vehicle is identified with the default decisions, with none, and without each decision that applied; for the first seeds
also without each pair of these. Without a decision that was not needed the fit is the default one, bit for bit, and is not
repeated. Of a real flight one window at a time is held back, and only its prediction is compared.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import t as student

from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.goodness_of_fit import theil
from stoop.base.arrays import FloatArray
from stoop.base.numbers import finite_or_none
from stoop.errors import StoopError
from stoop.estimate.fit import Options
from stoop.prediction.predict import expected_biases, predict, predictor
from stoop.strategy import DECISIONS, Strategy, fit
from stoop.strategy.decision import Fitted
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import decision_fleet, study
from stoop_studies.verify.decision_fleet import CASES, REAL, Posed

DEFAULT: Final = Strategy.default()
BUDGET: Final = 4000.0  #: trajectories of a simulated vehicle; those of the README's fits need 300 to 4,000
PAIR_SEEDS: Final = 1  #: of each case are identified without pairs of decisions too
MIN_VEHICLES: Final = 5  #: on which a claim rests
LEVEL: Final = (
    0.05  #: probability that a decision without effect is said to have one, of its figures together
)
#: figure -> whether more of it is worse (1) or better (-1); 0 where that is no matter of quality
FIGURES: Final[Mapping[str, int]] = {
    "coverage": -1, "bias": 1, "score": -1, "error": 1, "log_likelihood": -1, "theil": 1, "seconds": 0,
}  # fmt: skip
NONE: Final = "all"  #: the name of the fit without any decision
NOT_SHOWN: Final = "not shown"


def strategies(default: Fitted, seed: int) -> Iterator[tuple[str, Strategy]]:
    """Yield no decision, and the default ones without each that applied and without each pair."""
    applied = [one.name for one in default.decisions if one.state == "applied"]
    yield NONE, Strategy.textbook()
    for many in (1, 2) if seed < PAIR_SEEDS else (1,):
        yield from ((" + ".join(names), DEFAULT.without(*names)) for names in combinations(applied, many))


@study.work
def compare(case: str, seed: int, data: str = "") -> dict[str, Any]:
    """Identify a vehicle with and without its decisions; of a real one the window is held back that has the seed's number."""
    if case in REAL:
        if not data or seed >= decision_fleet.folds(case):
            return {"failed": True, "without": {}, "failure": "no such window, or no --data DIR"}
        posed = decision_fleet.pose_real(case, seed, Path(data))
    else:
        posed = decision_fleet.pose(case, seed)
    tried = CASES[case].tried if case in CASES else ()
    default, figures = _identified(posed, DEFAULT, seed)
    if default is None:
        return {"failed": True, "without": {}, **figures}
    without = {name: _identified(posed, own, seed)[1] for name, own in strategies(default, seed)}
    further = {name: _identified(posed, DEFAULT.including(name), seed)[1] for name in tried}
    return {
        "failed": False, "default": figures, "without": without, "further": further, "method": default.options.method,
    }  # fmt: skip


def _identified(posed: Posed, strategy: Strategy, seed: int) -> tuple[Fitted | None, dict[str, Any]]:
    """Return a fit and its `FIGURES`; a fit that fails has none. Seconds are those of the processor."""
    began, options = time.process_time(), Options(seed=seed, budget=BUDGET)
    try:
        done = fit(strategy, posed.start, posed.flights, posed.windows, options=options)
        seconds = time.process_time() - began
        values = (*_accuracy(posed, done), *_prediction(posed, done), seconds)
    except StoopError as error:
        return None, {"failure": str(error)}
    return done, {name: finite_or_none(value) for name, value in zip(FIGURES, values, strict=True)}


def _accuracy(posed: Posed, done: Fitted) -> tuple[float, float, float, float]:
    """Return coverage, rms error in standard errors, mean logarithmic score, and median relative error of the estimates.

    The score is the logarithm of the density that estimate and standard error give the truth, in parts of its size: it rewards
    intervals that are right and narrow. A number without a standard error does not count as covered.
    """
    truth = {n: v for n, v in posed.truth.items() if n in done.estimate.estimates}
    if not truth:
        return (math.nan,) * 4
    found = study.errors_of(done.estimate, truth, done.tested.bars)
    errors, sigma = (np.array(found[key], dtype=np.float64) for key in ("errors", "sigma"))
    size = np.abs(list(truth.values()))
    given = np.isfinite(sigma) & (sigma > 0.0)
    ratio, relative = errors[given] / sigma[given], errors / size
    return (
        float(np.sum(np.abs(ratio) <= NORMAL_95)) / len(errors),
        float(np.sqrt(np.mean(ratio**2))) if ratio.size else np.nan,
        float(np.mean(-0.5 * ratio**2 - np.log(sigma[given] / size[given]))) if ratio.size else np.nan,
        float(np.median(np.abs(relative))),
    )


def _prediction(posed: Posed, done: Fitted) -> tuple[float, float]:
    """Return the log-likelihood of a sample and the median of Theil's coefficient in the window that is held back."""
    treatment = done.options.treatment
    model = predictor(done.estimate, done.tested.bars.covariance, treatment.recorded_motion)
    ahead = predict(model, posed.flights, [posed.ahead], [expected_biases(done.estimate, posed.ahead.flight)])
    outputs = done.estimate.problem.layout.vehicle.outputs
    measured = np.concatenate([piece.measured for piece in ahead.prepared.pieces])
    readings = np.concatenate(ahead.readings)
    own = [
        theil(measured[:, i], readings[:, i])
        for i in range(len(outputs))
        if np.isfinite(measured[:, i]).any()
    ]
    return float(np.mean(ahead.log_likelihood(outputs))), float(np.nanmedian(own))


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return what changes without each decision, by vehicles where it applied; real flights apart."""
    known = {case: [one for one in own if not one["failed"]] for case, own in samples.items()}
    simulated = [one for case in CASES for one in known.get(case, ())]
    real = [one for case in REAL for one in known.get(case, ())]
    groups = {"simulated": simulated, "real": real, **known}
    records = [{"case": case, **row} for case, own in groups.items() for row in _rows(own)]
    every = [row for row in records if row["case"] in ("simulated", "real")]
    single = {
        row["without"]: row for row in every if row["case"] == "simulated" and " + " not in row["without"]
    }
    idle = sorted({one.name for one in DECISIONS} - set(single))
    lost = sum(one["failed"] for case in CASES for one in samples.get(case, ()))
    counted = f"{len(simulated)} simulated vehicles ({lost} failed) and {len(real)} windows of real flights held back"
    claims = [
        holds("Every decision applied somewhere", not idle, f"never: {', '.join(idle) or 'none'}; {counted}"),
        *(_claim(single[one.name]) for one in DECISIONS if one.name in single),
    ]
    pairs = list(_together(simulated))
    return Findings.of(
        "What decisions are worth",
        claims,
        records or [{"case": "none"}],
        parts={"pairs": pairs},
        summary=every,
    )


def _rows(results: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the mean difference of each figure without a decision, with its standard error."""
    compared = [_pairs(one) for one in results]
    for name in dict.fromkeys(n for one in compared for n in one):
        both = [one[name] for one in compared if name in one]
        row: dict[str, Any] = {"without": name, "vehicles": len(both)}
        for figure in FIGURES:
            change = _changes(figure, both)
            row[figure] = finite_or_none(float(change.mean()) if change.size else np.nan)
            row[f"{figure}_se"] = finite_or_none(_standard_error(change))
            row[f"{figure}_n"] = int(change.size)
        yield {**row, "failed": sum("failure" in without for _, without in both)}


def _pairs(record: Mapping[str, Any]) -> dict[str, tuple[Mapping[str, Any], Mapping[str, Any]]]:
    """Return the figures with and without each decision."""
    usual = record["default"]
    without = {name: (usual, own) for name, own in record["without"].items()}
    return without | {name: (own, usual) for name, own in record.get("further", {}).items()}


def _changes(figure: str, both: Iterable[tuple[Mapping[str, Any], Mapping[str, Any]]]) -> FloatArray:
    """Return the differences of a figure without a decision, of vehicles for which both are known."""
    pairs = [(a.get(figure), b.get(figure)) for a, b in both]
    return np.array([b - a for a, b in pairs if a is not None and b is not None])


def _standard_error(values: FloatArray) -> float:
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else np.nan


def _significant(row: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Return which figures are worse and better without a decision, by Student's t at `LEVEL` for all its figures."""
    quality = {figure: sign for figure, sign in FIGURES.items() if sign}
    worse, better = list[str](), list[str]()
    for figure, sign in quality.items():
        mean, se, n = (row[f"{figure}{end}"] for end in ("", "_se", "_n"))
        if n < MIN_VEHICLES or se is None:
            continue
        limit = float(student.ppf(1.0 - LEVEL / len(quality) / 2.0, n - 1))
        if abs(mean) > limit * se:
            (worse if sign * mean > 0.0 else better).append(f"{figure} {mean:+.3g} ± {se:.2g}")
    return worse, better


def _claim(row: Mapping[str, Any]) -> Claim:
    """Return whether estimates or predictions become worse without a decision by more than chance."""
    statement = f"The decision {row['without']} improves estimates or predictions"
    worse, better = _significant(row)
    figures = f"worse without it: {', '.join(worse) or 'nothing'}; better: {', '.join(better) or 'nothing'}"
    figures = (
        f"{figures}; {row['vehicles']} vehicles, {row['failed']} of them cannot be identified without it"
    )
    if row["vehicles"] < MIN_VEHICLES:
        return Claim(statement, NOT_SHOWN, f"{row['vehicles']} vehicles; {MIN_VEHICLES} are needed")
    if worse or row["failed"] >= MIN_VEHICLES:
        return holds(statement, so=True, figures=figures)
    return Claim(statement, "does not hold" if better else NOT_SHOWN, figures)


def _together(results: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield by how much a figure changes without two decisions beyond the sum of the changes without either."""
    names = dict.fromkeys(n for one in results for n in one["without"] if " + " in n)
    for name in names:
        first, second = name.split(" + ")
        own = [one for one in results if name in one["without"]]
        row: dict[str, Any] = {"pair": name, "vehicles": len(own)}
        for figure in FIGURES:
            values = [
                [
                    figures.get(figure)
                    for figures in (one["default"], *(one["without"][n] for n in (first, second, name)))
                ]
                for one in own
            ]
            known = np.array([v for v in values if None not in v], dtype=np.float64).reshape(-1, 4)
            change = known[:, 3] - known[:, 1] - known[:, 2] + known[:, 0]
            row[figure] = finite_or_none(float(change.mean()) if change.size else np.nan)
            row[f"{figure}_se"] = finite_or_none(_standard_error(change))
        yield row


EXPERIMENT: Final = study.Verification(
    "decisions", show, runs=6, work="compare", cases=(*CASES, *REAL), parts=("pairs",), reads_data=True
)
