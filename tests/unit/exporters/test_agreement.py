"""Agreement of another tool with our simulation: every axis and channel, by NumPy's own regression."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop.exporters import exporter, jsbsim_aircraft, rotorpy_flight, rotorpy_model
from stoop.exporters.agreement import AXES, Compared, agreement_table, loads_along, loads_of_path, percent
from stoop.exporters.exporter import ModelData, cost_without_actuators, written
from stoop.exporters.gazebo import fly_gazebo, gazebo_loads
from stoop.exporters.gazebo_model import gazebo_model
from stoop.exporters.jsbsim_comparison import compare
from stoop.exporters.jsbsim_flight import file_name
from stoop.exporters.reference_flight import reference_flight, reference_record, states_of
from stoop.exporters.targets import export
from stoop.simulation import trim
from stoop.simulation.loads import body_loads
from stoop.vehicle.builtin import builtin_text, builtin_vehicle
from stoop.vehicle.load import load_vehicle, parse_vehicle

ROOT = Path(__file__).parents[3]


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


def test_rounding_prints_as_zero() -> None:
    assert [percent(x) for x in (1.9e-28, 0.0, 0.123, np.nan)] == ["0 %", "0 %", "12 %", "–"]


def test_page_has_every_axis() -> None:
    """The drag of rotors in the direction of flight falls with the inflow, which Gazebo has not."""
    text = builtin_text("hexa-x")
    vehicle = parse_vehicle(text.replace("[rotors]", "[rotors]\ndrag_inflow = 0.002", 1), "hexa")
    made = export(ModelData(vehicle), "gazebo")
    page = made.files["export.html"].decode()
    for axis in AXES:
        assert page.count(f'<th scope="row">{axis}</th>') == 2, "a table for PX4 and one for ArduPilot"
    (note,) = [n for n in made.notes if "rotors.drag_inflow" in n]
    assert all(f"% of {axis}" in note for axis in AXES)
    assert any("lowest correlation" in n for n in made.notes)


def test_a_lost_side_force_is_visible() -> None:
    """The hexacopter without the drag of its rotors: velocities hardly tell, the table and its sentence do."""
    vehicle = load_vehicle(ROOT / "examples/hexacopter.toml")
    point = trim(vehicle)
    flight, model = reference_flight(vehicle, point), gazebo_model(vehicle, point)
    assert flight is not None
    ours = loads_along(flight)
    whole = Compared("Gazebo", flight.title, tuple(AXES), ours, gazebo_loads(model, flight))
    assert whole.statistics["correlation"][1] > 0.999
    bare = replace(model, motors=tuple(replace(m, drag=0.0) for m in model.motors), damping=None)
    theirs = np.hstack([gazebo_loads(bare, flight), fly_gazebo(bare, flight)])
    names = (*AXES, *rotorpy_flight.CHANNELS)
    lost = Compared("Gazebo", flight.title, names, np.hstack([ours, rotorpy_flight.motion(flight)]), theirs)
    found = lost.statistics
    assert [found[n][1] for n in ("slope", "correlation", "share")] == pytest.approx(
        [0.0, 0.0, 1.0], abs=0.01
    )
    assert found["correlation"][names.index("ve")] > 0.95
    assert "lowest correlation 0 (Fx)" in str(lost)
    assert agreement_table(lost).rows[1][3:] == ("100 %", "0.00", "0.00")


def test_axes_of_a_path_are_those_of_the_equations() -> None:
    vehicle = builtin_vehicle("twin-boom")
    flight = reference_flight(vehicle, trim(vehicle))
    assert flight is not None
    names, found = loads_of_path(flight, flight.states)
    whole = loads_along(flight)
    apart = np.sqrt(np.mean((found - whole) ** 2, axis=0)) / whole.std(axis=0)
    assert names == tuple(AXES)
    assert apart.max() < 0.15, "inputs jump within a sample"
    still = np.abs(np.diff(flight.inputs, n=3, axis=0)).max(axis=1) == 0.0
    assert np.abs(found - whole)[2:-1][still].max(axis=0) == pytest.approx(0.0, abs=0.5)
    assert loads_of_path(replace(flight, vehicle=vehicle.reduced("lateral")), flight.states)[0] == ()


def test_an_axis_that_rotorpy_loses_shows(tmp_path: Path) -> None:
    pytest.importorskip("rotorpy")
    vehicle = builtin_vehicle("quad-x")
    point = trim(vehicle)
    flight, made = reference_flight(vehicle, point), rotorpy_model.rotorpy_model(vehicle, point)
    assert flight is not None
    for name, text in made.texts.items():
        (tmp_path / name).write_text(
            text.replace(f'"k_d": {made.parameters["quad_params"]["k_d"]}', '"k_d": 0.0')
        )
    script = exporter.load_script(tmp_path / f"{made.name}_rotorpy.py")
    ours = loads_along(flight)
    identified = Compared(
        "", "", tuple(AXES), ours, rotorpy_flight.rotorpy_loads(script, flight, stock=False)
    )
    assert identified.statistics["share"].max() < 1e-5, "equations printed from the same expressions"
    bare = Compared("", "", tuple(AXES), ours, rotorpy_flight.rotorpy_loads(script, flight, stock=True))
    assert bare.statistics["share"][:2].min() > 0.5, "side force without the drag of rotors"
    assert bare.statistics["share"][2:].max() < 0.2


def test_an_axis_that_jsbsim_loses_shows() -> None:
    pytest.importorskip("jsbsim")
    vehicle = builtin_vehicle("twin-boom")
    record = reference_record(vehicle, trim(vehicle))
    assert record is not None
    texts = jsbsim_aircraft.folder(vehicle, None)
    with written(texts) as root:
        same = compare(root, record).compared
    assert same.names == (*AXES, *vehicle.outputs)
    assert same.statistics["share"][:6].max() < 1e-4
    place = f"aircraft/{file_name(vehicle.name)}/{file_name(vehicle.name)}.xml"
    lost = re.sub(r'<axis name="SIDE">.*?</axis>', "", texts[place], flags=re.DOTALL)
    assert lost != texts[place]
    with written({**texts, place: lost}) as root:
        bare = compare(root, record).compared
    assert bare.statistics["slope"][1] < 0.3, "the drag has a part along the axis"
    assert bare.statistics["share"][1] > 0.5
    assert agreement_table(bare).rows[1][0] == "Fy"


def test_actuators_that_are_left_out_have_shares_of_each_axis() -> None:
    """A delay of one sample of the elevator: the loads of the elevator's change, by hand."""
    text = builtin_text("twin-boom")
    assert "[controls.elevator]" not in text
    vehicle = parse_vehicle(
        text + "\n[controls]\nelevator = { delay = 0.01 }\naileron = {}\nrudder = {}\n", "twin"
    )
    record = reference_record(vehicle, trim(vehicle))
    assert record is not None
    said = cost_without_actuators(record)
    states, column = states_of(record), vehicle.inputs.index("elevator")
    late = record.inputs.copy()
    late[1:, column] = record.inputs[:-1, column]
    rows = np.repeat(record.vehicle.values[:, None], len(late), axis=1)
    whole, prompt = (
        body_loads(record.vehicle, rows, states.T.copy(), u.T.copy())[4] for u in (late, record.inputs)
    )
    share = np.sqrt(np.mean((prompt - whole) ** 2)) / whole.std()
    assert f"{percent(share)} of My" in said
    assert "0 % of Mx" in said
