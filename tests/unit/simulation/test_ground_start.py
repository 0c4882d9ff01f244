"""A start told along the body axes, as vehicles with rotors need it, and the commands that their rotors start at."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.simulation import initial_states, parameter_rows
from stoop.simulation.delays import input_delays, late_inputs
from stoop.simulation.initial import commanded, rigid_states
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import BUILT_IN, builtin_vehicle

LATE = """
name = "late"
[mass]
mass = 1.0
inertia = { xx = 0.01, yy = 0.01, zz = 0.02 }
[rotors]
gain = 0.001
idle = 1000.0
nominal_voltage = 12.0
delay = 0.03
T2 = 20.0
[rotor.one]
channel = "pwm_1"
position = [0.0, 0.2, 0.0]
spin = "ccw"
[rotor.two]
channel = "pwm_2"
position = [0.0, -0.2, 0.0]
spin = "cw"
"""


def test_a_start_may_be_told_either_way_and_for_many_lanes() -> None:
    by_air = rigid_states({"V": 20.0, "alpha": 0.1, "beta": -0.05, "theta": 0.2})
    by_body = rigid_states({"u": by_air["u"], "v": by_air["v"], "w": by_air["w"], "theta": 0.2})
    assert by_air.keys() == by_body.keys()
    assert all(np.array_equal(by_air[name], by_body[name]) for name in by_air)
    states = rigid_states({"u": np.array([0.0, 1.0]), "q": 0.3})
    assert {n: states[n].tolist() for n in "uqv"} == {"u": [0.0, 1.0], "q": [0.3, 0.3], "v": [0.0, 0.0]}
    for name in BUILT_IN:
        vehicle = builtin_vehicle(name)
        start = dict.fromkeys(vehicle.start_names, 0.1)
        x = initial_states(vehicle, start, parameter_rows(vehicle), np.zeros(len(vehicle.inputs)))
        known = dict(zip(vehicle.states, x[:, 0], strict=True))
        assert all(known[n] == 0.1 for n in set(vehicle.start_names) & set(vehicle.states)), name


def test_lagged_rotors_start_where_they_are_commanded() -> None:
    vehicle = builtin_vehicle("quad-x")
    rows, u = parameter_rows(vehicle, None, 2), np.array([0.2, 0.4, 0.6, -0.3])
    start = {"u": 0.0, "m3.lag": np.array([0.0, 0.1])}
    x = dict(zip(vehicle.states, initial_states(vehicle, start, rows, u), strict=True))
    assert np.array_equal(x["m1.lag"], [0.2, 0.2])
    assert x["m3.lag"] == pytest.approx([0.6, 0.7])
    assert np.array_equal(x["m4.lag"], [0.0, 0.0]), "not below zero"


def test_command_goes_with_the_voltage_and_rotors_share_their_delay() -> None:
    vehicle = parse_vehicle(LATE, "late")
    assert vehicle.recorded == ("pwm_1", "pwm_2", "voltage")
    u = np.array([[1500.0, 900.0], [1200.0, 1200.0], [12.0, 9.0]])
    rows = parameter_rows(vehicle, None, 2)
    assert commanded(vehicle, "one", rows, u) == pytest.approx([0.5, 0.0])
    assert commanded(vehicle, "two", rows, u) == pytest.approx([0.2, 0.15])
    row, u = vehicle.rows["rotors.delay"], np.arange(60.0).reshape(20, 3)
    assert input_delays(vehicle) == [(0, row), (1, row)]
    late = late_inputs(vehicle, u, parameter_rows(vehicle), 0.01)
    assert np.array_equal(late[3:, :2], u[:-3, :2])
    assert np.array_equal(late[:, 2], u[:, 2])
