"""A made-up fleet: changes of a vehicle and updates of all are found, dated and explained."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import made_up
from fleet.made_up import CHANGED, EXCHANGED, UPDATED, changed, fleet
from scipy.stats import kstest

from stoop.base.arrays import FloatArray
from stoop_fleet.analysis import analyze, figure_model
from stoop_fleet.causes import EVERY
from stoop_fleet.changes import Readings
from stoop_fleet.software_updates import common_steps, significant
from stoop_fleet.table import FigureTable


def test_the_model_tells_vehicles_from_parts() -> None:
    table, parts = fleet()
    one = figure_model(table.of("thrust"), parts, np.zeros(made_up.VEHICLES * made_up.FLIGHTS))
    model = one.model
    assert model.deviations["vehicle"] == pytest.approx(made_up.LEVEL, rel=0.6)
    assert model.deviations["rotor_1"] == pytest.approx(made_up.PART, rel=0.5)
    assert model.flight == pytest.approx(made_up.FLIGHT, rel=0.4)
    assert model.coefficients[1] / np.std(table.conditions["season"]) == pytest.approx(0.03, abs=0.005)
    assert one.outliers == ()


def test_a_bad_part_is_named_and_does_not_widen_the_others() -> None:
    table, parts = fleet()
    found = analyze(changed(table, "thrust", EXCHANGED, -0.15), parts, 0.1)
    (alarm,) = (a for a in found.alarms if a.vehicle == CHANGED)
    said = (alarm.figure, alarm.began, alarm.causes[0].what)
    assert said == ("thrust", f"v3-{EXCHANGED}", "rotor_1: v3b for v3a")
    assert alarm.found in {f"v3-{EXCHANGED + i}" for i in range(3)}
    assert alarm.causes[0].probability > 0.9
    assert alarm.change.interval[0] < -0.15 < alarm.change.interval[1]
    assert found.figures["thrust"].model.deviations["rotor_1"] < 2.0 * made_up.PART


BEFORE, AFTER = 12, 8  #: flights


def sequence(vehicle: int, values: FloatArray, software: list[str]) -> tuple[FigureTable, Readings]:
    """Return readings with errors of one about a level of which nothing is known, a flight a day."""
    count = len(values)
    time, errors = 86400.0 * np.arange(count) + vehicle, np.ones(count)
    texts = {"flight": [f"{vehicle}-{i}" for i in range(count)], "vehicle": [str(vehicle)] * count}
    texts |= {"figure": ["drag"] * count, "software": software}
    table = FigureTable.of_columns(texts, {"time": time, "value": values, "std_error": errors}, {})
    return table, Readings.about_a_level(values, errors, time)


def drawn(rng: np.random.Generator, count: int, step: float = 0.0) -> dict[str, tuple[FigureTable, Readings]]:
    software, n, out = ["1.0"] * BEFORE + ["1.1"] * AFTER, BEFORE + AFTER, {}
    for v in range(count):
        values = rng.standard_normal(n) + (step + rng.standard_normal()) * (np.arange(n) >= BEFORE)
        out[str(v)] = sequence(v, values, software)
    return out


def test_the_mean_step_is_that_of_the_differences_and_its_error_that_of_their_scatter() -> None:
    """Of equal errors Hartung's and Knapp's mean and error are those of Student's t."""
    sequences = drawn(np.random.default_rng(1), 9, 2.0)
    steps = np.array([r.values[BEFORE:].mean() - r.values[:BEFORE].mean() for _, r in sequences.values()])
    (one,) = common_steps(sequences)
    assert (one.before, one.after) == ("1.0", "1.1")
    assert (one.size, one.error) == pytest.approx((steps.mean(), steps.std(ddof=1) / 3.0))
    assert (one.began, one.found) == (BEFORE * 86400.0, BEFORE * 86400.0 + 2.0)


def test_an_update_that_changes_vehicles_differently_and_none_on_average_is_none() -> None:
    rng = np.random.default_rng(2)
    chances = [common_steps(drawn(rng, 6))[0].chance for _ in range(300)]
    assert kstest(chances, "uniform").pvalue > 0.01


def test_an_update_is_taken_between_the_one_before_and_the_one_after() -> None:
    software, values = ["1.0"] * 10 + ["1.1"] * 10 + ["1.0"] * 10, np.repeat([0.0, 5.0, 1.0], 10)
    update, back = common_steps({str(v): sequence(v, values, software) for v in range(3)})
    assert (update.size, back.size) == pytest.approx((5.0, -4.0))
    assert (back.before, back.after) == ("1.1", "1.0")
    (one,) = common_steps(drawn(np.random.default_rng(3), 2, 50.0))
    assert one.chance == 1.0, "of two vehicles"
    assert significant({"drag": [one]}) == {"drag": []}


def test_an_update_that_changes_all_vehicles_is_told_once_beside_the_change_of_a_vehicle() -> None:
    table, parts = fleet()
    own = np.array([f == "thrust" and s == "1.1" for f, s in zip(table.figure, table.software, strict=True)])
    updated = replace(table, value=table.value + 0.08 * own)
    found = analyze(changed(updated, "thrust", UPDATED - 10, -0.15), parts, 0.1).alarms
    alarm, own = found
    assert (alarm.vehicle, own.vehicle, own.began) == (EVERY, CHANGED, f"{CHANGED}-{UPDATED - 10}")
    assert (alarm.figure, alarm.causes[0].what) == ("thrust", "software: 1.1 for 1.0")
    assert alarm.change.interval[0] < 0.08 < alarm.change.interval[1]
    first = table.software.index("1.1")
    assert (alarm.began, alarm.began_time) == (table.flight[first], table.time[first])


def test_a_vehicle_that_always_differed_did_not_change() -> None:
    table, parts = fleet()
    found = analyze(changed(table, "drag", 0, 0.4), parts, 0.1)
    assert found.alarms == ()
    (one,) = found.figures["drag"].outliers
    assert (one.group, one.level, one.difference) == ("vehicle", 3, pytest.approx(0.4, abs=0.15))
    assert len(found.figures["drag"].rows.value) == made_up.VEHICLES * made_up.FLIGHTS
