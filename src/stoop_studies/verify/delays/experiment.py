"""Delays recovered, in samples: of controls and sensors with the model, of sensors in a compatibility check."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.assess.covariance import NORMAL_95
from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.parallel import Plan, Run
from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, holds
from stoop_studies.verify.delays.scene import DURATION, LONG, MOST, NOISE, RATE, STEPS, STEPS_EACH
from stoop_studies.verify.steps import inputs_table

WITHIN: Final = 0.1  #: samples
COVERED: Final = (0.90, 0.99)
WORKS: Final = {
    "identify": "stoop_studies.verify.delays.work:identified",
    "compatibility": "stoop_studies.verify.delays.work:checked",
}
WORDS: Final = {
    "identify": "with the model: controls and sensors, beside 32 coefficients, initial states and biases",
    "compatibility": "in a compatibility check: sensors, beside biases, scales, positions and wind",
}
LEAD: Final = f"""\
The twin-boom aircraft is simulated at {RATE * STEPS_EACH:.0f} Hz and recorded at {RATE:.0f} Hz; each delay is drawn as a \
whole number of steps of the simulation, {1.0 / STEPS_EACH:g} sample each, up to {MOST / STEPS_EACH:g} samples \
({LONG / STEPS_EACH:g} for velocity and position). The interpolation by which stoop shifts signals has no part in the data. \
Each maneuver lasts {DURATION:.0f} s; white noise of the stated size is added to every channel."""
READ: Final = """\
An error is estimate less truth, in samples. Coverage is the share of flights in which estimate ± 1.96 standard errors \
holds the truth. Surfaces move at 1 rad/s: a command that jumps between two samples does not say when, and a zero-order \
hold adds half of its period to the delay that is found."""
HEAD: Final = ("case", "delay", "flights", "rms_error", "largest_error", "mean_sigma", "coverage")


@dataclass(frozen=True, eq=False)
class Recovered:
    """Delays of one case, in samples: names (k,), errors and standard errors (n, k)."""

    names: tuple[str, ...]
    errors: FloatArray
    sigma: FloatArray
    unfinished: int

    @property
    def rms(self) -> FloatArray:
        """Root-mean-square error (k,)."""
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=0)))

    @property
    def coverage(self) -> FloatArray:
        """Share (k,) of 95 % intervals that hold the truth."""
        return np.asarray(np.mean(np.abs(self.errors) < NORMAL_95 * self.sigma, axis=0))


def recovered(results: Sequence[Mapping[str, Any]]) -> Recovered:
    """Collect the flights of one case."""
    sigma = [[np.nan if s is None else s for s in r["sigma"]] for r in results]
    lost = sum(r["status"] != "converged" for r in results)
    return Recovered(
        tuple(results[0]["names"]), np.array([r["errors"] for r in results]), np.array(sigma), lost
    )


@dataclass(frozen=True)
class Delays:
    """Recovery of delays."""

    name: str = "delays"
    runs: int = 40
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan:
        """Return one run per case and seed."""
        runs = (
            Run(key(case, seed), work, {"seed": seed})
            for case, work in WORKS.items()
            for seed in setting.seeds
        )
        return Plan(self.name, {"experiment": self.name}, tuple(runs))

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        found = {case: recovered([results[key(case, s)] for s in setting.seeds]) for case in WORKS}
        return Findings(
            "Delays of inputs and outputs, fractions of a sample included",
            LEAD,
            tuple(claim for case, one in found.items() for claim in claims(case, one)),
            (
                Section(
                    "Errors in samples", (*(_table(case, one) for case, one in found.items()), Prose(READ))
                ),
                Section("What was flown", (inputs_table(STEPS), _noise())),
            ),
            HEAD,
            tuple(row for case, one in found.items() for row in _rows(case, one)),
        )


def key(case: str, seed: int) -> str:
    """Return the name of a run."""
    return f"{case}/{seed:06d}"


def claims(case: str, found: Recovered) -> Iterator[Claim]:
    """Give what is claimed of a case: the model tells all delays, a compatibility check as well as it says."""
    flights = f"over {len(found.errors)} flights, {found.unfinished} not finished"
    if case == "identify":
        worst = int(np.argmax(found.rms))
        inside = float(np.mean(np.abs(found.errors) < WITHIN))
        yield holds(
            f"Delays are recovered within {WITHIN:g} sample (root mean square of each), {WORDS[case]}",
            bool(found.rms[worst] < WITHIN),
            f"{100 * inside:.1f} % of {found.errors.size} errors are within; the largest root mean square is "
            f"{found.rms[worst]:.3f} ({found.names[worst]}), {flights}",
        )
    pooled = float(found.coverage.mean())
    yield holds(
        f"95 % intervals of delays hold the truth in {100 * COVERED[0]:.0f} to {100 * COVERED[1]:.0f} %, {WORDS[case]}",
        COVERED[0] <= pooled <= COVERED[1],
        f"{100 * pooled:.1f} % of all; mean standard errors from {found.sigma.mean(axis=0).min():.3f} to "
        f"{found.sigma.mean(axis=0).max():.3f} sample, {flights}",
    )


def _table(case: str, found: Recovered) -> Table:
    rows = tuple(
        (name, f"{rms:.3f}", f"{most:.3f}", f"{sigma:.3f}", f"{100 * share:.0f}")
        for name, rms, most, sigma, share in _figures(found)
    )
    return Table(WORDS[case], ("delay", "rms error", "largest", "mean standard error", "coverage, %"), rows)


def _figures(found: Recovered) -> Iterator[tuple[str, float, float, float, float]]:
    columns = (found.rms, np.max(np.abs(found.errors), axis=0), np.mean(found.sigma, axis=0), found.coverage)
    for i, name in enumerate(found.names):
        rms, most, sigma, share = (float(column[i]) for column in columns)
        yield name, rms, most, sigma, share


def _noise() -> Table:
    rows = tuple((channel, f"{sigma:g}") for channel, sigma in NOISE.items())
    return Table("Standard deviation of the noise, SI", ("channel", "noise"), rows)


def _rows(case: str, found: Recovered) -> Iterator[tuple[Cell, ...]]:
    for name, *figures in _figures(found):
        yield (case, name, len(found.errors), *figures)
