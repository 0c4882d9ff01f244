"""The page of a fleet: its alarms, and for each vehicle every figure over the flights, with changes and parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.extend.arrays import FloatArray
from stoop.extend.fits import NORMAL_95
from stoop.extend.reports import plots, sheet, svg
from stoop.extend.text import count, number, rounded_to_error
from stoop_fleet.analysis import Alarm, FigureModel, FleetAnalysis
from stoop_fleet.causes import EVERY, SOFTWARE
from stoop_fleet.parts import Fitting, Parts, day
from stoop_fleet.store import Fleet, ToldAlarm, shown_unit
from stoop_fleet.table import FigureTable

WIDTH, HEIGHT, MARGIN, LABEL = 300.0, 124.0, 6.0, 14.0
MOST: Final = 300  #: points of a panel; of more flights means of neighbors are shown
POINTS, FEWEST = 200_000, 20  #: of all panels, about; of a panel in any case
NAMED: Final = 7.0  #: px for a letter of a part's serial
STRIP, GAP = 5.0, 1.5  #: px, of a place below the panel
HUES: Final = 8  #: colors of parts, `.hue0` and so on of the style sheet
OPENED, NEAR = 200, 5  #: newest alarms that show their flights; flights before and after its beginning
OUTLYING: Final = 20  #: levels in the table, at most
#: vehicle, figure and first flight of a change -> its name in the page
Places = Mapping[tuple[str, str, str], str]
#: serial or version, with place and days, color, first flight, and that after the last
Span = tuple[str, str, int, int, int]
#: by place, in the order in which the figure depends on them, and last the software
Spans = dict[str, list[Span]]
HEAD: Final = ("vehicle", "figure", "change (95 %)", "since when, and why")
FLIGHTS: Final = ("flight", "day", "value (95 %)", "software")
UNLIKE: Final = ("vehicle", "part", "figure", "difference (95 %)")
LEGEND: Final = (
    ("swatch fleet-point", "a flight"), ("swatch fan-most", "what 95 % of the flights lie in"),
    ("swatch edgekey", "a change began"), ("swatch fleet-part", "parts, and below the software"),
)  # fmt: skip
READ: Final = """\
Each panel has the flights of the vehicle side by side, in order of time; values are those at the mean conditions of the fleet. \
The line is the level of the vehicle with the changes that were found. A part has one of eight colors, the same in all panels: \
that in the first place on which the figure depends stands behind the flights, its other places below, and last the software."""
APART: Final = """\
These differ from the mean of the fleet by more than vehicles, or parts in this place, differ by chance; changes that were found \
are taken off."""


@dataclass(frozen=True, eq=False)
class Marks:
    """What marks panels: changes, the fittings of each vehicle, and a color for each kind and serial of a part."""

    places: Places
    fittings: Mapping[str, Sequence[Fitting]]
    hues: Mapping[tuple[str, str], int]

    @classmethod
    def of(cls, fleet: Fleet, found: FleetAnalysis) -> Marks:
        """Return the marks of a fleet; parts that are next to each other in the table differ in color."""
        places = {
            (one.vehicle, one.figure, one.began): f"change-{i}"
            for i, one in enumerate(found.alarms)
            if one.vehicle != EVERY
        }
        fittings = fleet.parts.fittings
        own = {vehicle: list(group) for vehicle, group in groupby(fittings, lambda one: one.vehicle)}
        named = dict.fromkeys((one.kind, one.serial) for one in fittings)
        named |= dict.fromkeys((SOFTWARE, version) for version in sorted(set(fleet.table.software)))
        return cls(places, own, {key: i % HUES for i, key in enumerate(named)})

    def spans(self, rows: FigureTable, most: int) -> Spans:
        """Return the spans of a vehicle, those narrower than one of `most` points left out."""
        places, count = " ".join(dict.fromkeys(rows.parts)).split(), len(rows.flight)
        out: Spans = {place: [] for place in [*(one for one in places if one != SOFTWARE), SOFTWARE]}
        updates = [k for k, (before, after) in enumerate(pairwise(rows.software), 1) if before != after]
        found = [(SOFTWARE, SOFTWARE, rows.software[k], k, end) for k, end in pairwise([0, *updates, count])]
        for one in self.fittings.get(rows.vehicle[0], ()):
            first, end = rows.time.searchsorted([one.begin, one.end]).tolist()
            found.append((one.part, one.kind, one.serial, first, end))
        for place, kind, name, first, end in found:
            if place in out and name and (end - first) * most >= count:
                told = f"{place}: {name}, {_ends(rows.time[first:end])}"
                out[place].append((name, told, self.hues[kind, name], first, end))
        return out


def fleet_page(fleet: Fleet, found: FleetAnalysis, command: str = "") -> sheet.Page:
    """Return the page; vehicles with alarms come first and are open."""
    accused = {one.vehicle for one in found.alarms}
    vehicles = sorted(set(fleet.table.vehicle), key=lambda name: (name not in accused, name))
    lead = (
        f"{fleet.extent()}. {count(len(found.alarms), 'change')} found; of a fleet in which nothing changes "
        f"{fleet.alarms_a_year:g} a year would be told."
    )
    marks = Marks.of(fleet, found)
    sections = [sheet.Section("Alarms", tuple(_tables(fleet, found, marks.places)))]
    if unlike := tuple(_unlike(found, fleet.parts)):
        table = sheet.Table("", UNLIKE, unlike, ("",) * len(UNLIKE), ("told",) * len(unlike))
        sections.append(sheet.Section("Unlike the fleet", (sheet.Prose(APART, muted=True), table)))
    most = POINTS // max(sum(len(one.sequences) for one in found.figures.values()), 1)
    key: tuple[sheet.Prose | sheet.Legend, ...] = (sheet.Prose(READ, muted=True), sheet.Legend(LEGEND))
    for name in vehicles:
        shown = MOST if name in accused else min(max(most, FEWEST), MOST)
        panels = sheet.Panels([*_panels(name, found, marks, shown)])
        sections.append(sheet.Section(name, (*key, panels), folded=name not in accused))
        key = ()
    if command:
        sections.append(sheet.Section("Made by", (sheet.Code(command),)))
    return sheet.Page(
        sheet.Sheet("What changed in the fleet", lead, tuple(sections), "fleet", script="fleet.js")
    )


def _interval(value: float, error: float) -> str:
    """Return a value with its 95 % interval, to the second digit of its standard error."""
    ends = (value, value - NORMAL_95 * error, value + NORMAL_95 * error)
    return "{} ({} to {})".format(*(rounded_to_error(one, error)[0] for one in ends))


def _tables(fleet: Fleet, found: FleetAnalysis, places: Places) -> Iterator[sheet.Table | sheet.Prose]:
    newest = sorted(fleet.alarms, key=lambda one: one.found_time)[-OPENED:]
    flights = {one: _flights(one, found, fleet.parts) for one in newest}
    for caption, withdrawn in (("Standing", False), ("Withdrawn: later flights no longer show them", True)):
        listed = [one for one in fleet.alarms if one.withdrawn is withdrawn]
        own = tuple(_row(one, places, flights.get(one)) for one in listed)
        if own:
            yield sheet.Table(caption, HEAD, own, ("", "", "", "wrap fold"), ("told",) * len(own))
        elif not withdrawn:
            yield sheet.Prose("None.")


def _row(one: ToldAlarm, places: Places, flights: sheet.Table | None) -> tuple[str | sheet.Details, ...]:
    """Return the cells of an alarm, which opens its flights, with a link to its change in the panel of the figure."""
    figure = one.figure
    if not one.withdrawn and (place := places.get((one.vehicle, one.figure, one.began))):
        figure = Markup('<a href="#{}">{}</a>').format(place, figure)
    why = Markup("since {} (<time>{}</time>), found in {}: {}").format(
        one.began, day(one.began_time), one.found, one.explanation or "–"
    )
    shown = why if flights is None else sheet.Details(why, (flights,))
    return one.vehicle, figure, f"{_interval(one.size, one.std_error)}{one.per}", shown


def _flights(one: ToldAlarm, found: FleetAnalysis, parts: Parts) -> sheet.Table | None:
    """Return the flights near the beginning and the alarm, the others counted; None where the tables no longer have them."""
    try:
        figure = found.figures[one.figure]
        rows, readings = figure.sequences[one.vehicle]
        began, alarm = map(rows.flight.index, (one.began, one.found))
    except (KeyError, ValueError):
        return None
    near = {*range(began - NEAR, began + NEAR), *range(alarm - NEAR + 1, alarm + NEAR + 1)}
    values, place = readings.values + figure.mean(rows.software), one.causes[0].place
    serials = parts.serials(place, rows.vehicle, rows.time)
    lines: list[tuple[str, ...]] = [(*FLIGHTS, place, "change")]
    for before, k in pairwise([-1, *sorted(near & {*range(len(values))}), len(values)]):
        if k - before > 1:
            lines.append((count(k - before - 1, "more flight"), *[""] * len(FLIGHTS), ""))
        if k < len(values):
            value = _interval(values[k], rows.std_error[k]) + shown_unit(rows.unit[k])
            change = ", ".join(["began"] * (k == began) + ["found"] * (k == alarm))
            told = str(day(rows.time[k])), value, rows.software[k], serials[k] or "", change
            lines.append((rows.flight[k], *told))
    head, *body = zip(*(column for column in zip(*lines, strict=True) if any(column[1:])), strict=True)
    caption = f"{one.figure} at the mean conditions of the fleet"
    kinds = tuple("" if any(line[1:]) else "unsure" for line in body)
    return sheet.Table(caption, head, tuple(body), ("",) * len(head), kinds)


def _unlike(found: FleetAnalysis, parts: Parts) -> Iterator[tuple[str, ...]]:
    """Yield a row for each level unlike the others, the clearest first; a part with the vehicle that flew it last."""
    every = [
        (one, figure.rows, int(np.flatnonzero(own)[-1]))  # the last columns are the levels, see `with_apart`
        for figure in found.figures.values()
        for one, own in zip(figure.outliers[::-1], figure.model.design.fixed.T[::-1], strict=False)
    ]
    for one, rows, k in sorted(every, key=lambda level: -abs(level[0].ratio))[:OUTLYING]:
        (serial,) = parts.serials(one.group, [rows.vehicle[k]], rows.time[k : k + 1])
        part = f"{one.group}: {serial}" if serial else "–"
        difference = _interval(one.difference, one.error) + shown_unit(rows.unit[-1])
        yield rows.vehicle[k], part, rows.figure[k], difference


def _panels(vehicle: str, found: FleetAnalysis, marks: Marks, most: int) -> Iterator[sheet.Panel]:
    for name, figure in found.figures.items():
        if vehicle in figure.sequences:
            alarms = (one for one in found.alarms if (one.vehicle, one.figure) == (vehicle, name))
            own = {marks.places[vehicle, name, one.began]: one for one in alarms}
            rows = figure.sequences[vehicle][0]
            spans = marks.spans(rows, most)
            drawn, unit = _drawn(figure, vehicle, own, spans, most), shown_unit(rows.unit[-1]).strip()
            yield sheet.Panel(name, drawn, unit, ", ".join([*spans][:-1]), _ends(rows.time))


def _ends(time: FloatArray) -> str:
    return f"{day(time[0])} to {day(time[-1])}"


def _drawn(figure: FigureModel, vehicle: str, alarms: Mapping[str, Alarm], spans: Spans, most: int) -> Markup:
    rows, readings = figure.sequences[vehicle]
    mean = figure.mean(rows.software)
    values = readings.values + mean
    course = sum((one.change.course(readings.times) for one in alarms.values()), mean)
    weights = readings.deviations**-2.0
    level = course + weights @ (values - course) / weights.sum()
    reach = NORMAL_95 * readings.deviations
    x = svg.Scale(-0.5, len(values) - 0.5, MARGIN, WIDTH - MARGIN)
    y = svg.Scale(*plots.spanning([values, level + reach, level - reach], 0.04), HEIGHT - LABEL, LABEL)
    *places, software = spans.values()
    drawn = [mark for own in places[:1] for mark in _strip(own, x, 0.0, HEIGHT, "fleet-span")]
    at, middle, half, shown = _thinned(np.array([np.arange(float(len(values))), level, reach, values]), most)
    around, edges = np.append(at, at[::-1]), np.append(middle + half, (middle - half)[::-1])
    drawn.append(svg.element("path", d=f"M{' '.join(_points(x, y, around, edges))}Z", class_="fleet-band"))
    drawn.append(svg.element("path", d=f"M{' '.join(_points(x, y, at, middle))}", class_="fleet-level"))
    dots = "".join(f"M{point}h0" for point in _points(x, y, at, shown))
    drawn.append(svg.element("path", d=dots, class_="fleet-points"))
    height = HEIGHT
    for own in filter(None, [*places[1:], software]):
        drawn += _strip(own, x, height + GAP, STRIP, "fleet-strip")
        height += GAP + STRIP
    for name, one in alarms.items():
        place, began = x.at(one.change.first - 0.5), str(day(rows.time[one.change.first]))
        told = {"class_": "edge", "id": name, "data_began": began}
        drawn.append(svg.element("line", x1=place, x2=place, y1=0.0, y2=height, **told))
    for value, line in ((y.high, 9.0), (y.low, HEIGHT - 3.0)):  # above and below the flights
        drawn.append(svg.element("text", number(value), x=MARGIN, y=line, class_="tick"))
    return svg.drawing(
        WIDTH, height, f"{rows.figure[0]} of {vehicle} over {count(len(values), 'flight')}.", drawn
    )


def _strip(spans: Sequence[Span], x: svg.Scale, top: float, height: float, kind: str) -> Iterator[Markup]:
    """Yield spans in their colors, with their names where there is room."""
    for name, told, hue, first, end in spans:
        left, right, color = x.at(first - 0.5), x.at(end - 0.5), f"{kind} hue{hue}"
        box = {"x": left, "y": top, "width": right - left, "height": height}
        yield svg.element("rect", svg.element("title", told), **box, class_=color)
        if height > LABEL and right - left > NAMED * len(name):
            yield svg.element("text", name, x=right - 4.0, y=9.0, class_="tick end")


def _thinned(rows: FloatArray, most: int) -> FloatArray:
    """Return rows (k, n) as they are, or the means (k, most) of neighbors."""
    count = rows.shape[1]
    if count <= most:
        return rows
    starts = np.arange(most) * count // most
    return np.asarray(np.add.reduceat(rows, starts, axis=1) / np.diff([*starts, count]))


def _points(x: svg.Scale, y: svg.Scale, at: FloatArray, values: FloatArray) -> list[str]:
    pairs = np.column_stack([x.at(at), y.at(values)])
    return ("%.1f,%.1f " * len(pairs) % tuple(pairs.ravel().tolist())).split()
