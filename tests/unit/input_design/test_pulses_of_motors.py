"""Pulses that a vehicle file calls motors: its flight is found to be one, though the log alone does not tell."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.flight import Flight
from stoop.flight.airborne import carried_by_rotors, flying
from stoop.input_design.candidates import Excitation, with_motors
from stoop.input_design.windows import _candidates, doubts, find_windows
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle

ROLL = parse_maneuver(
    'duration = 8.0\n[[input]]\ncontrol = "roll"\nshape = "3-2-1-1"\nstart = 2.0\nstep = 0.15\namplitude = 12.0\n',
    "roll.toml",
)


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    """quad-x, driven by pulses."""
    text = resolve_vehicle("quad-x").text.replace('"motor_', '"pwm_')
    drive = 'drive = "command"'
    return parse_vehicle(text.replace(drive, f"{drive}\ngain = 0.001\nidle = 1000"), "pulses.toml")


@pytest.fixture(scope="module")
def flight(vehicle: Vehicle) -> Flight:
    return simulate_flight(vehicle, ROLL, seed=1, name="f")


def test_windows_of_pulses(vehicle: Vehicle, flight: Flight) -> None:
    assert not carried_by_rotors(flight)
    found = find_windows({"f": flight}, vehicle)
    assert "roll" in [w.axis for w in found.windows]
    assert not [d for d in doubts({"f": flight}, vehicle) if "rotors" in d.code]


def test_motors_are_told_by_gain_and_idle_and_a_pusher_does_not_lift(vehicle, flight):
    told = with_motors(flight, vehicle)
    assert np.allclose(told.column("motor_3"), 0.001 * (flight.column("pwm_3") - 1000.0))
    assert flying(told).all()
    assert with_motors(flight, None) is flight
    assert with_motors(flight, resolve_vehicle("twin-boom")) is flight
    assert with_motors(told, vehicle) is told
    last = vehicle.text.index('channel = "pwm_4"')
    pusher = parse_vehicle(vehicle.text[:last] + "axis = [1, 0, 0]\n" + vehicle.text[last:], "pusher.toml")
    told = with_motors(flight, pusher)
    assert {"motor_1", "motor_2", "motor_3"} <= set(told.data)
    assert "motor_4" not in told.data


def test_all_of_a_flight_on_rotors_is_tried(vehicle: Vehicle, flight: Flight) -> None:
    """Windows without a maneuver are candidates beside those with one, of a vehicle that its rotors carry."""
    told = with_motors(flight, vehicle)
    tried = _candidates(told, vehicle, Excitation.of(told))
    maneuvers = [c for c in tried if c.maneuver is not None]
    assert maneuvers
    assert any(c.maneuver is None for c in tried)
    assert all(c.maneuver is not None for c in _candidates(told, None, Excitation.of(told)))
