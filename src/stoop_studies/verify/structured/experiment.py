"""In how many aircraft exactly the true set of terms is found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from stoop.base.csv_text import Cell
from stoop.parallel import Plan, Run
from stoop.report.sheet import Prose, Section, Table
from stoop.vehicle import Vehicle
from stoop_studies.findings import Findings, Results, Setting, counted, holds
from stoop_studies.verify.structured.scene import (
    ALWAYS,
    AMPLITUDES,
    BAND,
    CHANCE,
    CRITERIA,
    DURATION,
    FLIGHTS,
    OCCASIONAL,
    RATE,
    SPREAD,
    everything,
)

WORK: Final = "stoop_studies.verify.structured.scene:found"
DEFAULT: Final = "f"
ENOUGH: Final = 0.9
HEAD: Final = (
    "criterion",
    "coefficient",
    "candidates",
    "aircraft",
    "exact",
    "missing_a_true_term",
    "with_a_false_term",
)
NAMES: Final = {
    "f": "stepwise, partial F",
    "press": "stepwise, PRESS",
    "pse": "orthogonal functions, PSE",
}
LEAD: Final = """\
Every aircraft is the twin-boom one with other terms: those of a conventional aeroplane are always there, each of {some} \
others with a chance of {chance:.0%}, every value drawn within {spread:.0%}. It flies {flights} times {duration:.0f} s at \
{rate:.0f} Hz with multisines on all controls at once ({amplitudes} rad). All twelve channels are noisy: {noise}. Terms are \
chosen from what the instruments read, among {candidates} candidates of each coefficient, on Fourier coefficients of \
{low:g} to {high:g} Hz; mass, geometry and thrust are known. Exact means: every true term and no other."""
WORDS: Final = """\
Partial F takes a term in when its ratio exceeds what the largest of so many needless candidates reaches by chance once in \
a thousand coefficients. PRESS takes in whatever predicts better, however little, and so lets false terms in. The \
predicted squared error of orthogonal functions charges every term as if all motion were noise: what explains less than one \
part in as many as there are rows is left out, true or not, but hardly anything false gets in."""


@dataclass(frozen=True)
class Tally:
    """Of so many aircraft: how many were found exactly, lack a true term, have a false one."""

    exact: int
    missing: int
    false: int


@dataclass(frozen=True)
class Structured:
    """Structure determination."""

    name: str = "structure"
    runs: int = 200
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan:
        """Return one run per aircraft."""
        return Plan(
            self.name,
            {"experiment": self.name},
            tuple(Run(_key(s), WORK, {"seed": s}) for s in setting.seeds),
        )

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        told = [results[_key(s)] for s in setting.seeds]
        tallies = {k: {c: tally(told, k, (c,)) for c in ALWAYS} for k in CRITERIA}
        whole = {k: tally(told, k, tuple(ALWAYS)) for k in CRITERIA}
        best = whole[DEFAULT]
        claim = holds(
            "the true set of terms of all six coefficients is found, and no other term, in at least 90 % of the aircraft",
            best.exact >= ENOUGH * len(told),
            f"{counted(best.exact, len(told))}; {best.missing} lack a true term, {best.false} have a false one",
        )
        return Findings(
            "Structure: are the true terms found?",
            _lead(everything()),
            (claim,),
            (
                Section("How often", (_table(tallies, whole, len(told)), Prose(WORDS))),
                Section("What there is to find", (_truths(),)),
            ),
            HEAD,
            tuple(_rows(tallies, whole, len(told))),
        )


def tally(told: Sequence[Mapping[str, Any]], criterion: str, coefficients: Sequence[str]) -> Tally:
    """Count the aircraft of which some coefficients were found."""
    exact = missing = false = 0
    for one in told:
        true = {(c, t) for c in coefficients for t in one["truth"][c]}
        found = {(c, t) for c in coefficients for t in one["found"][criterion][c]}
        exact += true == found
        missing += bool(true - found)
        false += bool(found - true)
    return Tally(exact, missing, false)


def _key(seed: int) -> str:
    return f"aircraft/{seed:06d}"


def _lead(vehicle: Vehicle) -> str:
    sensors = vehicle.file.sensors
    noise = ", ".join(f"{c} {getattr(sensors, c).sigma:g}" for c in vehicle.outputs)
    amplitudes = ", ".join(f"{c} {a:g}" for c, a in AMPLITUDES.items())
    return LEAD.format(
        some=sum(map(len, OCCASIONAL.values())), chance=CHANCE, spread=SPREAD, flights=FLIGHTS, duration=DURATION,
        rate=RATE, amplitudes=amplitudes, noise=f"{noise} (m/s, rad, rad/s, m/s²)", low=BAND.low, high=BAND.high,
        candidates=_candidates(vehicle)["CL"],
    )  # fmt: skip


def _candidates(vehicle: Vehicle) -> dict[str, int]:
    return {c: len(group) - 1 for c, group in vehicle.terms.items()}  # less the constant


def _table(tallies: Mapping[str, Mapping[str, Tally]], whole: Mapping[str, Tally], count: int) -> Table:
    head = ("coefficient", *(NAMES[k] for k in CRITERIA))
    rows = [(c, *(counted(tallies[k][c].exact, count) for k in CRITERIA)) for c in ALWAYS]
    return Table(
        "Found exactly", head, (*rows, ("all six", *(counted(whole[k].exact, count) for k in CRITERIA)))
    )


def _truths() -> Table:
    rows = tuple((c, _listed(ALWAYS[c]), _listed(OCCASIONAL.get(c, {}))) for c in ALWAYS)
    return Table(
        "Terms and the values about which theirs are drawn", ("coefficient", "always", "occasionally"), rows
    )


def _listed(terms: Mapping[str, float]) -> str:
    return ", ".join(f"{t} {v:g}".replace("-", "−") for t, v in terms.items()) or "–"


def _rows(
    tallies: Mapping[str, Mapping[str, Tally]], whole: Mapping[str, Tally], count: int
) -> Iterator[tuple[Cell, ...]]:
    candidates = _candidates(everything())
    for k in CRITERIA:
        for c, t in tallies[k].items():
            yield k, c, candidates[c], count, t.exact, t.missing, t.false
        t = whole[k]
        yield k, "all", sum(candidates.values()), count, t.exact, t.missing, t.false
