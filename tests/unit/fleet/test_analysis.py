"""A made-up fleet: what was changed is found, dated and explained by the part that was exchanged."""

from __future__ import annotations

import numpy as np
import pytest
from unit.fleet.made_up import (
    CHANGED,
    EXCHANGED,
    FLIGHT,
    FLIGHTS,
    LEVEL,
    PART,
    UPDATED,
    VEHICLES,
    changed,
    fleet,
)

from stoop.fleet.analysis import FleetAnalysis, analyze, figure_model


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
