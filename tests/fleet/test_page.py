"""The page of a fleet: what it shows, what came from a file as text, and its size with many flights."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from fleet.made_up import EXCHANGED, FLIGHTS, changed, fleet

from stoop.report.sheet import render_sheet
from stoop_fleet.analysis import FleetAnalysis, analyze
from stoop_fleet.mixed_model import Outlier, indices
from stoop_fleet.page import MOST, NEAR, _thinned, fleet_page
from stoop_fleet.parts import Parts, day
from stoop_fleet.store import Fleet, ToldAlarm
from stoop_fleet.table import FigureTable


@cache
def exchanged() -> tuple[FigureTable, Parts, FleetAnalysis, ToldAlarm]:
    table, parts = fleet()
    worn = changed(table, "thrust", EXCHANGED, -0.15)
    found = analyze(worn, parts, 0.1)
    (alarm,) = (ToldAlarm.of(one, worn.of(one.figure).unit[-1]) for one in found.alarms)
    return worn, parts, found, alarm


def rendered(table: FigureTable, parts: Parts, found: FleetAnalysis, alarms: tuple[ToldAlarm, ...]) -> str:
    one = Fleet(Path("store"), table, parts, 0.1, found.threshold, alarms)
    return render_sheet(fleet_page(one, found, "stoop fleet x.csv").content)


def cells(html: str) -> list[list[str]]:
    rows = re.findall(r"<tr[^>]*>(.*?)</tr>", html, re.DOTALL)
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in rows]


def test_alarms_come_first_and_their_vehicles_are_open() -> None:
    worn, parts, found, alarm = exchanged()
    html = rendered(worn, parts, found, (alarm, replace(alarm, figure="drag", withdrawn=True)))
    places = [html.index(one) for one in ("rotor_1: v3b for v3a", "Withdrawn", 'id="v3"', 'id="v0"')]
    assert places == sorted(places)
    texts = ("<svg", 'class="edge"', '<a href="#change-0">thrust</a>', 'id="change-0"')
    assert [html.count(text) for text in texts] == [2 * 8, 1, 1, 1]
    assert "v3a</text>" in html, "serials of the part"
    known = replace(alarm, size=-0.15, std_error=0.02, unit="N")
    assert "<td>−0.150 (−0.189 to −0.111) N</td>" in rendered(worn, parts, found, (known,))
    units = [replace(alarm, unit=unit, kind=kind).per for unit in ("N", "1") for kind in ("step", "drift")]
    assert units == [" N", " N a day", "", " a day"]


def test_an_alarm_opens_the_flights_around_it() -> None:
    """Five before it began to five after it was found, the others counted; a withdrawn one, too, as long as they are there."""
    worn, parts, found, alarm = exchanged()
    assert (alarm.began, alarm.found) == ("v3-20", "v3-20")
    late, gone = (replace(alarm, found=f"v3-{k}", withdrawn=True) for k in (40, 99))
    html = rendered(worn, parts, found, (alarm, late, gone))
    (head, first, *rows, last), whole = map(cells, re.findall(r"<details>(.*?)</details>", html, re.DOTALL))
    assert head == ["flight", "day", "value (95 %)", "software", "rotor_1", "change"]
    more = EXCHANGED - NEAR, FLIGHTS - EXCHANGED - NEAR - 1
    assert [first[0], last[0]] == [f"{n} more flights" for n in more]
    own = worn.of("thrust").rows(np.array([v == "v3" for v in worn.of("thrust").vehicle]))
    for k, row in zip(range(EXCHANGED - NEAR, EXCHANGED + NEAR + 1), rows, strict=True):
        serial, mark = "v3a" if k < EXCHANGED else "v3b", "began, found" if k == EXCHANGED else ""
        assert [*row[:2], *row[3:]] == [f"v3-{k}", str(day(own.time[k])), "1.0", serial, mark]
        value, low, high = map(float, re.findall(r"[\d.]+", row[2]))
        assert (high - low, high + low) == pytest.approx((3.92 * own.std_error[k], 2.0 * value), abs=0.004)
        assert abs(value - own.value[k]) < 0.05, "but for the season"
    assert [row[0].split()[0] for row in whole if "more" in row[0]] == ["15", "11", "4"]


def test_what_is_unlike_the_fleet_is_told() -> None:
    """A vehicle by its figures; a part by its serial, with the vehicle that flew it last."""
    table, parts = fleet()
    own = np.array([v == "v5" and f == "drag" for v, f in zip(table.vehicle, table.figure, strict=True)])
    far = replace(table, value=table.value + 0.6 * own)
    found = analyze(far, parts, 0.1)
    html = rendered(far, parts, found, ())
    _, row = cells(html.partition('id="unlike-the-fleet"')[2].partition("</table>")[0])
    assert row[:3] == ["v5", "–", "drag"]
    assert float(row[3].split()[0]) == pytest.approx(0.6, abs=0.2)
    thrust = found.figures["thrust"]
    names = indices(parts.serials("rotor_1", thrust.rows.vehicle, thrust.rows.time))[1]
    level = names.index("v2b")
    model = replace(thrust.model, design=thrust.model.design.with_apart("rotor_1", level))
    apart = replace(thrust, model=model, outliers=(Outlier("rotor_1", level, -0.2, 0.01, -9.0),))
    html = rendered(far, parts, replace(found, figures={"thrust": apart}), ())
    assert ["v2", "rotor_1: v2b", "thrust", "−0.200 (−0.220 to −0.180)"] in cells(html)
    worn, parts, found, _ = exchanged()
    assert "Unlike the fleet" not in rendered(worn, parts, found, ())


def test_names_are_text() -> None:
    (table, parts), bad = fleet(), "<script>alert(1)</script>"
    worn = changed(table, "thrust", EXCHANGED, -0.15)
    vehicle = tuple(bad if v == "v0" else v for v in worn.vehicle)
    flight, software = (tuple(x + bad for x in column) for column in (worn.flight, worn.software))
    named = replace(worn, vehicle=vehicle, flight=flight, software=software)
    fitted = Parts(tuple(replace(one, serial=one.serial + bad) for one in parts.fittings))
    found = analyze(named, fitted, 0.1)
    html = rendered(named, fitted, found, tuple(ToldAlarm.of(one, "N") for one in found.alarms))
    assert bad not in html
    for name in ("", "v3-20", "1.0", "v3b"):
        assert f">{name}&lt;script&gt;alert" in html


def test_a_panel_of_few_points_has_the_means_of_neighbors() -> None:
    rows = np.random.default_rng(0).standard_normal((1, 2 * MOST))
    assert _thinned(rows, MOST) == pytest.approx(rows.reshape(1, -1, 2).mean(axis=2))
    assert np.array_equal(_thinned(rows, 2 * MOST), rows)
