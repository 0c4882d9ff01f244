"""Fleets whose figures are drawn: how often nothing is told as a change, and how soon, and with which cause, a change is found.

A fleet has figures of the size and scatter that flights of small vehicles show, a season, wind, and an exchange of every part and
an update of every vehicle, which change nothing beyond what parts usually differ by. A case adds one change to one vehicle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.stats import chi2

from stoop.base.arrays import FloatArray
from stoop_fleet.analysis import YEAR, FleetAnalysis, analyze
from stoop_fleet.causes import SOFTWARE
from stoop_fleet.changes import scan, threshold
from stoop_fleet.parts import Fitting, Parts
from stoop_fleet.table import FigureTable
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import study

VEHICLES: Final = 50
FLIGHTS: Final = 200
YEARS: Final = 1.0
EVENTS: Final = (0.3, 0.7)  #: shares of the flights between which something is exchanged, updated or changed
GROWN: Final = 40  #: flights in which a drift reaches the size of the step
UPDATED: Final = 40  #: flights after which an update is rolled back
UNCHANGED: Final = 2000  #: sequences that are drawn for the threshold of the test that knows the change
WEATHER: Final = 0.5  #: effect of season and of a standard deviation of wind, over the scatter of flights


@dataclass(frozen=True)
class Drawn:
    """How a figure is drawn: standard deviations of vehicles, parts, flights and estimates, and the place it depends on.

    A rotor moves the lift, and a pitot whatever is taken at an airspeed: by their effect there parts differ, too.
    """

    vehicle: float
    part: float
    flight: float
    error: float
    place: str = ""


FIGURES: Final[Mapping[str, Drawn]] = {
    "share.rotor_1": Drawn(0.01, 0.003, 0.004, 0.004, "rotor_1"),
    "hover.lift": Drawn(0.01, 0.001, 0.006, 0.004, "rotor_1"),
    "trim.alpha": Drawn(0.004, 0.0009, 0.0025, 0.002, "pitot"),
    "trim.elevator": Drawn(0.006, 0.002, 0.0025, 0.002, "elevator"),
    "airspeed_pitot.scale": Drawn(0.01, 0.005, 0.006, 0.006, "pitot"),
    "theta.bias": Drawn(0.004, 0.001, 0.002, 0.002, "imu"),
    "battery.resistance": Drawn(0.05, 0.03, 0.03, 0.03, "battery"),
    "drag.CD": Drawn(0.03, 0.01, 0.03, 0.03, "pitot"),
    "climb": Drawn(0.02, 0.0, 0.03, 0.02, SOFTWARE),
}
"""Figure -> how it is drawn; rad, or relative to its mean."""
PLACES: Final = tuple(sorted({one.place for one in FIGURES.values()} - {"", SOFTWARE}))


@dataclass(frozen=True)
class Injected:
    """What a change adds to figures, the place whose exchange it comes with, "software", or empty for none, and of which part.

    The part is empty where it stands in no table: of the mass, of the airframe.
    """

    effects: Mapping[str, float]
    event: str = ""
    part: str = ""


INJECTED: Final[Mapping[str, Injected]] = {
    "thrust of a rotor -3 %": Injected({"share.rotor_1": 0.0225, "hover.lift": 0.0075}, part="rotor_1"),
    "mass +4 %": Injected({"hover.lift": 0.04, "trim.alpha": 0.0073}),
    "center of gravity 3 mm": Injected({"trim.elevator": 0.0065}),
    "another propeller": Injected({"share.rotor_1": -0.04, "hover.lift": -0.01}, "rotor_1"),
    "servo trim 1 deg": Injected({"trim.elevator": 0.01745}, "elevator"),
    "pitot +3 %": Injected(
        {"airspeed_pitot.scale": 0.03, "trim.alpha": 0.0055, "drag.CD": -0.06}, part="pitot"
    ),
    "IMU turned by 0.5 deg": Injected({"theta.bias": 0.00873}, "imu"),
    "battery resistance +20 %": Injected({"battery.resistance": 0.2}, part="battery"),
    "drag +10 %": Injected({"drag.CD": 0.1}),
    "10 % steeper climb": Injected({"climb": 0.1}, "software"),
}
"""What is changed -> its effects: of thrust on the share of one rotor among four, of mass on angle of attack by a lift
coefficient of 0.88 and a slope of 4.8, of the center of gravity on the elevator by a chord of 0.25 m, a lift coefficient of 0.6
and a moment of the elevator of 1.1."""
NOTHING: Final = "nothing"
BACK: Final = "rolled back"
CASES: Final = (NOTHING, *(f"{what}, {how}" for what in INJECTED for how in ("step", "drift")), BACK)


def injected_in(case: str) -> Injected:
    """Return what a case changes."""
    return INJECTED.get("10 % steeper climb" if case == BACK else case.rpartition(", ")[0], Injected({}))


@dataclass(frozen=True, eq=False)
class Flown:
    """A drawn fleet: its table and parts, and of the changed vehicle the flight in which the change begins."""

    table: FigureTable
    parts: Parts
    first: int


CHANGED: Final = "v0"


def drawn(case: str, rng: np.random.Generator, vehicles: int = VEHICLES, flights: int = FLIGHTS) -> Flown:
    """Return a fleet with the change of a case on its first vehicle."""
    injected, how = injected_in(case), case.rpartition(", ")[2]
    rows: dict[str, list[Any]] = {name: [] for name in ("flight", "vehicle", "figure", "software", "parts")}
    numbers: dict[str, list[Any]] = {name: [] for name in ("time", "value", "std_error", "season", "wind")}
    fittings: list[Fitting] = []
    begun = 0
    for v in range(vehicles):
        vehicle, time = f"v{v}", np.sort(rng.uniform(0.0, YEARS * YEAR, flights))
        events = {place: int(rng.uniform(*EVENTS) * flights) for place in (*PLACES, "software", "none")}
        at = {place: np.arange(flights) >= k for place, k in events.items()}
        for place in PLACES:
            moment = float(time[events[place]]) - 1.0
            fittings += [
                Fitting(vehicle, place, f"{place}-{v}a", -np.inf, moment),
                Fitting(vehicle, place, f"{place}-{v}b", moment, np.inf),
            ]
        new = at["software"].copy()
        size: FloatArray = np.zeros(flights)
        if v == 0:
            begun = events[injected.event or "none"]
            if case == BACK:
                new[begun + UPDATED :] = False
            since = np.arange(flights) - begun
            there = (since >= 0) & (new | (case != BACK))
            size = np.asarray(np.clip(since / GROWN, 0.0, None) if how == "drift" else there, np.float64)
        season, wind = np.cos(2.0 * np.pi * time / YEAR), rng.standard_normal(flights)
        for figure, one in FIGURES.items():
            error = one.error * rng.uniform(0.7, 1.4, flights)
            value = 1.0 + one.vehicle * rng.standard_normal() + injected.effects.get(figure, 0.0) * size
            value += one.flight * (WEATHER * (season + wind) + rng.standard_normal(flights))
            value += error * rng.standard_normal(flights)
            if one.place:
                value += one.part * rng.standard_normal(2)[at[one.place].astype(int)]
            rows["flight"] += [f"{vehicle}-{i}" for i in range(flights)]
            rows["vehicle"] += [vehicle] * flights
            rows["figure"] += [figure] * flights
            rows["software"] += np.where(new, "1.1", "1.0").tolist()
            rows["parts"] += [one.place] * flights
            for name, x in zip(numbers, (time, value, error, season, wind), strict=True):
                numbers[name].append(x)
    columns = {name: np.concatenate(x) for name, x in numbers.items()}
    order = np.argsort(columns["time"], kind="stable")
    conditions = {name: columns.pop(name)[order] for name in ("season", "wind")}
    table = FigureTable.of_columns(
        {name: [x[i] for i in order.tolist()] for name, x in rows.items()},
        {name: x[order] for name, x in columns.items()},
        conditions,
    )
    return Flown(table, Parts(tuple(sorted(fittings, key=lambda f: (f.vehicle, f.part, f.begin)))), begun)


def crossed(found: FleetAnalysis) -> int:
    """Return how many sequences exceed the threshold in some flight: what is told on the nights, one for each."""
    return sum(
        bool(scan(readings).statistic.max() > found.threshold)
        for model in found.figures.values()
        for _, readings in model.sequences.values()
    )


def least_delay(case: str, fleet: Flown, rng: np.random.Generator) -> float:
    """Return how many flights the test that knows the size takes to tell a change, the first one with it included.

    It knows the kind, too, and how flights, parts and vehicles differ, but not when the change begins nor how this vehicle and
    its parts differ. For every flight in which it may begin it compares the likelihoods (Lorden 1971), at the threshold that
    readings without a change exceed as often as those of the fleet. The first of the figures that change counts; where none is
    told, infinity.
    """
    effects, how = injected_in(case).effects, case.rpartition(", ")[2]
    return min(_least_delay(fleet, figure, effect, how, rng) for figure, effect in effects.items())


def _least_delay(fleet: Flown, figure: str, effect: float, how: str, rng: np.random.Generator) -> float:
    one, rows = FIGURES[figure], fleet.table.of(figure)
    rows = rows.rows(np.array([vehicle == CHANGED for vehicle in rows.vehicle]))
    serials = np.array(fleet.parts.serials(one.place, rows.vehicle, rows.time))
    parts = one.part**2 * (serials[:, None] == serials)
    root = cholesky(np.diag(one.flight**2 + rows.std_error**2) + one.vehicle**2 + parts, lower=True)
    since = np.subtract.outer(np.arange(len(serials)), np.arange(1, len(serials)))
    course = np.where(since < 0, 0.0, since / GROWN if how == "drift" else 1.0)
    changes = solve_triangular(root, effect * course, lower=True).T  # by their first flight
    weather = WEATHER * one.flight * (rows.conditions["season"] + rows.conditions["wind"])
    own = solve_triangular(root, rows.value - 1.0 - weather, lower=True)
    readings = np.vstack([own, rng.standard_normal((UNCHANGED, len(own)))])
    ratio = np.zeros(readings.shape)
    for change in changes:
        ratio = np.maximum(ratio, np.cumsum(change * readings - 0.5 * change**2, axis=1))
    limit = threshold(ratio[1:].max(axis=1), YEARS * UNCHANGED / (VEHICLES * len(FIGURES)))
    over = ratio[0, fleet.first :] > limit
    return float(np.argmax(over) + 1) if over.any() else np.inf


@study.work
def examine(case: str, seed: int) -> dict[str, Any]:
    """Draw a fleet and look for changes; of one that was made: whether, when, and with which cause it was found."""
    rng = np.random.default_rng([71, CASES.index(case), seed])
    fleet = drawn(case, rng)
    found = analyze(fleet.table, fleet.parts, 1.0, seed)
    out: dict[str, Any] = {"false": sum(a.vehicle != CHANGED for a in found.alarms)}
    if case == NOTHING:
        return {**out, "false": len(found.alarms), "told": crossed(found)}
    injected = injected_in(case)
    own = [a for a in found.alarms if a.vehicle == CHANGED and a.figure in injected.effects]
    if case == BACK:
        backs = [a for a in own if a.back]
        dated = [_number(a.began) - fleet.first - UPDATED for a in backs]
        return {**out, "found": bool(own), "back": bool(backs), "dated": dated[0] if dated else None}
    true = [a for a in own if a.change.found >= fleet.first]
    least, left = least_delay(case, fleet, rng), FLIGHTS - fleet.first
    out |= {"found": bool(true), "possible": least <= left, "delay": left, "least": min(least, left)}
    out |= {"named": None, "event": None}
    if true:
        first = min(true, key=lambda a: a.change.found)
        cause, part = first.causes[0], injected.event or injected.part
        event = cause.what.partition(":")[0] == injected.event
        out |= {"delay": first.change.found - fleet.first + 1, "event": event}
        out["named"] = cause.place == part if part else event
    return out


def _number(flight: str) -> int:
    return int(flight.rpartition("-")[2])


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return rates, delays and causes of each case."""
    table = [_row(case, records) for case, records in samples.items() if records]
    return Findings.of("Changes of a fleet", list(_claims(table, samples)), table)


def _row(case: str, records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    out: dict[str, Any] = {"case": case, "fleets": len(records)}
    for name in ("false", "told", "found", "possible", "delay", "least", "named", "event"):
        known = [r[name] for r in records if r.get(name) is not None]
        out[name] = float(np.mean(known)) if known else None
    backs = [r for r in records if case == BACK]
    out["dated"] = float(np.mean([r["back"] and abs(r["dated"]) <= 2 for r in backs])) if backs else None
    return out


def _claims(table: Sequence[Mapping[str, Any]], samples: study.Samples) -> Iterator[Claim]:
    if records := samples.get(NOTHING):
        told = [r["told"] for r in records]
        low, high = (
            float(np.nan_to_num(chi2.ppf(p, 2 * (sum(told) + more)))) / (2.0 * len(told))
            for p, more in ((0.025, 0), (0.975, 1))
        )
        yield holds(
            "Nothing changes: one is told in a year",
            low <= YEARS <= high,
            f"{np.mean(told):.2f} ({low:.2f} to {high:.2f})",
        )
    changed = [row for row in table if row["case"] not in (NOTHING, BACK)]
    for row in changed:
        case, named = row["case"], row["named"]
        yield holds(f"{case}: found in 95 %", row["found"] >= 0.95, f"{100 * row['found']:.0f} %")
        yield holds(
            f"{case}: told after at most 1.3 times the flights that the test takes which knows the size",
            row["delay"] <= 1.3 * row["least"],
            f"{row['delay']:.2f} of {row['least']:.2f}",
        )
        if named is not None:
            yield holds(f"{case}: part named first in 90 %", named >= 0.9, f"{100 * named:.0f} %")
    for row in table:
        if row["case"] == BACK:
            yield holds(
                "A roll-back is dated within 2 flights in 90 %",
                row["dated"] >= 0.9,
                f"{100 * row['dated']:.0f} %",
            )


EXPERIMENT: Final = study.Verification(
    "fleet", show, runs=20, work="examine", cases=CASES, times={NOTHING: 10}
)
