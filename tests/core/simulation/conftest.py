"""The paper's aircraft, a small one with mixers, lags and delays, and a quadrotor."""

import pytest
from naive.texts import V_TAIL_LATERAL, V_TAIL_MIXERS

from stoop.vehicle import Vehicle, parse_vehicle

V_TAIL = (
    """
name = "V-tail"
mass = { mass = 8.5, inertia = { xx = 1.38, yy = 0.84, zz = 2.0, xz = 0.11 } }
reference = { area = 0.66, chord = 0.285, span = 2.32, airspeed = 24.0 }
sensors = { vane_position = [0.4, 0.0, 0.0] }
propulsion = { kind = "propeller", channel = "throttle", speed_gain = 150.0, diameter = 0.4, CT0 = 0.14, CT1 = -0.10 }
"""
    + V_TAIL_MIXERS
    + """[controls.aileron]
offset = 0.02
lag = 0.04
[aerodynamics]
CL = { CL0 = 0.4, CLalpha = 4.9, CLq = 5.0, CLelevator = 0.3 }
CD = { CD0 = 0.05, CDalpha = 0.2, CDalpha2 = 0.8 }
Cm = { Cm0 = 0.02, Cmalpha = -0.9, Cmq = -12.0, Cmelevator = -1.0, Cmcross = { term = "abs(elevator)*elevator", value = 0.1 } }
"""
    + V_TAIL_LATERAL
)

QUAD = """
name = "quad"
body_drag = { linear = [0.1, 0.1, 0.1], quadratic = [0.02, 0.02, 0.03] }
sensors = { q = { delay = 0.02, sigma = 0.02 } }
rotors = { nominal_voltage = 16.0, lag = 0.05, delay = 0.013, T0 = 0.0, T1 = 2.5, T2 = 6.0, \
    inflow = 0.25, drag = 0.08, torque_ratio = 0.016 }
mass = { mass = 1.5, center_of_gravity = [0.01, -0.005, 0.0], \
    inertia = { xx = 0.029, yy = 0.031, zz = 0.055, xz = 0.001 } }
[rotor]
m1 = { channel = "motor_1", position = [0.177, 0.177, -0.03], spin = "ccw", factor = 0.9 }
m2 = { channel = "motor_2", position = [-0.177, -0.177, -0.03], spin = "ccw" }
m3 = { channel = "motor_3", position = [0.177, -0.177, -0.03], axis = [0.05, 0.0, -1.0], spin = "cw" }
m4 = { channel = "motor_4", position = [-0.177, 0.177, -0.03], spin = "cw" }
"""


@pytest.fixture(scope="session")
def quad() -> Vehicle:
    """Return a quadrotor with all that makes one hard to fly: a weak and a tilted rotor, lag, delay, a battery."""
    return parse_vehicle(QUAD, "quad.toml")


@pytest.fixture(scope="session")
def even(quad: Vehicle) -> Vehicle:
    """Return it whole and straight, with linear drag of the body alone."""
    plain = {"rotors.inflow": 0.0, "rotors.drag": 0.0, "rotor.m1.factor": 1.0, "rotor.m3.axis.x": 0.0}
    plain |= {f"body_drag.quadratic.{axis}": 0.0 for axis in "xyz"}
    plain |= {f"mass.center_of_gravity.{axis}": 0.0 for axis in "xyz"}
    return quad.with_numbers({name: {"value": value} for name, value in plain.items()})


@pytest.fixture(scope="session")
def v_tail() -> Vehicle:
    return parse_vehicle(V_TAIL, "v_tail.toml")
