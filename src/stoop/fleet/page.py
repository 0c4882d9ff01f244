"""The page of a fleet: its alarms, and for each vehicle every figure over the flights, with changes and parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import FloatArray
from stoop.base.numbers import NOTHING, count, number, rounded_to_error
from stoop.fleet.analysis import Alarm, FigureModel, FleetAnalysis
from stoop.fleet.parts import Parts, day
from stoop.fleet.store import Fleet, ToldAlarm
from stoop.fleet.table import FigureTable
from stoop.report.series import spanning
from stoop.report.sheet import Code, Legend, Page, Panel, Panels, Prose, Section, Sheet, Table
from stoop.report.svg import Scale, drawing, element

WIDTH, HEIGHT, MARGIN = 300.0, 110.0, 6.0
MOST: Final = 300  #: points of a panel; of more flights means of neighbors are shown
NAMED: Final = 7.0  #: px for a letter of a part's serial
HEAD: Final = ("vehicle", "figure", "change", "std error", "since", "found in", "explained by")
LEGEND: Final = (
    ("swatch fleet-point", "a flight"), ("swatch fan-most", "what 95 % of the flights lie in"),
    ("swatch edgekey", "a change began"), ("swatch fleet-part", "a part, with its serial; the next one is white"),
)  # fmt: skip
READ: Final = """\
Each panel has the flights of the vehicle side by side, in order of time; values are those at the mean conditions of the fleet. \
The line is the level of the vehicle with the changes that were found."""


def fleet_page(fleet: Fleet, found: FleetAnalysis, command: str = "") -> Page:
    """Return the page; vehicles with alarms come first and are open."""
    accused = {one.vehicle for one in found.alarms}
    vehicles = sorted(set(fleet.table.vehicle), key=lambda name: (name not in accused, name))
    lead = (
        f"{fleet.extent()}. {count(len(found.alarms), 'change')} found; of a fleet in which nothing changes "
        f"{fleet.alarms_a_year:g} a year would be told."
    )
    sections = [Section("Alarms", tuple(_tables(fleet.alarms)))]
    key: tuple[Prose | Legend, ...] = (Prose(READ, muted=True), Legend(LEGEND))
    for name in vehicles:
        panels = Panels([*_panels(name, found, fleet.parts)])
        sections.append(Section(name, (*key, panels), folded=name not in accused))
        key = ()
    if command:
        sections.append(Section("Made by", (Code(command),)))
    return Page(Sheet("What changed in the fleet", lead, tuple(sections), "fleet"))


def _tables(alarms: Sequence[ToldAlarm]) -> Iterator[Table | Prose]:
    for caption, withdrawn in (("Standing", False), ("Withdrawn: later flights no longer show them", True)):
        own = tuple(_row(one) for one in alarms if one.withdrawn is withdrawn)
        if own:
            yield Table(caption, HEAD, own)
        elif not withdrawn:
            yield Prose("None.")


def _row(one: ToldAlarm) -> tuple[str, ...]:
    size, error = rounded_to_error(one.size, one.std_error)
    return (
        one.vehicle,
        one.figure,
        f"{size}{one.per}",
        error,
        one.since,
        one.found,
        one.explanation or NOTHING,
    )


def _panels(vehicle: str, found: FleetAnalysis, parts: Parts) -> Iterator[Panel]:
    for name, figure in found.figures.items():
        if vehicle in figure.sequences:
            own = [one for one in found.alarms if (one.vehicle, one.figure) == (vehicle, name)]
            yield Panel(name, _drawn(figure, vehicle, own, parts), note=_ends(figure.sequences[vehicle][0]))


def _ends(rows: FigureTable) -> str:
    return f"{day(rows.time[0])} to {day(rows.time[-1])}"


def _drawn(figure: FigureModel, vehicle: str, alarms: Sequence[Alarm], parts: Parts) -> Markup:
    rows, readings = figure.sequences[vehicle]
    values = readings.values + figure.model.coefficients[0]
    course = sum((one.change.course(readings.times) for one in alarms), np.zeros(len(values)))
    level = course + np.average(values - course, weights=readings.deviations**-2.0)
    reach = NORMAL_95 * readings.deviations
    x = Scale(-0.5, len(values) - 0.5, MARGIN, WIDTH - MARGIN)
    y = Scale(*spanning([values, level + reach, level - reach], 0.04), HEIGHT - MARGIN, MARGIN)
    drawn = list(_spans(rows, vehicle, parts, x))
    at, middle, half, shown = (_thinned(c) for c in (np.arange(float(len(values))), level, reach, values))
    upper, lower = (_points(x, y, at, middle + side * half) for side in (1.0, -1.0))
    drawn.append(element("path", d=f"M{' '.join([*upper, *lower[::-1]])}Z", class_="fleet-band"))
    drawn.append(element("path", d=f"M{' '.join(_points(x, y, at, middle))}", class_="fleet-level"))
    drawn.append(
        element("path", d="".join(f"M{p}h0" for p in _points(x, y, at, shown)), class_="fleet-points")
    )
    for one in alarms:
        place = x.at(one.change.first - 0.5)
        drawn.append(element("line", x1=place, x2=place, y1=MARGIN, y2=HEIGHT - MARGIN, class_="edge"))
    for value, below in ((y.high, 9.0), (y.low, -2.0)):
        drawn.append(element("text", number(value), x=MARGIN, y=y.at(value) + below, class_="tick"))
    return drawing(
        WIDTH, HEIGHT, f"{rows.figure[0]} of {vehicle} over {count(len(values), 'flight')}.", drawn
    )


def _spans(rows: FigureTable, vehicle: str, parts: Parts, x: Scale) -> Iterator[Markup]:
    """Yield the stretches of flights with one part, every second one colored; of a figure of one place only."""
    places = sorted({place for text in rows.parts for place in text.split()})
    if len(places) != 1:
        return
    serials = parts.serials(places[0], [vehicle] * len(rows.flight), rows.time)
    begin = 0
    for k, (serial, group) in enumerate(groupby(serials)):
        end = begin + len(list(group))
        left, right = x.at(begin - 0.5), x.at(end - 0.5)
        if serial and k % 2 == 0:
            yield element("rect", x=left, y=0.0, width=right - left, height=HEIGHT, class_="fleet-span")
        if serial and right - left > NAMED * len(serial):
            yield element("text", serial, x=right - 4.0, y=HEIGHT - 3.0, class_="tick end")
        begin = end


def _thinned(values: FloatArray) -> FloatArray:
    """Return values, or the means of neighbors."""
    if len(values) <= MOST:
        return values
    starts = np.linspace(0, len(values), MOST, endpoint=False).astype(np.intp)
    return np.add.reduceat(values, starts) / np.diff([*starts, len(values)])


def _points(x: Scale, y: Scale, at: FloatArray, values: FloatArray) -> list[str]:
    return [f"{x.at(a):.1f},{y.at(v):.1f}" for a, v in zip(at.tolist(), values.tolist(), strict=True)]
