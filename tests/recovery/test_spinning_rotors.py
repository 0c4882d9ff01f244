"""Rotors whose reaction is known from the slope of what was recorded: inertia, torque and delay come back together."""

from __future__ import annotations

import pytest
from recovery.maneuvers import maneuver

from stoop.estimate.fit import Options
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import parse_vehicle
from stoop.workflow import identify

ROTORS = ((1, 0.15, 0.15, "ccw"), (2, -0.15, -0.15, "ccw"), (3, 0.15, -0.15, "cw"), (4, -0.15, 0.15, "cw"))
QUAD = """
name = "quad"
[mass]
mass = 1.4
inertia = { xx = 0.019, yy = 0.019, zz = 0.03 }
[rotors]
drive = "speed"
gain = 1000.0
lag = 0.0
delay = 0.013
T2 = 1.3e-5
inflow = 3e-4
torque_ratio = 0.019
inertia = 6e-5
""" + "".join(
    f'[rotor.m{i}]\nchannel = "motor_{i}"\nposition = [{x}, {y}, 0.0]\nspin = "{spin}"\n'
    for i, x, y, spin in ROTORS
)
MANEUVER = maneuver(
    16.0, ("roll", "doublet", 1.0, 0.15, 8.0), ("pitch", "doublet", 2.0, 0.15, 8.0), ("yaw", "doublet", 3.0, 0.4, 1.5),
    ("heave", "3-2-1-1", 4.0, 0.25, 2.0), ("yaw", "doublet", 7.0, 0.2, 2.0), ("north", "doublet", 8.0, 2.0, 2.5),
    ("east", "doublet", 11.0, 2.0, 2.5),
)  # fmt: skip
WRONG = {
    "rotors.inertia": {"value": 2e-5, "free": True, "bounds": (1e-6, 3e-4)},
    "rotors.delay": {"value": 0.005, "free": True, "bounds": (0.0, 0.05)},
    "rotors.torque_ratio": {"value": 0.012},
    "rotors.T2": {"value": 1.2e-5},
}


@pytest.mark.parametrize("method", ["equation-error", ""])
def test_what_spins_rotors_up_is_found(method: str) -> None:
    true = parse_vehicle(QUAD, "quad")
    flight = simulate_flight(true, MANEUVER, seed=3, name="sim")
    found = identify(true.with_numbers(WRONG), flight, ["0:16"], options=Options(method=method))
    parameters = found.result.parameters
    assert set(WRONG) <= set(parameters)
    for name, p in parameters.items():
        assert abs(p.estimate - true.value(name)) < 3.5 * p.std_error, name
        assert p.std_error < 0.05 * true.value(name), name
