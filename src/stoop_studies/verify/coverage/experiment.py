"""Coverage of 95 % intervals over simulated flights with unknown initial states and biases."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.base.numbers import finite_or_none
from stoop.parallel import Plan, Run
from stoop.report.sheet import Prose, Section, Table
from stoop.vehicle.builtin import resolve_vehicle
from stoop_studies.findings import Claim, Findings, Results, Setting, holds
from stoop_studies.verify.coverage.cases import CASES, Case, Range
from stoop_studies.verify.coverage.scene import AIRCRAFT, BIASES, DURATION, RATE, STEPS, WRONG, sensor_noise
from stoop_studies.verify.coverage.statistics import Sample, covered, mean_sigma, sample, sharpness
from stoop_studies.verify.steps import inputs_table

WORK: Final = "stoop_studies.verify.coverage.work:cover"
LEAD: Final = f"""\
The twin-boom aircraft flies {len(STEPS)} maneuvers of {DURATION:.0f} s at {RATE:.0f} Hz on all six degrees of \
freedom. Its 32 coefficients are estimated jointly from all twelve channels, from starting values up to \
{100 * WRONG:.0f} % wrong. Each maneuver's nine initial states and {len(BIASES)} sensor biases are unknown and \
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


@dataclass(frozen=True, eq=False)
class Covered:
    """What the flights of one case show; arrays are (k,), by parameter."""

    case: Case
    sample: Sample
    each: FloatArray
    each_plain: FloatArray
    sharp: FloatArray
    sharp_plain: FloatArray

    @property
    def pooled(self) -> float:
        """Coverage over all parameters."""
        return float(self.each.mean())


@dataclass(frozen=True)
class Coverage:
    """Coverage of the error bars."""

    name: str = "coverage"
    runs: int = 400
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan:
        """Return one run per case and seed."""
        runs = (
            Run(key(name, seed), WORK, {"case": name, "seed": seed})
            for seed in setting.seeds
            for name in CASES
        )
        return Plan(self.name, {"experiment": self.name}, tuple(runs))

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        found = {
            name: cover(case, sample([results[key(name, seed)] for seed in setting.seeds]))
            for name, case in CASES.items()
        }
        return Findings(
            "Coverage of nominal 95 % intervals",
            LEAD,
            tuple(claim for c in found.values() for claim in claims(c)),
            (
                Section("Pooled over the parameters", (_summary(found), Prose(WORDS))),
                Section("Each parameter", tuple(_each(c) for c in found.values())),
                Section("What was flown", (inputs_table(STEPS), _noise())),
            ),
            HEAD,
            tuple(row for name, c in found.items() for row in _rows(name, c)),
        )


def key(case: str, seed: int) -> str:
    """Return the name of a run."""
    return f"{case}/{seed:06d}"


def cover(case: Case, found: Sample) -> Covered:
    """Return coverage and sharpness of a sample."""
    return Covered(
        case,
        found,
        covered(found.errors, found.sigma).mean(axis=0),
        covered(found.errors, found.cramer_rao).mean(axis=0),
        sharpness(found, found.sigma),
        sharpness(found, found.cramer_rao),
    )


def claims(found: Covered) -> Iterator[Claim]:
    """Give what is claimed of a case."""
    words, flights = found.case.words, len(found.sample.errors)
    yield holds(
        f"With {words} the coverage pooled over the parameters is {_percent(found.case.pooled)} %",
        _within(found.pooled, found.case.pooled),
        f"{100 * found.pooled:.1f} % of {flights} flights' intervals; "
        f"plain Cramer-Rao {100 * found.each_plain.mean():.1f} %",
    )
    if found.case.each is not None:
        low, high = (int(f(found.each)) for f in (np.argmin, np.argmax))
        yield holds(
            f"With {words} the coverage of each parameter is {_percent(found.case.each)} %",
            all(_within(c, found.case.each) for c in found.each),
            f"{100 * found.each[low]:.1f} % ({found.sample.names[low]}) to {100 * found.each[high]:.1f} % "
            f"({found.sample.names[high]})",
        )


def _within(value: float, span: Range) -> bool:
    return span[0] <= value <= span[1]


def _percent(span: Range) -> str:
    return f"{100 * span[0]:.0f} to {100 * span[1]:.0f}"


def _summary(found: Mapping[str, Covered]) -> Table:
    head = (
        "case", "flights", "pooled, %", "least, %", "most, %", "sharpness", "plain Cramer-Rao, %", "its sharpness", "unfinished",
    )  # fmt: skip
    rows = tuple(
        (
            c.case.words,
            str(len(c.sample.errors)),
            *(f"{100 * v:.1f}" for v in (c.pooled, c.each.min(), c.each.max())),
            f"{c.sharp.mean():.2f}",
            f"{100 * c.each_plain.mean():.1f}",
            f"{c.sharp_plain.mean():.2f}",
            str(c.sample.unfinished),
        )
        for c in found.values()
    )
    return Table("Share of intervals that hold the truth", head, rows)


def _each(found: Covered) -> Table:
    columns = (100 * found.each, found.sharp, 100 * found.each_plain, found.sharp_plain, found.sample.bias)
    rows = tuple(
        (
            name,
            *(
                f"{c[i]:{form}}"
                for c, form in zip(columns, (".1f", ".2f", ".1f", ".2f", "+.1f"), strict=True)
            ),
        )
        for i, name in enumerate(found.sample.names)
    )
    head = (
        "parameter",
        "coverage, %",
        "sharpness",
        "plain Cramer-Rao, %",
        "its sharpness",
        "bias, standard errors",
    )
    return Table(f"With {found.case.words}", head, rows)


def _noise() -> Table:
    vehicle = resolve_vehicle(AIRCRAFT)
    sigma = dict(zip(vehicle.outputs, sensor_noise(vehicle), strict=True))
    rows = tuple((c, f"{s:g}", f"{BIASES[c]:g}" if c in BIASES else "–") for c, s in sigma.items())
    return Table(
        "Standard deviations, SI: of the noise, and of the biases of each maneuver",
        ("channel", "noise", "bias"),
        rows,
    )


def _rows(name: str, found: Covered) -> Iterator[tuple[Cell, ...]]:
    """Give one row per parameter and one for all."""
    s, flights = found.sample, len(found.sample.errors)
    shares = np.column_stack([found.each, found.sharp, found.each_plain, found.sharp_plain])
    sizes = np.column_stack([s.scatter, mean_sigma(s.sigma), s.bias])
    for i, parameter in enumerate(s.names):
        yield (name, parameter, flights, *map(finite_or_none, shares[i]), *map(finite_or_none, sizes[i]))
    yield (name, POOLED, flights, *map(finite_or_none, shares.mean(axis=0)), None, None, None)
