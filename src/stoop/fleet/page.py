"""The page of a fleet: its alarms, and for each vehicle every figure over the flights, with changes and parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Final

import numpy as np
from markupsafe import Markup, escape

from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import FloatArray
from stoop.base.numbers import NOTHING, count, number, rounded_to_error
from stoop.fleet.analysis import Alarm, FigureModel, FleetAnalysis
from stoop.fleet.causes import EVERY
from stoop.fleet.parts import Parts, day
from stoop.fleet.store import Fleet, ToldAlarm, shown_unit
from stoop.fleet.table import FigureTable
from stoop.report.series import spanning
from stoop.report.sheet import Code, Legend, Page, Panel, Panels, Prose, Section, Sheet, Table
from stoop.report.svg import Scale, drawing, element

WIDTH, HEIGHT, MARGIN, LABEL = 300.0, 124.0, 6.0, 14.0
MOST: Final = 300  #: points of a panel; of more flights means of neighbors are shown
POINTS, FEWEST = 200_000, 20  #: of all panels, about; of a panel in any case
NAMED: Final = 7.0  #: px for a letter of a part's serial
#: vehicle, figure and first flight of a change -> its name in the page
Places = Mapping[tuple[str, str, str], str]
HEAD: Final = ("vehicle", "figure", "change", "since when, and why")
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
    places = {
        (one.vehicle, one.figure, one.began): f"change-{i}"
        for i, one in enumerate(found.alarms)
        if one.vehicle != EVERY
    }
    sections = [Section("Alarms", tuple(_tables(fleet.alarms, places)))]
    most = POINTS // max(sum(len(one.sequences) for one in found.figures.values()), 1)
    key: tuple[Prose | Legend, ...] = (Prose(READ, muted=True), Legend(LEGEND))
    for name in vehicles:
        shown = MOST if name in accused else min(max(most, FEWEST), MOST)
        panels = Panels([*_panels(name, found, fleet.parts, places, shown)])
        sections.append(Section(name, (*key, panels), folded=name not in accused))
        key = ()
    if command:
        sections.append(Section("Made by", (Code(command),)))
    return Page(Sheet("What changed in the fleet", lead, tuple(sections), "fleet", script="fleet.js"))


def _tables(alarms: Sequence[ToldAlarm], places: Places) -> Iterator[Table | Prose]:
    for caption, withdrawn in (("Standing", False), ("Withdrawn: later flights no longer show them", True)):
        own = tuple(_row(one, places) for one in alarms if one.withdrawn is withdrawn)
        if own:
            yield Table(caption, HEAD, own, kinds=("", "", "", "wrap fold"))
        elif not withdrawn:
            yield Prose("None.")


def _row(one: ToldAlarm, places: Places) -> tuple[str, ...]:
    """Return the cells of an alarm, with a link to its change in the panel of the figure."""
    size, error = rounded_to_error(one.size, one.std_error)
    since: str = escape(f"since {one.since}")
    if not one.withdrawn and (place := places.get((one.vehicle, one.figure, one.began))):
        since = Markup('<a href="#{}">{}</a>').format(place, since)
    why = Markup("{}, found in {}: {}").format(since, one.found, one.explanation or NOTHING)
    return one.vehicle, one.figure, f"{size} ± {error}{one.per}", why


def _panels(vehicle: str, found: FleetAnalysis, parts: Parts, places: Places, most: int) -> Iterator[Panel]:
    for name, figure in found.figures.items():
        if vehicle in figure.sequences:
            own = [one for one in found.alarms if (one.vehicle, one.figure) == (vehicle, name)]
            drawn = _drawn(figure, vehicle, own, parts, places, most)
            rows = figure.sequences[vehicle][0]
            yield Panel(name, drawn, unit=shown_unit(rows.unit[-1]).strip(), note=_ends(rows))


def _ends(rows: FigureTable) -> str:
    return f"{day(rows.time[0])} to {day(rows.time[-1])}"


def _drawn(
    figure: FigureModel, vehicle: str, alarms: Sequence[Alarm], parts: Parts, places: Places, most: int
) -> Markup:
    rows, readings = figure.sequences[vehicle]
    values = readings.values + figure.model.coefficients[0]
    course = sum((one.change.course(readings.times) for one in alarms), np.zeros(len(values)))
    weights = readings.deviations**-2.0
    level = course + weights @ (values - course) / weights.sum()
    reach = NORMAL_95 * readings.deviations
    x = Scale(-0.5, len(values) - 0.5, MARGIN, WIDTH - MARGIN)
    y = Scale(*spanning([values, level + reach, level - reach], 0.04), HEIGHT - LABEL, LABEL)
    drawn = list(_spans(rows, vehicle, parts, x))
    at, middle, half, shown = _thinned(np.array([np.arange(float(len(values))), level, reach, values]), most)
    around, edges = np.append(at, at[::-1]), np.append(middle + half, (middle - half)[::-1])
    drawn.append(element("path", d=f"M{' '.join(_points(x, y, around, edges))}Z", class_="fleet-band"))
    drawn.append(element("path", d=f"M{' '.join(_points(x, y, at, middle))}", class_="fleet-level"))
    dots = "".join(f"M{point}h0" for point in _points(x, y, at, shown))
    drawn.append(element("path", d=dots, class_="fleet-points"))
    for one in alarms:
        place = x.at(one.change.first - 0.5)
        name = places[vehicle, one.figure, one.began]
        drawn.append(element("line", x1=place, x2=place, y1=0.0, y2=HEIGHT, class_="edge", id=name))
    for value, line in ((y.high, 9.0), (y.low, HEIGHT - 3.0)):  # above and below the flights
        drawn.append(element("text", number(value), x=MARGIN, y=line, class_="tick"))
    return drawing(
        WIDTH, HEIGHT, f"{rows.figure[0]} of {vehicle} over {count(len(values), 'flight')}.", drawn
    )


def _spans(rows: FigureTable, vehicle: str, parts: Parts, x: Scale) -> Iterator[Markup]:
    """Yield the stretches of flights with one part, every second one colored; of a figure of one place only."""
    places = sorted({place for text in set(rows.parts) for place in text.split()})
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
            yield element("text", serial, x=right - 4.0, y=9.0, class_="tick end part")
        begin = end


def _thinned(rows: FloatArray, most: int) -> FloatArray:
    """Return rows (k, n) as they are, or the means (k, most) of neighbors."""
    count = rows.shape[1]
    if count <= most:
        return rows
    starts = np.arange(most) * count // most
    return np.asarray(np.add.reduceat(rows, starts, axis=1) / np.diff([*starts, count]))


def _points(x: Scale, y: Scale, at: FloatArray, values: FloatArray) -> list[str]:
    pairs = np.column_stack([x.at(at), y.at(values)])
    return ("%.1f,%.1f " * len(pairs) % tuple(pairs.ravel().tolist())).split()
