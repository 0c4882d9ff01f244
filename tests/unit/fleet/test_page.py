"""The page of a fleet: what it shows, what came from a file as text, and its size with many flights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.fleet.made_up import EXCHANGED, changed, fleet

from stoop.fleet.analysis import analyze
from stoop.fleet.page import MOST, _thinned, fleet_page
from stoop.fleet.parts import Parts
from stoop.fleet.store import Fleet, ToldAlarm
from stoop.fleet.table import FigureTable
from stoop.report.sheet import render_sheet


def page(table: FigureTable, parts: Parts) -> str:
    found = analyze(table, parts, 0.1)
    alarms = tuple(ToldAlarm.of(one, table.of(one.figure).unit[-1]) for one in found.alarms)
    withdrawn = tuple(replace(one, figure="drag", withdrawn=True) for one in alarms)
    one = Fleet(Path("store"), table, parts, 0.1, found.threshold, alarms + withdrawn)
    return render_sheet(fleet_page(one, found, "stoop fleet x.csv").content)


def test_alarms_come_first_and_their_vehicles_are_open() -> None:
    table, parts = fleet()
    html = page(changed(table, "thrust", EXCHANGED, -0.15), parts)
    assert html.index("rotor_1: v3b for v3a") < html.index("Withdrawn") < html.index('id="v3"')
    assert html.index('id="v3"') < html.index('id="v0"')
    assert html.count("<svg") == 2 * 8
    assert html.count('class="edge"') == 1, "the change of v3"
    assert "v3a</text>" in html, "serials of the part"
    assert html.count('<a href="#change-0">since v3-20') == 1, "an alarm leads to its panel"
    assert html.count('id="change-0"') == 1
    assert "alarms only" in html


def test_figures_are_shown_in_their_units() -> None:
    """Of those that have one; the size of an alarm, too."""
    table, parts = fleet()
    units = tuple("N" if figure == "thrust" else "1" for figure in table.figure)
    worn = replace(changed(table, "thrust", EXCHANGED, -0.15), unit=units)
    (alarm,) = (ToldAlarm.of(one, "N") for one in analyze(worn, parts, 0.1).alarms)
    assert alarm.per == " N"
    assert replace(alarm, kind="drift").per == " N a day"
    assert replace(alarm, unit="1", kind="drift").per == " a day"
    html = page(worn, parts)
    assert html.count(" [N]") == 8, "a panel of each vehicle"
    assert " N</td>" in html


def test_names_are_text() -> None:
    table, parts = fleet()
    bad = "<script>alert(1)</script>"
    named = replace(table, vehicle=tuple(bad if v == "v0" else v for v in table.vehicle))
    html = page(named, parts)
    assert bad not in html
    assert "&lt;script&gt;alert" in html


def test_a_panel_of_few_points_has_the_means_of_neighbors() -> None:
    flights = 2 * MOST
    rows = np.random.default_rng(0).standard_normal((1, flights))
    assert _thinned(rows, MOST).shape == (1, MOST)
    assert _thinned(rows, MOST)[0, :3] == pytest.approx(rows.reshape(-1, 2).mean(axis=1)[:3])
    assert np.array_equal(_thinned(rows, flights), rows)


def test_many_flights_are_thinned() -> None:
    rng, n = np.random.default_rng(0), 4 * MOST + 7
    texts = {"flight": [f"f{i}" for i in range(n)], "vehicle": ["a"] * n, "figure": ["drag"] * n}
    numbers = {"time": 86400.0 * np.arange(n), "value": rng.standard_normal(n), "std_error": np.ones(n)}
    html = page(FigureTable.of_columns(texts, numbers, {}), Parts())
    (points,) = [line for line in html.split("<path ")[1:] if "fleet-points" in line]
    assert points.count("h0") == MOST
