"""Coverage of 95 % intervals over simulated flights with unknown initial states and biases."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.assess.covariance import NORMAL_95
from stoop.assess.error_bars import error_bars
from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.base.numbers import finite_or_none
from stoop.estimate import methods
from stoop.estimate.fit import Options
from stoop.report.sheet import Prose, Section, Table
from stoop.vehicle.builtin import resolve_vehicle
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify.experiment import Samples, Verification, or_none, work
from stoop_studies.verify.scenes import (
    AIRCRAFT,
    BIASES,
    DURATION,
    RATE,
    START_ERROR,
    STEPS,
    Scene,
    in_autoregressive_noise,
    in_dryden_turbulence,
    in_white_noise,
    inputs_table,
    sensor_noise,
)

LEAD: Final = f"""\
The twin-boom aircraft flies {len(STEPS)} maneuvers of {DURATION:.0f} s at {RATE:.0f} Hz on all six degrees of \
freedom. Its 32 coefficients are estimated jointly from all twelve channels, from starting values up to \
{100 * START_ERROR:.0f} % wrong. Each maneuver's nine initial states and {len(BIASES)} sensor biases are unknown and \
estimated, and so is the covariance of the noise; in turbulence so are the intensities of the gusts. Each seed draws \
biases, noise and starting values. The intervals are those that stoop identify publishes."""
WORDS: Final = """\
Coverage is the share of flights in which estimate ± 1.96 standard errors holds the truth. Sharpness is the mean \
standard error over the true scatter (root-mean-square error): 1 is as it should be; an interval that is wide \
enough to hold everything is worth little. Plain Cramer-Rao, beside, takes residuals as white."""
HEAD: Final = (
    "case", "parameter", "flights", "coverage", "sharpness", "coverage_cramer_rao", "sharpness_cramer_rao", "scatter",
    "mean_sigma", "bias_in_standard_errors",
)  # fmt: skip
POOLED: Final = "pooled"
Range = tuple[float, float]


@dataclass(frozen=True)
class Case:
    """One line of the table.

    Attributes
    ----------
    words : str
        What the residuals are.
    fly : callable
        From a seed to a `Scene`.
    method : str
        Of `stoop.estimate.methods`.
    pooled, each : (low, high)
        Where the coverage over all parameters must lie, and that of each; `each` is None where nothing is asked.
    """

    words: str
    fly: Callable[[int], Scene]
    method: str
    pooled: Range
    each: Range | None = None


CASES: Final[Mapping[str, Case]] = {
    "white": Case("white sensor noise", in_white_noise, "output-error", (0.93, 0.97), (0.91, 0.98)),
    "ar1": Case(
        "AR(1) sensor noise, coefficient 0.95", in_autoregressive_noise, "output-error", (0.90, 0.98)
    ),
    "dryden": Case(
        "Dryden turbulence (MIL-F-8785C, moderate) and white sensor noise",
        in_dryden_turbulence,
        "filter-error",
        (0.90, 0.98),
    ),
}


@work
def cover(name: str, seed: int) -> dict[str, Any]:
    """Fly a case and identify it as users do.

    Returns
    -------
    dict
        ``errors`` (estimate less truth), ``sigma`` and ``cramer_rao`` (standard errors; None where a bound holds the
        parameter) by the order of ``names``, and ``status`` of the search.
    """
    case = CASES[name]
    scene, options = case.fly(seed), Options(seed=seed, method=case.method)
    fit = methods.find(case.method).fitter()(scene.start, scene.flights, scene.windows, options, None, None)
    bars, count = error_bars(fit), len(scene.truth)
    at_bound = bars.at_bound[:count]
    return {
        "names": list(scene.truth),
        "errors": [fit.estimates[name] - value for name, value in scene.truth.items()],
        "sigma": or_none(np.where(at_bound, np.nan, bars.std[:count])),
        "cramer_rao": or_none(np.where(at_bound, np.nan, bars.cramer_rao_std[:count])),
        "status": fit.outcome.status,
    }


class Covered:
    """What the flights of one case show; statistics are (k,), by parameter.

    Parameters
    ----------
    case : Case
    results : sequence
        Of `cover`, one per flight.
    """

    def __init__(self, case: Case, results: Sequence[Mapping[str, Any]]) -> None:
        self.case, self.flights = case, len(results)
        self.names: tuple[str, ...] = tuple(results[0]["names"])
        errors, sigma, plain = (
            np.array([r[key] for r in results], dtype=np.float64) for key in ("errors", "sigma", "cramer_rao")
        )
        self.unfinished = sum(r["status"] not in ("converged", "target") for r in results)
        self.scatter = np.asarray(np.sqrt(np.mean(errors**2, axis=0)))
        self.bias = errors.mean(axis=0) / (errors.std(axis=0) / np.sqrt(len(errors)))
        self.mean_sigma = _mean_sigma(sigma)
        self.each, self.each_plain = _coverage(errors, sigma), _coverage(errors, plain)
        self.sharp, self.sharp_plain = self.mean_sigma / self.scatter, _mean_sigma(plain) / self.scatter
        self.pooled = float(self.each.mean())


def _coverage(errors: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the share (k,) of 95 % intervals (n, k) that hold the truth; one that is not given holds nothing."""
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(errors) <= NORMAL_95 * sigma).mean(axis=0))


def _mean_sigma(sigma: FloatArray) -> FloatArray:
    """Return the mean (k,) of those standard errors (n, k) that are given; NaN where none is."""
    given = np.isfinite(sigma)
    counts = given.sum(axis=0)
    total = np.where(given, sigma, 0.0).sum(axis=0)
    return np.where(counts > 0, total / np.maximum(counts, 1), np.nan)


def show(setting: Setting, samples: Samples) -> Findings:
    """Return the coverage of each case."""
    found = {name: Covered(case, samples[name]) for name, case in CASES.items()}
    return Findings(
        "Coverage of nominal 95 % intervals",
        LEAD,
        tuple(claim for c in found.values() for claim in _claims(c)),
        (
            Section("Pooled over the parameters", (_summary(found), Prose(WORDS))),
            Section("Each parameter", tuple(_each(c) for c in found.values())),
            Section("What was flown", (inputs_table(STEPS), _noise())),
        ),
        HEAD,
        tuple(row for name, c in found.items() for row in _rows(name, c)),
    )


def _claims(found: Covered) -> Iterator[Claim]:
    words, (low, high) = found.case.words, found.case.pooled
    yield holds(
        f"With {words} the coverage pooled over the parameters is {_percent(found.case.pooled)} %",
        low <= found.pooled <= high,
        f"{100 * found.pooled:.1f} % of {found.flights} flights' intervals; "
        f"plain Cramer-Rao {100 * found.each_plain.mean():.1f} %",
    )
    if found.case.each is not None:
        low, high = found.case.each
        least, most = int(np.argmin(found.each)), int(np.argmax(found.each))
        yield holds(
            f"With {words} the coverage of each parameter is {_percent(found.case.each)} %",
            bool(np.all((low <= found.each) & (found.each <= high))),
            f"{100 * found.each[least]:.1f} % ({found.names[least]}) to {100 * found.each[most]:.1f} % "
            f"({found.names[most]})",
        )


def _percent(span: Range) -> str:
    return f"{100 * span[0]:.0f} to {100 * span[1]:.0f}"


def _summary(found: Mapping[str, Covered]) -> Table:
    head = (
        "case", "flights", "pooled, %", "least, %", "most, %", "sharpness", "plain Cramer-Rao, %", "its sharpness", "unfinished",
    )  # fmt: skip
    rows = tuple(
        (
            c.case.words, str(c.flights), *(f"{100 * v:.1f}" for v in (c.pooled, c.each.min(), c.each.max())),
            f"{c.sharp.mean():.2f}", f"{100 * c.each_plain.mean():.1f}", f"{c.sharp_plain.mean():.2f}", str(c.unfinished),
        )
        for c in found.values()
    )  # fmt: skip
    return Table("Share of intervals that hold the truth", head, rows)


def _each(c: Covered) -> Table:
    head = (
        "parameter", "coverage, %", "sharpness", "plain Cramer-Rao, %", "its sharpness", "bias, standard errors",
    )  # fmt: skip
    columns = zip(c.names, c.each, c.sharp, c.each_plain, c.sharp_plain, c.bias, strict=True)
    rows = tuple(
        (
            name,
            f"{100 * each:.1f}",
            f"{sharp:.2f}",
            f"{100 * plain:.1f}",
            f"{sharp_plain:.2f}",
            f"{bias:+.1f}",
        )
        for name, each, sharp, plain, sharp_plain, bias in columns
    )
    return Table(f"With {c.case.words}", head, rows)


def _noise() -> Table:
    vehicle = resolve_vehicle(AIRCRAFT)
    sigma = dict(zip(vehicle.outputs, sensor_noise(vehicle), strict=True))
    rows = tuple((c, f"{s:g}", f"{BIASES[c]:g}" if c in BIASES else "–") for c, s in sigma.items())
    caption = "Standard deviations, SI: of the noise, and of the biases of each maneuver"
    return Table(caption, ("channel", "noise", "bias"), rows)


def _rows(name: str, c: Covered) -> Iterator[tuple[Cell, ...]]:
    """Give one row per parameter and one for all."""
    shares = np.column_stack([c.each, c.sharp, c.each_plain, c.sharp_plain])
    sizes = np.column_stack([c.scatter, c.mean_sigma, c.bias])
    for i, parameter in enumerate(c.names):
        yield (name, parameter, c.flights, *map(finite_or_none, (*shares[i], *sizes[i])))
    yield (name, POOLED, c.flights, *map(finite_or_none, shares.mean(axis=0)), None, None, None)


EXPERIMENT: Final = Verification(
    "coverage", show, runs=400, work="stoop_studies.verify.coverage:cover", cases=tuple(CASES)
)
