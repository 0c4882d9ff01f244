"""The paper's aircraft, and a small one with mixers, lags and delays."""

from __future__ import annotations

from importlib.resources import files

import pytest

from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle

V_TAIL = """
name = "V-tail"
[mass]
mass = 8.5
inertia = { xx = 1.38, yy = 0.84, zz = 2.0, xz = 0.11 }
[reference]
area = 0.66
chord = 0.285
span = 2.32
airspeed = 24.0
[propulsion]
kind = "propeller"
channel = "throttle"
speed_gain = 150.0
diameter = 0.4
CT0 = 0.14
CT1 = -0.10
[controls.elevator]
mix = { pwm_3 = 0.0007, pwm_4 = 0.0008 }
center = { pwm_3 = 1480.0, pwm_4 = 1510.0 }
offset = -0.01
lag = 0.06
[controls.rudder]
mix = { pwm_3 = 0.0009, pwm_4 = -0.0008 }
center = { pwm_3 = 1480.0, pwm_4 = 1510.0 }
[controls.aileron]
offset = 0.02
lag = 0.04
[sensors]
vane_position = [0.4, 0.0, 0.0]
[aerodynamics.CL]
CL0 = 0.4
CLalpha = 4.9
CLq = 5.0
CLelevator = 0.3
[aerodynamics.CD]
CD0 = 0.05
CDalpha = 0.2
CDalpha2 = 0.8
[aerodynamics.Cm]
Cm0 = 0.02
Cmalpha = -0.9
Cmq = -12.0
Cmelevator = -1.0
Cmcross = { term = "abs(elevator)*elevator", value = 0.1 }
[aerodynamics.CQ]
CQbeta = -0.4
CQrudder = 0.1
[aerodynamics.Cl]
Clbeta = -0.06
Clp = -0.5
Clr = 0.12
Claileron = 0.2
[aerodynamics.Cn]
Cnbeta = 0.06
Cnp = -0.04
Cnr = -0.12
Cnrudder = -0.08
"""


@pytest.fixture(scope="session")
def twin_boom() -> Vehicle:
    return load_vehicle(str(files("stoop") / "data" / "twin_boom.toml"))


@pytest.fixture(scope="session")
def v_tail() -> Vehicle:
    return parse_vehicle(V_TAIL, "v_tail.toml")
