"""Coverage of 95 % intervals over simulated flights with unknown initial states and biases."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from stoop.base.arrays import FloatArray
from stoop.base.numbers import finite_or_none
from stoop.estimate.fit import Options
from stoop.strategy import fit
from stoop_plan.input_design.quick_fit import FIT_ALONE
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import scenes, study

SHARES: Final = ("coverage", "sharpness", "coverage_cramer_rao", "sharpness_cramer_rao")
SIZES: Final = ("scatter", "mean_sigma", "bias_in_standard_errors")
POOLED: Final = "pooled"
Range = tuple[float, float]


@dataclass(frozen=True)
class Case:
    """Flights with one kind of residuals, and where their coverage must lie.

    ``fly`` turns a seed into a `Scene`; ``pooled`` is the range over all parameters, ``each`` that of every one (None:
    nothing is asked). Over that of the case ``beside``, with the same seeds, the scatter is at most ``scatter``, the geometric
    mean over the parameters.
    """

    words: str
    fly: Callable[[int], scenes.Scene]
    pooled: Range = (0.93, 0.97)
    each: Range | None = None
    beside: str = ""
    scatter: float = np.inf
    method: str = "output-error"


_OUTLIERS: Final = "{:.0%} of the readings {:.0f} times as wide".format(*scenes.OUTLIERS).replace("%", " %")
_SPIKES: Final = (
    f"{scenes.SPIKES[1]:.0f} standard deviations in {100 * scenes.SPIKES[0]:.1f} % of the readings"
)
_DRYDEN: Final = "Dryden turbulence (MIL-F-8785C, moderate) and white sensor noise"
_UNEQUAL: Final = "the maneuver {} {:.0f} times as noisy".format(*scenes.NOISY)
CASES: Final[Mapping[str, Case]] = {
    "white": Case("white sensor noise", scenes.in_white_noise, each=(0.91, 0.98)),
    "ar1": Case("AR(1) sensor noise, coefficient 0.95", scenes.in_autoregressive_noise, (0.90, 0.98)),
    "dryden": Case(_DRYDEN, scenes.in_dryden_turbulence, (0.90, 0.98), method="filter-error"),
    "outliers": Case(f"outliers, {_OUTLIERS}", scenes.in_outliers, beside="white", scatter=1.1),
    "spikes": Case(f"spikes of {_SPIKES}", scenes.in_spikes, beside="white", scatter=1.1),
    "student": Case(
        f"Student's t of {scenes.STUDENT} degrees of freedom", scenes.in_student_noise, beside="white"
    ),
    "left-out": Case(
        f"white noise and the maneuver {scenes.NOISY[0]} left out", scenes.without_noisy_maneuver
    ),
    "unequal": Case(_UNEQUAL, scenes.in_unequal_noise, beside="left-out", scatter=1.0),
    "late": Case(
        f"both vanes {1000 * scenes.LATE:.0f} ms late, which the file does not say", scenes.with_late_vanes
    ),
}


#: of a named method and a complete vehicle, with bounds that no estimate reaches
DECISIONS = FIT_ALONE.without("method", "instability", "gusts", "bounds").including("sensor-delays")


@study.work
def cover(case: str, seed: int) -> dict[str, Any]:
    """Fly a case and identify it as users do; a standard error is None where a bound holds the parameter."""
    method = CASES[case].method
    scene, options = CASES[case].fly(seed), Options(seed=seed, method=method)
    done = fit(DECISIONS, scene.start, scene.flights, scene.windows, options=options)
    bars = done.tested.bars
    return study.errors_of(done.estimate, scene.truth, bars, cramer_rao=bars.cramer_rao_std)


def statistics(results: Sequence[Mapping[str, Any]]) -> dict[str, FloatArray]:
    """Return `SHARES` and `SIZES` (k,) by parameter; an interval that is not given does not hold the truth."""
    scatter, mean, coverage, bias = study.error_statistics(results)
    _, plain_mean, plain_coverage, _ = study.error_statistics(results, "cramer_rao")
    found = (coverage, mean / scatter, plain_coverage, plain_mean / scatter, scatter, mean, bias)
    return dict(zip((*SHARES, *SIZES), found, strict=True))


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return the coverage of each case."""
    claims, summary, records = list[Claim](), list[dict[str, Any]](), dict[str, list[dict[str, Any]]]()
    for key, case in CASES.items():
        results, found = samples[key], statistics(samples[key])
        names, ratio = results[0]["names"], None
        claims += _claims(case, len(results), names, found)
        if case.beside:
            ratios = found["scatter"] / statistics(samples[case.beside])["scatter"]
            ratio = float(np.exp(np.mean(np.log(ratios))))
            claims += _scatter_claim(case, ratio, float(ratios.max()), names[int(ratios.argmax())])
        common = {"case": key, "flights": len(results)}
        pooled = {name: finite_or_none(found[name].mean()) for name in SHARES}
        records[key] = study.records_of(pd.DataFrame({"case": key, "parameter": names, **common, **found}))
        records[key].append({**dict.fromkeys(records[key][0]), **common, "parameter": POOLED, **pooled})
        extremes = {"least": found["coverage"].min(), "most": found["coverage"].max(), "ratio": ratio}
        summary.append(
            {**common, **pooled, **extremes, "case": case.words, "unfinished": study.unfinished(results)}
        )
    rows = [record for own in records.values() for record in own]
    return Findings.of("Coverage of nominal 95 % intervals", claims, rows, summary=summary)


def _claims(
    case: Case, flights: int, names: Sequence[str], found: Mapping[str, FloatArray]
) -> Iterator[Claim]:
    each, plain = found["coverage"], found["coverage_cramer_rao"]
    yield study.within(
        f"With {case.words} the coverage pooled over the parameters is",
        case.pooled,
        float(each.mean()),
        f"of {flights} flights' intervals; plain Cramer-Rao {100 * plain.mean():.1f} %",
    )
    if case.each is not None:
        low, high = case.each
        least, most = int(np.argmin(each)), int(np.argmax(each))
        yield holds(
            f"With {case.words} the coverage of each parameter is {100 * low:.0f} to {100 * high:.0f} %",
            bool(np.all((low <= each) & (each <= high))),
            f"{100 * each[least]:.1f} % ({names[least]}) to {100 * each[most]:.1f} % ({names[most]})",
        )


def _scatter_claim(case: Case, ratio: float, largest: float, name: str) -> Iterator[Claim]:
    if np.isfinite(case.scatter):
        yield holds(
            f"With {case.words} estimates scatter at most {case.scatter:g} times as with {CASES[case.beside].words}",
            ratio <= case.scatter,
            f"{ratio:.2f} times, the geometric mean over the parameters; at most {largest:.2f} ({name})",
        )


EXPERIMENT: Final = study.Verification("coverage", show, runs=400, work="cover", cases=tuple(CASES))
