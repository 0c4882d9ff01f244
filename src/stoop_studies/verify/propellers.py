"""The rotor that was cut or loaded, found in CrazyPAD flights that were flown for nothing of the kind."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.csv_text import Cell
from stoop.errors import StoopError
from stoop.estimate.effectiveness import (
    CHANCE,
    Assessment,
    Balance,
    Explanation,
    Hover,
    Reference,
    Verdict,
    assess,
    hover,
    judge,
    leave_one_out,
    pooled,
)
from stoop.flight import load
from stoop.report.plots import Series, plot
from stoop.report.sheet import Figure, Prose, Section, Table
from stoop.vehicle import parse_vehicle
from stoop_studies.findings import Claim, Findings, Setting, counted, holds, number
from stoop_studies.verify.experiment import Samples, Verification, vehicle_text

FOLDER: Final = "crazypad-propeller-damage"
WHOLE: Final = 47  #: mm, length of an uncut propeller
MIN_NORMAL_FLIGHTS: Final = 2
CHANGED: Final = "M3"  #: the rotor that was cut or loaded
DIGITS: Final = 6  #: decimals of the tables, so many that rounding them again gives what the page shows
NAME: Final = re.compile(
    r"(?:(?P<normal>normal_flight)|cut_propeller_M3_\dmm_\dmm_(?P<cut>\d\d)mm|add_weight_(?P<weight>W\d)_near_M3)"
    r"__(?P<airframe>E\d+)_log(?P<log>\d\d)"
)
LEAD: Final = """\
Two airframes of one type fly 2 m forth and back: as they are, with the propeller M3 cut at both tips, and with a weight \
taped near M3. Each flight is held against the normal flights of its airframe; a normal flight against the others. What a \
rotor is commanded is the firmware's thrust command, which the firmware corrects with the battery's voltage."""
WORDS: Final = """\
The factor is thrust and torque of M3 per command, 1 in the normal flights, if M3 alone has changed; its standard error \
holds the scatter between flights of one configuration and the scatter within the flight. Chance is how often a healthy \
flight makes any of the four rotors this suspect. What is left over, in squares of three standard deviations, compares two \
explanations: a weak rotor, whose torque falls with its thrust, and a mass, which needs lift but no torque."""
HEAD: Final = (
    "airframe", "condition", "log", "voltage", "suspected", "chance", "factor_m3", "std_error", "left_if_weak",
    "mass_share", "mass_std_error", "left_if_mass", "verdict",
)  # fmt: skip
CONDITION_HEAD: Final = (
    "airframe", "condition", "length", "flights", "suspected", "chance", "factor_m3", "std_error", "lowest", "highest",
    "suspected_m3", "accused_m3", "verdict",
)  # fmt: skip


@dataclass(frozen=True)
class CrazyFlight:
    """One flight and the truth about it.

    Attributes
    ----------
    airframe : str
    length : int
        Of the propeller M3, mm.
    weight : str
        Name of the weight taped near M3; empty without any.
    log : str
    hover : Hover
    """

    airframe: str
    length: int
    weight: str
    log: str
    hover: Hover

    @property
    def healthy(self) -> bool:
        """Whether nothing was done to it."""
        return self.length == WHOLE and not self.weight

    @property
    def condition(self) -> str:
        """What was done to it."""
        return f"weight {self.weight}" if self.weight else "normal" if self.healthy else f"{self.length} mm"

    @property
    def order(self) -> tuple[str, str, int, str]:
        """Where it stands in the tables: by airframe, by treatment, by log."""
        return self.airframe, self.weight, -self.length, self.log


def balance() -> Balance:
    """Return the rotors of the Crazyflie."""
    return Balance(parse_vehicle(vehicle_text("crazyflie"), "crazyflie.toml"))


def read_flights(folder: Path | None) -> tuple[CrazyFlight, ...]:
    """Read all flights in a folder, or in its folder ``crazypad-propeller-damage``.

    Raises
    ------
    StoopError
        There are none, or one cannot be read.
    """
    places = [] if folder is None else [folder, folder / FOLDER]
    named = [
        [(path, parts) for path in sorted(place.glob("*.usd")) if (parts := NAME.fullmatch(path.stem))]
        for place in places
    ]
    best = max(named, key=len, default=[])
    if not best:
        where = "no folder is named" if folder is None else f"{folder}: holds none of its flights"
        raise StoopError(
            f"propellers: {where}; give --data DIR with flights of https://github.com/AerialRoboticsUUST/CrazyPAD "
            "(data/motor_data, '/' in a path become '__')"
        )
    rotors = balance()
    flights = tuple(
        CrazyFlight(
            p["airframe"], int(p["cut"] or WHOLE), p["weight"] or "", p["log"], hover(load(path), rotors)
        )
        for path, p in best
    )
    for airframe in sorted({f.airframe for f in flights}):
        if sum(f.airframe == airframe and f.healthy for f in flights) < MIN_NORMAL_FLIGHTS:
            raise StoopError(
                f"propellers: {folder}: {airframe} has fewer than {MIN_NORMAL_FLIGHTS} normal flights to compare with; "
                "fetch all"
            )
    return flights


@dataclass(frozen=True)
class Assessed:
    """A flight, or the mean of all flights after one treatment: what it shows, and what is said of it."""

    flight: CrazyFlight
    found: Assessment
    verdict: Verdict
    members: tuple[Assessed, ...] = ()

    @property
    def m3(self) -> Explanation:
        """M3 as the weak rotor."""
        return next(s for s in self.found.weak if s.rotor == CHANGED)

    @property
    def factor(self) -> float:
        """Of M3."""
        return 1.0 - self.m3.size

    @property
    def suspects_m3(self) -> bool:
        """Whether M3 explains most."""
        return self.found.suspected.rotor == CHANGED

    @property
    def accuses_m3(self) -> bool:
        """Whether it is said that M3 is weak."""
        return self.verdict.rotors == (CHANGED,)

    @property
    def undecided(self) -> bool:
        """Whether it is said that M3 is weak, or a mass near it."""
        return self.verdict.kind == "weak or mass" and self.accuses_m3


def references(flights: Sequence[CrazyFlight]) -> dict[str, Reference]:
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


def assess_all(flights: Sequence[CrazyFlight]) -> tuple[list[Assessed], list[Assessed], list[Assessed]]:
    """Return the normal flights, each compared with the others, the changed ones, and these by treatment."""
    known = references(flights)
    normal = [
        Assessed(f, found, judge(found))
        for airframe, reference in known.items()
        for f, found in zip(
            [f for f in flights if f.airframe == airframe and f.healthy],
            leave_one_out(reference),
            strict=True,
        )
    ]
    changed = []
    for f in sorted((f for f in flights if not f.healthy), key=lambda f: f.order):
        found = assess(f.hover, known[f.airframe])
        changed.append(Assessed(f, found, judge(found)))
    treatments = []
    for _, group in groupby(changed, key=lambda a: a.flight.order[:3]):
        members = tuple(group)
        found = assess(pooled([a.flight.hover for a in members]), known[members[0].flight.airframe])
        treatments.append(Assessed(members[0].flight, found, judge(found), members))
    return normal, changed, treatments


def show(setting: Setting, samples: Samples) -> Findings:
    """Return what is said of every flight, beside the truth."""
    flights = read_flights(setting.data)
    normal, changed, treatments = assess_all(flights)
    return Findings(
        f"Which propeller is cut: {len(flights)} flights of two Crazyflies",
        LEAD,
        _claims(normal, treatments),
        (
            Section("Treatments", (_treatment_table(treatments), _figure(treatments))),
            Section("Flights", (_table([*normal, *changed]), Prose(WORDS))),
        ),
        HEAD,
        tuple(_row(a) for a in (*normal, *changed)),
        {"conditions": (CONDITION_HEAD, tuple(_treatment_row(a) for a in treatments))},
    )


def _claims(normal: Sequence[Assessed], treatments: Sequence[Assessed]) -> tuple[Claim, ...]:
    cut = [a for a in treatments if not a.flight.weight]
    weighted = [a for a in treatments if a.flight.weight]
    cuts, weights = ([m for a in group for m in a.members] for group in (cut, weighted))
    suspected, accused = [a.suspects_m3 for a in cut], [a.accuses_m3 for a in cut]
    missed = ", ".join(f"{a.flight.airframe} {a.flight.condition}" for a in cut if not a.accuses_m3)
    undecided = [a.undecided for a in weighted]
    unhealthy = sum(a.verdict.kind != "healthy" for a in normal)
    left = [(a.flight.condition, a.m3.unexplained, a.found.mass_near(CHANGED).unexplained) for a in weighted]
    return (
        holds(
            "The rotor that was cut is the one that explains most, after every cut",
            all(suspected),
            f"{counted(sum(suspected), len(cut))} cuts, "
            f"{counted(sum(a.suspects_m3 for a in cuts), len(cuts))} single flights",
        ),
        holds(
            f"It is accused after every cut, where a healthy flight is accused at most {100.0 * CHANCE:.0f} times in 100",
            all(accused),
            f"{counted(sum(accused), len(cut))} cuts, {counted(sum(a.accuses_m3 for a in cuts), len(cuts))} single flights"
            + (f"; not {missed}" if missed else ""),
        ),
        *(
            _falling(airframe, [a for a in cut if a.flight.airframe == airframe])
            for airframe in _airframes(cut)
        ),
        holds(
            "No normal flight is accused, each held against the others",
            unhealthy == 0,
            f"{counted(unhealthy, len(normal))} accused; the least chance is {min(a.found.chance for a in normal):.2f}",
        ),
        holds(
            f"Of every weight near {CHANGED} it is said: propeller or mass near {CHANGED}",
            all(undecided),
            f"{counted(sum(undecided), len(weighted))} weights, "
            f"{counted(sum(a.undecided for a in weights), len(weights))} single flights",
        ),
        holds(
            "The yaw balance tells a weight from a weak propeller",
            all(mass < weak for _, weak, mass in left),
            "; ".join(
                f"{what}: left over {number(weak)} if a weak rotor, {number(mass)} if a mass"
                for what, weak, mass in left
            ),
        ),
    )


def _airframes(found: Sequence[Assessed]) -> list[str]:
    return sorted({a.flight.airframe for a in found})


def _falling(airframe: str, cut: Sequence[Assessed]) -> Claim:
    factors = [1.0, *(a.factor for a in cut)]
    lengths = [WHOLE, *(a.flight.length for a in cut)]
    steps = ", ".join(f"{n} mm {f:.3f}" for n, f in zip(lengths, factors, strict=True))
    return holds(
        f"{airframe}: the thrust per command falls with every cut",
        bool(np.all(np.diff(factors) < 0.0)),
        f"{steps}; standard error {cut[-1].m3.std:.3f}",
    )


def _row(a: Assessed) -> tuple[Cell, ...]:
    mass = a.found.mass_near(CHANGED)
    return (
        a.flight.airframe, a.flight.condition, a.flight.log, *_rounded(a.found.voltage), a.found.suspected.rotor,
        *_rounded(a.found.chance, 1.0 - a.m3.size, a.m3.std, a.m3.unexplained, mass.size, mass.std, mass.unexplained),
        str(a.verdict.notice),
    )  # fmt: skip


def _treatment_row(a: Assessed) -> tuple[Cell, ...]:
    factors = [m.factor for m in a.members]
    return (
        a.flight.airframe, a.flight.condition, a.flight.length, len(factors), a.found.suspected.rotor,
        *_rounded(a.found.chance, a.factor, a.m3.std, min(factors), max(factors)),
        sum(m.suspects_m3 for m in a.members), sum(m.accuses_m3 for m in a.members), str(a.verdict.notice),
    )  # fmt: skip


def _rounded(*values: float) -> tuple[float, ...]:
    return tuple(round(value, DIGITS) for value in values)


def _treatment_table(treatments: Sequence[Assessed]) -> Table:
    head = (
        "airframe", "M3", "suspected", "chance", "factor of M3", "single flights", "M3 accused", "verdict",
    )  # fmt: skip
    rows = []
    for a in treatments:
        factors = [m.factor for m in a.members]
        accused = counted(sum(m.accuses_m3 for m in a.members), len(factors))
        span = f"{min(factors):.3f} to {max(factors):.3f}"
        rows.append((*_common_cells(a, a.flight.condition), span, accused, str(a.verdict.notice)))
    return Table("The flights after one treatment, taken together as one flight", head, tuple(rows))


def _common_cells(a: Assessed, *what: str) -> tuple[str, ...]:
    factor = f"{a.factor:.3f} ± {a.m3.std:.3f}"
    return (a.flight.airframe, *what, a.found.suspected.rotor, f"{a.found.chance:.4f}", factor)


def _table(flights: Sequence[Assessed]) -> Table:
    head = (
        "airframe", "M3", "log", "V", "suspected", "chance", "factor of M3", "left if weak", "left if mass", "verdict",
    )  # fmt: skip
    rows = tuple(
        (
            *_common_cells(a, a.flight.condition, a.flight.log, f"{a.found.voltage:.2f}"),
            f"{a.m3.unexplained:.1f}",
            f"{a.found.mass_near(CHANGED).unexplained:.1f}",
            str(a.verdict.notice),
        )
        for a in flights
    )
    return Table("Each flight; normal ones are held against the other normal ones", head, rows)


def _figure(treatments: Sequence[Assessed]) -> Figure:
    series: list[Series] = []
    looks: dict[str, int] = {}
    cut = [a for a in treatments if not a.flight.weight]
    for look, airframe in enumerate(_airframes(treatments)):
        own = [a for a in cut if a.flight.airframe == airframe]
        single = [m for a in own for m in a.members]
        alone = f"{airframe}, single flights"
        lengths = np.array([WHOLE, *(a.flight.length for a in own)], dtype=np.float64)
        series.append(Series(airframe, lengths, np.array([1.0, *(a.factor for a in own)])))
        lengths = np.array([m.flight.length for m in single], dtype=np.float64)
        series.append(Series(alone, lengths, np.array([m.factor for m in single]), "points"))
        looks |= {airframe: look, alone: look}
    drawn = plot(
        series,
        "length of the propeller M3, mm",
        "thrust per command, normal = 1",
        "The factor of M3 falls with the cut",
        looks=looks,
        x_ticks=sorted({WHOLE, *(a.flight.length for a in cut)}),
    )
    return Figure("Thrust of M3 per command over its length", drawn)


EXPERIMENT: Final = Verification("propellers", show, parts=("conditions",))
