"""The rotor that was cut or loaded, found in CrazyPAD flights that were flown for nothing of the kind."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import mannwhitneyu

from stoop.errors import StoopError
from stoop.flight import load_flight
from stoop.vehicle import parse_vehicle
from stoop_analysis.performance import effectiveness
from stoop_studies.findings import Claim, Findings, Setting, counted, holds, number
from stoop_studies.verify.study import Samples, Verification, published_files, vehicle_text

FOLDER: Final = "crazypad-propeller-damage"
WHOLE: Final = 47  #: mm, length of an uncut propeller
MIN_NORMAL_FLIGHTS: Final = 2
CHANGED: Final = "M3"  #: the rotor that was cut or loaded
NORMAL: Final = "normal"  #: what was done to a flight: nothing
AREA: Final = 0.95  #: under the ROC curve, at least
DIGITS: Final = 6  #: decimals of the tables, so many that rounding them again gives what the page shows
#: of a file
NAME: Final = (
    r"(?:normal_flight|cut_propeller_M3_\dmm_\dmm_(?P<cut>\d\d)mm|add_weight_(?P<weight>W\d)_near_M3)"
    r"__(?P<airframe>E\d+)_log(?P<log>\d\d)\.usd"
)


@dataclass(frozen=True)
class CrazyFlight:
    """One flight and the truth about it: length of the propeller M3, mm, and name of the weight near it, if any."""

    airframe: str
    length: int
    weight: str
    log: str
    hover: effectiveness.Hover

    @property
    def condition(self) -> str:
        """What was done to it: "normal" if nothing."""
        if self.weight:
            return f"weight {self.weight}"
        return NORMAL if self.length == WHOLE else f"{self.length} mm"


def balance() -> effectiveness.Balance:
    """Return the rotors of the Crazyflie."""
    return effectiveness.Balance(parse_vehicle(vehicle_text("crazyflie"), "crazyflie.toml"))


def read_flights(folder: Path | None) -> tuple[CrazyFlight, ...]:
    """Read all flights in a folder, or in its folder ``crazypad-propeller-damage``."""
    advice = (
        "give --data DIR with flights of https://github.com/AerialRoboticsUUST/CrazyPAD "
        "(data/motor_data, '/' in a path become '__')"
    )
    rotors, flights = balance(), []
    for path in published_files("propellers", folder, FOLDER, NAME, "holds none of its flights", advice):
        p = re.fullmatch(NAME, path.name)
        assert p is not None  # noqa: S101 - the pattern of the search
        length, weight = int(p["cut"] or WHOLE), p["weight"] or ""
        flights.append(
            CrazyFlight(
                p["airframe"], length, weight, p["log"], effectiveness.hover(load_flight(path), rotors)
            )
        )
    normal = Counter(f.airframe for f in flights if f.condition == NORMAL)
    for airframe in sorted({f.airframe for f in flights}):
        if normal[airframe] < MIN_NORMAL_FLIGHTS:
            raise StoopError(
                f"propellers: {folder}: {airframe} has fewer than {MIN_NORMAL_FLIGHTS} normal flights to compare with; "
                "fetch all"
            )
    return tuple(flights)


@dataclass(frozen=True)
class Assessed:
    """A flight, or the mean of all flights after one treatment (``members``), and what it shows."""

    flight: CrazyFlight
    found: effectiveness.Assessment
    members: tuple[Assessed, ...] = ()

    @cached_property
    def verdict(self) -> effectiveness.Verdict:
        """What is said of it."""
        return effectiveness.judge(self.found)

    @property
    def m3(self) -> effectiveness.Explanation:
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
        """Whether the verdict is that M3 is weak."""
        return self.verdict.rotors == (CHANGED,)


def assess_all(flights: Sequence[CrazyFlight]) -> tuple[list[Assessed], list[Assessed], list[Assessed]]:
    """Return the normal flights, each compared with the others, the changed ones, and these by treatment.

    The scatter is that of the normal flights of both airframes; all flights of one treatment give the effect of the voltage.
    """
    groups: dict[tuple[str, str], list[CrazyFlight]] = {}
    for f in flights:
        groups.setdefault((f.airframe, f.condition), []).append(f)
    hovers = {key: tuple(f.hover for f in own) for key, own in groups.items()}
    healthy = {airframe: own for (airframe, what), own in hovers.items() if what == NORMAL}
    repeats, rotors = tuple(own for (_, what), own in hovers.items() if what != NORMAL), balance()
    known = {
        airframe: effectiveness.Reference(
            rotors, own, tuple(h for a, h in healthy.items() if a != airframe), repeats
        )
        for airframe, own in healthy.items()
    }
    normal = [
        Assessed(f, found)
        for airframe, reference in known.items()
        for f, found in zip(groups[airframe, NORMAL], effectiveness.leave_one_out(reference), strict=True)
    ]
    treated = (f for f in flights if f.condition != NORMAL)
    changed = [
        Assessed(f, effectiveness.assess(f.hover, known[f.airframe]))
        for f in sorted(treated, key=lambda f: (f.airframe, f.weight, -f.length, f.log))
    ]
    treatments = []
    for (airframe, _), group in groupby(changed, key=lambda a: (a.flight.airframe, a.flight.condition)):
        members = tuple(group)
        found = effectiveness.assess(effectiveness.pooled([a.flight.hover for a in members]), known[airframe])
        treatments.append(Assessed(members[0].flight, found, members))
    return normal, changed, treatments


def _record(a: Assessed) -> dict[str, Any]:
    """Return the row of a flight, or of a treatment with its single flights."""
    flight, mass, factors = a.flight, a.found.mass_near(CHANGED), [m.factor for m in a.members]
    suspicion = {
        "suspected": a.found.suspected.rotor, "chance": a.found.chance, "factor_m3": a.factor, "std_error": a.m3.std,
    }  # fmt: skip
    own: dict[str, Any] = {
        "length": flight.length, "flights": len(factors), **suspicion, "lowest": min(factors), "highest": max(factors),
        "suspected_m3": sum(m.suspects_m3 for m in a.members), "accused_m3": sum(m.accuses_m3 for m in a.members),
    } if factors else {
        "log": flight.log, "voltage": a.found.voltage, **suspicion, "left_if_weak": a.m3.unexplained,
        "mass_share": mass.size, "mass_std_error": mass.std, "left_if_mass": mass.unexplained,
    }  # fmt: skip
    row = {
        "airframe": flight.airframe,
        "condition": flight.condition,
        **own,
        "verdict": str(a.verdict.notice),
    }
    return {k: round(v, DIGITS) if isinstance(v, float) else v for k, v in row.items()}


def show(setting: Setting, samples: Samples) -> Findings:
    """Return the verdict on every flight, beside the truth."""
    flights = read_flights(setting.data)
    normal, changed, treatments = assess_all(flights)
    single, grouped = ([_record(a) for a in own] for own in ((*normal, *changed), treatments))
    title = f"Which propeller is cut: {len(flights)} flights of two Crazyflies"
    return Findings.of(title, _claims(normal, treatments), single, {"conditions": grouped})


def _claims(normal: Sequence[Assessed], treatments: Sequence[Assessed]) -> Iterator[Claim]:
    cut, weighted = ([a for a in treatments if bool(a.flight.weight) == weight] for weight in (False, True))

    def shares(group: Sequence[Assessed], what: str, so: Callable[[Assessed], bool]) -> tuple[bool, str]:
        """Return whether something holds for all treatments of a group, and counts of these and of single flights."""
        whole, single = [so(a) for a in group], [so(m) for a in group for m in a.members]
        counts = (counted(sum(found), len(found)) for found in (whole, single))
        return all(whole), "{} {what}, {} single flights".format(*counts, what=what)

    suspected, figures = shares(cut, "cuts", lambda a: a.suspects_m3)
    yield holds("The rotor that was cut is the one that explains most, after every cut", suspected, figures)
    accused, figures = shares(cut, "cuts", lambda a: a.accuses_m3)
    missed = ", ".join(f"{a.flight.airframe} {a.flight.condition}" for a in cut if not a.accuses_m3)
    yield holds(
        "It is accused after every cut, where a healthy flight is accused at most "
        f"{100.0 * effectiveness.CHANCE:.0f} times in 100",
        accused,
        figures + (f"; not {missed}" if missed else ""),
    )
    for airframe, group in groupby(cut, key=lambda a: a.flight.airframe):
        own = list(group)
        factors, lengths = [1.0, *(a.factor for a in own)], [WHOLE, *(a.flight.length for a in own)]
        steps = ", ".join(f"{n} mm {f:.3f}" for n, f in zip(lengths, factors, strict=True))
        yield holds(
            f"{airframe}: the thrust per command falls with every cut",
            bool(np.all(np.diff(factors) < 0.0)),
            f"{steps}; standard error {own[-1].m3.std:.3f}",
        )
    unhealthy = sum(a.verdict.kind != "healthy" for a in normal)
    yield holds(
        "No normal flight is accused, each compared with the others",
        unhealthy == 0,
        f"{counted(unhealthy, len(normal))} accused; the least chance is {min(a.found.chance for a in normal):.2f}",
    )
    flown = [m for a in cut for m in a.members]
    behind = mannwhitneyu([a.found.chance for a in normal], [a.found.chance for a in flown]).statistic
    area = float(behind) / (len(normal) * len(flown))
    yield holds(
        f"Area under the ROC curve of the chance, cut flights against normal ones, of {AREA}",
        area >= AREA,
        f"{area:.3f}; {len(flown)} cut flights, {len(normal)} normal ones, none compared with itself",
    )
    undecided, figures = shares(
        weighted, "weights", lambda a: a.verdict.kind == "weak or mass" and a.accuses_m3
    )
    statement = f"Of every weight near {CHANGED} it is said: propeller or mass near {CHANGED}"
    yield holds(statement, undecided, figures)
    left = [(a.flight.condition, a.m3.unexplained, a.found.mass_near(CHANGED).unexplained) for a in weighted]
    yield holds(
        "The yaw balance distinguishes a weight from a weak propeller",
        all(mass < weak for _, weak, mass in left),
        "; ".join(
            f"{what}: left over {number(weak)} if a weak rotor, {number(mass)} if a mass"
            for what, weak, mass in left
        ),
    )


EXPERIMENT: Final = Verification("propellers", show, parts=("conditions",))
