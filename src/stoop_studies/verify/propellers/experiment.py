"""The rotor that was cut or loaded, found in flights that were flown for nothing of the kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

import numpy as np

from stoop.base.csv_text import Cell
from stoop.estimate.effectiveness import (
    Assessment,
    Hover,
    Reference,
    Suspect,
    Verdict,
    assess,
    judge,
    leave_one_out,
    together,
)
from stoop.estimate.effectiveness.verdict import CHANCE
from stoop.report.plots import Series, plot
from stoop.report.sheet import Figure, Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, counted, holds, number
from stoop_studies.verify.propellers.flights import WHOLE, Flown, balance, read_flights

GUILTY: Final = "M3"
LEAD: Final = """\
Two airframes of one type fly 2 m forth and back: as they are, with the propeller M3 cut at both tips, and with a weight \
taped near M3. Each flight is held against the normal flights of its airframe; a normal flight against the others. What a \
rotor is commanded is the firmware's thrust command, which the firmware corrects with the battery's voltage."""
WORDS: Final = """\
The factor is thrust and torque of M3 per command, 1 in the normal flights, if M3 alone has changed; its standard error \
holds the scatter between flights of one configuration and the scatter within the flight. Chance is how often a healthy \
flight makes any of the four rotors this suspect. What is left over, in squares of three standard deviations, compares two \
explanations: a weak rotor, whose torque falls with its thrust, and a mass, which needs lift but no torque."""
DIGITS: Final = 6  #: decimals of the tables, so many that rounding them again gives what the page shows
HEAD: Final = (
    "airframe", "condition", "log", "voltage", "suspected", "chance", "factor_m3", "std_error", "left_if_weak",
    "mass_share", "mass_std_error", "left_if_mass", "verdict",
)  # fmt: skip
CONDITION_HEAD: Final = (
    "airframe", "condition", "length", "flights", "suspected", "chance", "factor_m3", "std_error", "lowest", "highest",
    "suspected_m3", "accused_m3", "verdict",
)  # fmt: skip


@dataclass(frozen=True)
class Judged:
    """A flight, what it shows, and what is said of it."""

    flown: Flown
    found: Assessment
    verdict: Verdict

    @property
    def accused(self) -> bool:
        """Whether it is said that something is wrong."""
        return self.verdict.kind != "healthy"

    @property
    def factor(self) -> float:
        """Of M3."""
        return 1.0 - _m3(self.found).size


@dataclass(frozen=True)
class Condition:
    """All flights of one airframe after one treatment, and their mean taken as one flight."""

    flights: tuple[Judged, ...]
    found: Assessment
    verdict: Verdict

    @property
    def flown(self) -> Flown:
        """Any of its flights, for what was done."""
        return self.flights[0].flown

    @property
    def factor(self) -> float:
        """Of M3, from the mean of its flights."""
        return 1.0 - _m3(self.found).size


@dataclass(frozen=True)
class Propellers:
    """Cut propellers and added weights."""

    name: str = "propellers"
    runs: int = 1
    parts: tuple[str, ...] = ("conditions",)

    def plan(self, setting: Setting) -> None:
        """Return nothing: all of it takes seconds."""
        return

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what is said of every flight, beside the truth."""
        flights = read_flights(setting.data)
        normal, changed = judge_all(flights)
        found = conditions(flights, changed)
        rows = tuple(_row(j) for j in (*normal, *changed))
        table = tuple(_condition_row(c) for c in found)
        return Findings(
            f"Which propeller is cut: {len(flights)} flights of two Crazyflies",
            LEAD,
            claims(normal, found),
            (
                Section("Treatments", (_condition_table(found), _figure(found))),
                Section("Flights", (_table((*normal, *changed)), Prose(WORDS))),
            ),
            HEAD,
            rows,
            {"conditions": (CONDITION_HEAD, table)},
        )


def references(flights: Sequence[Flown]) -> dict[str, Reference]:
    """Return the normal flights of each airframe.

    Those of the others tell the scatter too, and all flights of one treatment what the voltage does.
    """
    rotors = balance()
    groups: dict[tuple[str, str], tuple[Hover, ...]] = {}
    for f in flights:
        key = f.airframe, f.condition
        groups[key] = (*groups.get(key, ()), f.hover)
    normal = {airframe: group for (airframe, what), group in groups.items() if what == "normal"}
    repeats = tuple(group for (_, what), group in groups.items() if what != "normal")
    return {
        airframe: Reference(rotors, group, tuple(g for a, g in normal.items() if a != airframe), repeats)
        for airframe, group in normal.items()
    }


def judge_all(flights: Sequence[Flown]) -> tuple[tuple[Judged, ...], tuple[Judged, ...]]:
    """Return the normal flights, each held against the others, and the changed ones."""
    known = references(flights)
    normal: list[Judged] = []
    for airframe, reference in known.items():
        own = [f for f in flights if f.airframe == airframe and f.healthy]
        normal += [
            Judged(f, found, judge(found)) for f, found in zip(own, leave_one_out(reference), strict=True)
        ]
    changed = [f for f in flights if not f.healthy]
    held = [(f, assess(f.hover, known[f.airframe])) for f in sorted(changed, key=_order)]
    return tuple(normal), tuple(Judged(f, found, judge(found)) for f, found in held)


def conditions(flights: Sequence[Flown], changed: Sequence[Judged]) -> tuple[Condition, ...]:
    """Take the flights of one treatment together."""
    known = references(flights)
    out = []
    for _, group in groupby(changed, key=lambda j: _order(j.flown)[:3]):
        members = tuple(group)
        mean = together([j.flown.hover for j in members])
        found = assess(mean, known[members[0].flown.airframe])
        out.append(Condition(members, found, judge(found)))
    return tuple(out)


def _order(flown: Flown) -> tuple[str, str, int, str]:
    return flown.airframe, flown.weight, -flown.length, flown.log


def _m3(found: Assessment) -> Suspect:
    return next(s for s in found.weak if s.rotor == GUILTY)


def claims(normal: Sequence[Judged], found: Sequence[Condition]) -> tuple[Claim, ...]:
    """Return what is claimed, whether or not it holds."""
    cut = [c for c in found if not c.flown.weight]
    weighted = [c for c in found if c.flown.weight]
    return (
        _suspected(cut),
        _accused(cut),
        *(
            _falling(airframe, [c for c in cut if c.flown.airframe == airframe])
            for airframe in _airframes(cut)
        ),
        _left_alone(normal),
        _weights(weighted),
        _yaw(weighted),
    )


def _airframes(found: Sequence[Condition]) -> list[str]:
    return sorted({c.flown.airframe for c in found})


def _suspected(cut: Sequence[Condition]) -> Claim:
    right = sum(c.found.suspected.rotor == GUILTY for c in cut)
    flights = [j for c in cut for j in c.flights]
    alone = sum(j.found.suspected.rotor == GUILTY for j in flights)
    return holds(
        "The rotor that was cut is the one that explains most, after every cut",
        right == len(cut),
        f"{counted(right, len(cut))} cuts, {counted(alone, len(flights))} single flights",
    )


def _accused(cut: Sequence[Condition]) -> Claim:
    right = [c for c in cut if c.verdict.rotors == (GUILTY,)]
    missed = ", ".join(f"{c.flown.airframe} {c.flown.condition}" for c in cut if c not in right)
    flights = [j for c in cut for j in c.flights]
    alone = sum(j.verdict.rotors == (GUILTY,) for j in flights)
    return holds(
        f"It is accused after every cut, where a healthy flight is accused at most {100.0 * CHANCE:.0f} times in 100",
        len(right) == len(cut),
        f"{counted(len(right), len(cut))} cuts, {counted(alone, len(flights))} single flights"
        + (f"; not {missed}" if missed else ""),
    )


def _falling(airframe: str, cut: Sequence[Condition]) -> Claim:
    factors = [1.0, *(c.factor for c in cut)]
    lengths = [WHOLE, *(c.flown.length for c in cut)]
    steps = ", ".join(f"{n} mm {f:.3f}" for n, f in zip(lengths, factors, strict=True))
    return holds(
        f"{airframe}: the thrust per command falls with every cut",
        bool(np.all(np.diff(factors) < 0.0)),
        f"{steps}; standard error {_m3(cut[-1].found).std:.3f}",
    )


def _left_alone(normal: Sequence[Judged]) -> Claim:
    accused = sum(j.accused for j in normal)
    least = min(j.found.chance for j in normal)
    return holds(
        "No normal flight is accused, each held against the others",
        accused == 0,
        f"{counted(accused, len(normal))} accused; the least chance is {least:.2f}",
    )


def _weights(weighted: Sequence[Condition]) -> Claim:
    right = sum(_undecided(c.verdict) for c in weighted)
    flights = [j for c in weighted for j in c.flights]
    alone = sum(_undecided(j.verdict) for j in flights)
    return holds(
        f"Of every weight near {GUILTY} it is said: propeller or mass near {GUILTY}",
        right == len(weighted),
        f"{counted(right, len(weighted))} weights, {counted(alone, len(flights))} single flights",
    )


def _undecided(verdict: Verdict) -> bool:
    return verdict.kind == "weak or mass" and verdict.rotors == (GUILTY,)


def _yaw(weighted: Sequence[Condition]) -> Claim:
    left = [(c, _m3(c.found).left, c.found.mass_near(GUILTY).left) for c in weighted]
    figures = "; ".join(
        f"{c.flown.condition}: left over {number(weak)} if a weak rotor, {number(mass)} if a mass"
        for c, weak, mass in left
    )
    return holds(
        "The yaw balance tells a weight from a weak propeller", all(m < w for _, w, m in left), figures
    )


def _row(j: Judged) -> tuple[Cell, ...]:
    m3, mass = _m3(j.found), j.found.mass_near(GUILTY)
    return (
        j.flown.airframe, j.flown.condition, j.flown.log, *_rounded(j.found.voltage), j.found.suspected.rotor,
        *_rounded(j.found.chance, 1.0 - m3.size, m3.std, m3.left, mass.size, mass.std, mass.left), j.verdict.words,
    )  # fmt: skip


def _condition_row(c: Condition) -> tuple[Cell, ...]:
    factors = [j.factor for j in c.flights]
    return (
        c.flown.airframe, c.flown.condition, c.flown.length, len(c.flights), c.found.suspected.rotor,
        *_rounded(c.found.chance, c.factor, _m3(c.found).std, min(factors), max(factors)),
        sum(j.found.suspected.rotor == GUILTY for j in c.flights),
        sum(j.verdict.rotors == (GUILTY,) for j in c.flights), c.verdict.words,
    )  # fmt: skip


def _rounded(*values: float) -> tuple[float, ...]:
    return tuple(round(value, DIGITS) for value in values)


def _condition_table(found: Sequence[Condition]) -> Table:
    head = (
        "airframe",
        "M3",
        "suspected",
        "chance",
        "factor of M3",
        "single flights",
        "M3 accused",
        "verdict",
    )
    rows = tuple(
        (
            c.flown.airframe, c.flown.condition, c.found.suspected.rotor, f"{c.found.chance:.4f}",
            f"{c.factor:.3f} ± {_m3(c.found).std:.3f}",
            f"{min(j.factor for j in c.flights):.3f} to {max(j.factor for j in c.flights):.3f}",
            counted(sum(j.verdict.rotors == (GUILTY,) for j in c.flights), len(c.flights)), c.verdict.words,
        )
        for c in found
    )  # fmt: skip
    return Table("The flights after one treatment, taken together as one flight", head, rows)


def _table(judged: Sequence[Judged]) -> Table:
    head = (
        "airframe",
        "M3",
        "log",
        "V",
        "suspected",
        "chance",
        "factor of M3",
        "left if weak",
        "left if mass",
        "verdict",
    )
    rows = tuple(
        (
            j.flown.airframe, j.flown.condition, j.flown.log, f"{j.found.voltage:.2f}", j.found.suspected.rotor,
            f"{j.found.chance:.4f}", f"{j.factor:.3f} ± {_m3(j.found).std:.3f}", f"{_m3(j.found).left:.1f}",
            f"{j.found.mass_near(GUILTY).left:.1f}", j.verdict.words,
        )
        for j in judged
    )  # fmt: skip
    return Table("Each flight; normal ones are held against the other normal ones", head, rows)


def _figure(found: Sequence[Condition]) -> Figure:
    series: list[Series] = []
    looks: dict[str, int] = {}
    for look, airframe in enumerate(_airframes(found)):
        cut = [c for c in found if c.flown.airframe == airframe and not c.flown.weight]
        lengths = np.array([WHOLE, *(c.flown.length for c in cut)], dtype=np.float64)
        series.append(Series(airframe, lengths, np.array([1.0, *(c.factor for c in cut)])))
        single = [j for c in cut for j in c.flights]
        at = np.array([j.flown.length for j in single], dtype=np.float64)
        alone = f"{airframe}, single flights"
        series.append(Series(alone, at, np.array([j.factor for j in single]), "points"))
        looks |= {airframe: look, alone: look}
    drawn = plot(
        series,
        "length of the propeller M3, mm",
        "thrust per command, normal = 1",
        "The factor of M3 falls with the cut",
        looks=looks,
        x_ticks=sorted({WHOLE, *(c.flown.length for c in found if not c.flown.weight)}),
    )
    return Figure("Thrust of M3 per command over its length", drawn)
