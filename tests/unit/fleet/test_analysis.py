"""A made-up fleet: what was changed is found, dated and explained by the part that was exchanged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stoop.fleet.analysis import DAY, FleetAnalysis, analyze, figure_model
from stoop.fleet.parts import Fitting, Parts
from stoop.fleet.table import FigureTable

VEHICLES, FLIGHTS = 8, 50
EXCHANGED, UPDATED = 20, 35  #: flights
LEVEL, PART, FLIGHT = 0.05, 0.02, 0.01  #: standard deviations
CHANGED = "v3"


def fleet(seed: int = 1) -> tuple[FigureTable, Parts]:
    """Return thrusts of a rotor that is exchanged once, and drags, of a year with a season."""
    rng, fittings, rows = np.random.default_rng(seed), [], []
    for v in range(VEHICLES):
        name, days = f"v{v}", np.sort(rng.uniform(0.0, 365.0, FLIGHTS))
        moment = float(days[EXCHANGED] * DAY - 1.0)
        fittings += [
            Fitting(name, "rotor_1", f"{name}a", -np.inf, moment), Fitting(name, "rotor_1", f"{name}b", moment, np.inf),
        ]  # fmt: skip
        for figure, place in (("thrust", "rotor_1"), ("drag", "")):
            level, part = LEVEL * rng.standard_normal(), PART * rng.standard_normal(2)
            for i, day in enumerate(days):
                season, error = np.sin(day / 58.0), rng.uniform(0.01, 0.03)
                own = part[int(i >= EXCHANGED)] if place else 0.0
                value = 1.0 + level + own + 0.03 * season + np.hypot(FLIGHT, error) * rng.standard_normal()
                software = "1.1" if i >= UPDATED else "1.0"
                rows.append((day * DAY, f"{name}-{i}", name, figure, software, place, value, error, season))
    time, *texts, value, error, season = zip(*sorted(rows), strict=True)
    names = ("flight", "vehicle", "figure", "software", "parts")
    numbers = {"time": np.array(time), "value": np.array(value), "std_error": np.array(error)}
    table = FigureTable.of_columns(
        dict(zip(names, texts, strict=True)), numbers, {"season": np.array(season)}
    )
    return table, Parts(tuple(fittings))


def changed(table: FigureTable, figure: str, first: int, size: float) -> FigureTable:
    """Return the table with a step of a vehicle's figure from a flight on."""
    own = [v == CHANGED and f == figure for v, f in zip(table.vehicle, table.figure, strict=True)]
    late = [int(flight.partition("-")[2]) >= first for flight in table.flight]
    return replace(table, value=table.value + size * (np.array(own) & np.array(late)))


def of_changed(found: FleetAnalysis) -> list[tuple[str, str, str]]:
    return [(a.figure, a.began, a.causes[0].what) for a in found.alarms if a.vehicle == CHANGED]


def test_the_model_tells_vehicles_from_parts() -> None:
    table, parts = fleet()
    one = figure_model(table.of("thrust"), parts, np.zeros(VEHICLES * FLIGHTS))
    assert one.model.deviations["vehicle"] == pytest.approx(LEVEL, rel=0.6)
    assert one.model.deviations["rotor_1"] == pytest.approx(PART, rel=0.5)
    assert one.model.flight == pytest.approx(FLIGHT, rel=0.4)
    season = one.model.coefficients[1] / np.std(table.conditions["season"])
    assert season == pytest.approx(0.03, abs=0.005)
    assert one.outliers == ()


def test_a_bad_part_is_named_and_does_not_widen_the_others() -> None:
    table, parts = fleet()
    found = analyze(changed(table, "thrust", EXCHANGED, -0.15), parts, 0.1)
    assert of_changed(found) == [("thrust", f"v3-{EXCHANGED}", "rotor_1: v3b for v3a")]
    (alarm,) = (a for a in found.alarms if a.vehicle == CHANGED)
    assert alarm.found in {f"v3-{EXCHANGED + i}" for i in range(3)}
    assert alarm.causes[0].probability > 0.9
    assert alarm.change.interval[0] < -0.15 < alarm.change.interval[1]
    model = found.figures["thrust"]
    assert model.model.deviations["rotor_1"] < 2.0 * PART


def test_an_update_and_what_nobody_recorded() -> None:
    table, parts = fleet()
    for first, cause in ((UPDATED, "software: 1.1 for 1.0"), (28, "")):
        found = analyze(changed(table, "drag", first, 0.08), parts, 0.1)
        ((figure, began, what),) = of_changed(found)
        assert (figure, what) == ("drag", cause)
        assert abs(int(began.partition("-")[2]) - first) <= 1


def test_the_same_seed_gives_the_same() -> None:
    table, parts = fleet()
    first, again = (analyze(table, parts, seed=3) for _ in range(2))
    assert first.threshold == again.threshold
    assert first.alarms == again.alarms
