"""Coverage of 95 % intervals over simulated flights with unknown initial states and biases."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from stoop.base.arrays import FloatArray
from stoop.base.numbers import finite_or_none
from stoop.estimate import methods
from stoop.estimate.fit import Fit, Options
from stoop.report.sheet import Prose, Section, Table
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.sensor_delays import with_sensor_delays
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import scenes, study

LEAD: Final = f"""\
The twin-boom aircraft flies {len(scenes.STEPS)} maneuvers of {scenes.DURATION:.0f} s at {scenes.RATE:.0f} Hz on all six degrees \
of freedom. Its 32 coefficients are estimated jointly from all twelve channels, from starting values up to \
{100 * scenes.START_ERROR:.0f} % wrong. Each maneuver's nine initial states and {len(scenes.BIASES)} sensor biases are unknown \
and estimated, and so is the covariance of the noise; in turbulence so are the intensities of the gusts. Each seed draws \
biases, noise and starting values. The intervals are those that stoop identify publishes."""
WORDS: Final = """\
Coverage is the share of flights in which estimate ± 1.96 standard errors holds the truth. Sharpness is the mean \
standard error over the true scatter (root-mean-square error): 1 is as it should be; an interval that is wide \
enough to hold everything is worth little. Plain Cramer-Rao, beside, takes residuals as white. Scatter beside is the scatter \
over that of white noise with the same seeds (for the noisy maneuver over that without it), the geometric mean of the \
parameters."""
SHARES: Final = ("coverage", "sharpness", "coverage_cramer_rao", "sharpness_cramer_rao")
SIZES: Final = ("scatter", "mean_sigma", "bias_in_standard_errors")
POOLED: Final = "pooled"
BESIDE: Final[study.Columns] = {
    "sharpness": ("sharpness", ".2f"),
    "coverage_cramer_rao": ("plain Cramer-Rao, %", study.percent),
    "sharpness_cramer_rao": ("its sharpness", ".2f"),
}
SUMMARY: Final[study.Columns] = {
    "case": ("case", str),
    "flights": ("flights", "d"),
    "coverage": ("pooled, %", study.percent),
    "least": ("least, %", study.percent),
    "most": ("most, %", study.percent),
    **BESIDE,
    "ratio": ("scatter beside", ".2f"),
    "unfinished": ("unfinished", "d"),
}
PARAMETERS: Final[study.Columns] = {
    "parameter": ("parameter", str),
    "coverage": ("coverage, %", study.percent),
    **BESIDE,
    "bias_in_standard_errors": ("bias, standard errors", "+.1f"),
}
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
    method: str
    pooled: Range
    each: Range | None = None
    beside: str = ""
    scatter: float = np.inf


CASES: Final[Mapping[str, Case]] = {
    "white": Case("white sensor noise", scenes.in_white_noise, "output-error", (0.93, 0.97), (0.91, 0.98)),
    "ar1": Case(
        "AR(1) sensor noise, coefficient 0.95", scenes.in_autoregressive_noise, "output-error", (0.90, 0.98)
    ),
    "dryden": Case(
        "Dryden turbulence (MIL-F-8785C, moderate) and white sensor noise",
        scenes.in_dryden_turbulence,
        "filter-error",
        (0.90, 0.98),
    ),
    "outliers": Case(
        f"outliers, {100 * scenes.OUTLIERS[0]:.0f} % of the readings {scenes.OUTLIERS[1]:.0f} times as wide",
        scenes.in_outliers,
        "output-error",
        (0.93, 0.97),
        beside="white",
        scatter=1.1,
    ),
    "spikes": Case(
        f"spikes of {scenes.SPIKES[1]:.0f} standard deviations in {100 * scenes.SPIKES[0]:.1f} % of the readings",
        scenes.in_spikes,
        "output-error",
        (0.93, 0.97),
        beside="white",
        scatter=1.1,
    ),
    "student": Case(
        f"Student's t of {scenes.STUDENT} degrees of freedom",
        scenes.in_student_noise,
        "output-error",
        (0.93, 0.97),
        beside="white",
    ),
    "left-out": Case(
        f"white noise and the maneuver {scenes.NOISY[0]} left out",
        scenes.without_noisy_maneuver,
        "output-error",
        (0.93, 0.97),
    ),
    "unequal": Case(
        "the maneuver {} {:.0f} times as noisy".format(*scenes.NOISY),
        scenes.in_unequal_noise,
        "output-error",
        (0.93, 0.97),
        beside="left-out",
        scatter=1.0,
    ),
    "late": Case(
        f"both vanes {1000.0 * scenes.LATE:.0f} ms late, which the file does not say",
        scenes.with_late_vanes,
        "output-error",
        (0.93, 0.97),
    ),
}


@study.work
def cover(case: str, seed: int) -> dict[str, Any]:
    """Fly a case and identify it as users do; a standard error is None where a bound holds the parameter."""
    method = CASES[case].method
    scene, options = CASES[case].fly(seed), Options(seed=seed, method=method)

    def fitted(vehicle: Vehicle) -> Fit:
        found: Fit = methods.find(method).fitter()(vehicle, scene.flights, scene.windows, options, None, None)
        return found

    done = with_sensor_delays(scene.start, fitted(scene.start), fitted, lambda _: None)
    fit, bars = done.fit, done.bars
    order = {p.name: i for i, p in enumerate(fit.problem.layout.parameters)}
    own = [order[name] for name in scene.truth]
    at_bound = bars.at_bound[own]
    return {
        "names": list(scene.truth),
        "errors": [fit.estimates[name] - value for name, value in scene.truth.items()],
        "sigma": study.or_none(np.where(at_bound, np.nan, bars.std[own])),
        "cramer_rao": study.or_none(np.where(at_bound, np.nan, bars.cramer_rao_std[own])),
        "status": fit.outcome.status,
    }


def statistics(results: Sequence[Mapping[str, Any]]) -> dict[str, FloatArray]:
    """Return `SHARES` and `SIZES` (k,) by parameter; an interval that is not given does not hold the truth."""
    scatter, mean, coverage, bias = study.error_statistics(results)
    _, plain_mean, plain_coverage, _ = study.error_statistics(results, "cramer_rao")
    found = (coverage, mean / scatter, plain_coverage, plain_mean / scatter, scatter, mean, bias)
    return dict(zip((*SHARES, *SIZES), found, strict=True))


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return the coverage of each case."""
    claims: list[Claim] = []
    records: dict[str, list[dict[str, Any]]] = {}
    summary = []
    for key, case in CASES.items():
        results, found = samples[key], statistics(samples[key])
        names = results[0]["names"]
        claims += _claims(case, len(results), names, found)
        ratio = None
        if case.beside:
            ratios = found["scatter"] / statistics(samples[case.beside])["scatter"]
            ratio = float(np.exp(np.mean(np.log(ratios))))
            claims += _scatter_claim(case, ratio, float(ratios.max()), names[int(ratios.argmax())])
        common = {"case": key, "flights": len(results)}
        pooled = {name: finite_or_none(found[name].mean()) for name in SHARES}
        records[key] = study.records_of(pd.DataFrame({"case": key, "parameter": names, **common, **found}))
        records[key].append({**dict.fromkeys(records[key][0]), **common, "parameter": POOLED, **pooled})
        unfinished = sum(r["status"] not in ("converged", "target") for r in results)
        extremes = {"least": found["coverage"].min(), "most": found["coverage"].max()}
        more = {"case": case.words, "ratio": ratio, "unfinished": unfinished}
        summary.append({**common, **pooled, **extremes, **more})
    each = tuple(
        study.page_table(f"With {CASES[k].words}", PARAMETERS, own[:-1]) for k, own in records.items()
    )
    caption = "Share of intervals that hold the truth"
    return Findings.tabulated(
        "Coverage of nominal 95 % intervals",
        LEAD,
        claims,
        (
            Section(
                "Pooled over the parameters", (study.page_table(caption, SUMMARY, summary), Prose(WORDS))
            ),
            Section("Each parameter", each),
            Section("What was flown", (scenes.inputs_table(scenes.STEPS), _noise())),
        ),
        [record for own in records.values() for record in own],
    )


def _claims(
    case: Case, flights: int, names: Sequence[str], found: Mapping[str, FloatArray]
) -> Iterator[Claim]:
    each, plain = found["coverage"], found["coverage_cramer_rao"]
    low, high = case.pooled
    yield holds(
        f"With {case.words} the coverage pooled over the parameters is {100 * low:.0f} to {100 * high:.0f} %",
        low <= float(each.mean()) <= high,
        f"{100 * each.mean():.1f} % of {flights} flights' intervals; plain Cramer-Rao {100 * plain.mean():.1f} %",
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


def _noise() -> Table:
    vehicle = resolve_vehicle(scenes.AIRCRAFT)
    noise = zip(vehicle.outputs, scenes.sensor_noise(vehicle), strict=True)
    records = [{"channel": c, "noise": s, "bias": scenes.BIASES.get(c)} for c, s in noise]
    columns: study.Columns = {"channel": ("channel", str), "noise": ("noise", "g"), "bias": ("bias", "g")}
    return study.page_table(
        "Standard deviations, SI: of the noise, and of the biases of each maneuver", columns, records
    )


EXPERIMENT: Final = study.Verification("coverage", show, runs=400, work="cover", cases=tuple(CASES))
