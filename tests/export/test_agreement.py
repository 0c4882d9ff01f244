"""Agreement of another tool with our simulation: every axis and channel, by NumPy's own regression."""

from dataclasses import replace

import numpy as np
import pytest

from stoop.simulation import trim
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text, builtin_vehicle
from stoop_export import agreement
from stoop_export.agreement import AXES, Compared, agreement_table, loads_along, loads_of_path, percent
from stoop_export.exporter import cost_without_actuators
from stoop_export.reference_flight import reference_flight, reference_record, states_of


def test_statistics_are_those_of_a_regression() -> None:
    rng = np.random.default_rng(1)
    ours = rng.normal(size=(400, 3)) * [1.0, 1e-14, 2.0]
    ours[:, 2] = 0.03 * np.arange(400)  # a heading that turns more than once
    theirs = 0.5 * ours + 0.3 + 0.2 * rng.normal(size=(400, 3))
    theirs[:, 2] = ours[:, 2] + 0.1
    wrapped = np.column_stack([ours[:, :2], (ours[:, 2] + np.pi) % (2.0 * np.pi) - np.pi])
    found = Compared("tool", "flight", ("Fx", "Fy", "psi"), wrapped, theirs)
    s = found.statistics
    assert s["slope"][0] == pytest.approx(np.polyfit(ours[:, 0], theirs[:, 0], 1)[0])
    assert s["correlation"][0] == pytest.approx(np.corrcoef(ours[:, 0], theirs[:, 0])[0, 1])
    assert s["error"][0] == pytest.approx(np.sqrt(np.mean((theirs - ours)[:, 0] ** 2)))
    assert s["share"][0] == pytest.approx(s["error"][0] / ours[:, 0].std())
    assert np.isnan([s[n][1] for n in ("slope", "correlation", "share")]).all(), "rounding beside Fx"
    assert [s["slope"][2], s["correlation"][2], s["error"][2]] == pytest.approx([1.0, 1.0, 0.1])
    assert agreement_table(found).rows[1][1:] == ("–", "0.366 N", "–", "–", "–")
    same = Compared("tool", "flight", ("Fx", "Fy"), ours[:, :2], ours[:, :2] + [0.1, 1.9e-26])
    assert agreement_table(same).rows[1][1:] == ("–", "0 N", "–", "–", "–"), "rounding prints as 0"
    assert [percent(x) for x in (1.9e-28, 0.0, 0.123, np.nan)] == ["0 %", "0 %", "12 %", "–"]


def test_axes_of_a_path_are_those_of_the_equations() -> None:
    vehicle = builtin_vehicle("twin-boom")
    flight = reference_flight(vehicle, trim(vehicle))
    whole, (names, found) = loads_along(flight), loads_of_path(flight, flight.states)
    apart = np.sqrt(np.mean((found - whole) ** 2, axis=0)) / whole.std(axis=0)
    assert names == tuple(AXES)
    assert apart.max() < 0.15, "inputs jump within a sample"
    still = np.abs(np.diff(flight.inputs, n=3, axis=0)).max(axis=1) == 0.0
    assert np.abs(found - whole)[2:-1][still].max(axis=0) == pytest.approx(0.0, abs=0.5)
    assert loads_of_path(replace(flight, vehicle=vehicle.reduced("lateral")), flight.states)[0] == ()


def test_omitted_actuators_have_a_share_of_each_axis() -> None:
    """A delay of one sample of the elevator: the loads of the elevator's change, by hand."""
    table = "\n[controls]\nelevator = { delay = 0.01 }\naileron = {}\nrudder = {}\n"
    vehicle = parse_vehicle(builtin_text("twin-boom") + table, "twin")
    record = reference_record(vehicle, trim(vehicle))
    said = cost_without_actuators(record)
    states, column = states_of(record), vehicle.inputs.index("elevator")
    late = record.inputs.copy()
    late[1:, column] = record.inputs[:-1, column]
    rows = np.repeat(record.vehicle.values[:, None], len(late), axis=1)
    moved = (u.T.copy() for u in (late, record.inputs))
    whole, prompt = (agreement.body_loads(record.vehicle, rows, states.T.copy(), u)[4] for u in moved)
    share = np.sqrt(np.mean((prompt - whole) ** 2)) / whole.std()
    assert f"{percent(share)} of My" in said
    assert "0 % of Mx" in said
