"""A flying wing has no rudder: what is asymmetric about it is trimmed with sideslip."""

from __future__ import annotations

import pytest

from stoop.simulation import linearize, trim
from stoop.vehicle import parse_vehicle

WING = """
name = "wing"
[mass]
mass = 2.0
inertia = { xx = 0.12, yy = 0.06, zz = 0.17 }
[reference]
area = 0.4
chord = 0.25
span = 1.6
airspeed = 16.0
[environment]
density = 1.2
[propulsion]
kind = "constant"
thrust = 1.5
[controls.elevator]
[controls.aileron]
[aerodynamics.CL]
CL0 = 0.2
CLalpha = 4.5
[aerodynamics.CD]
CD0 = 0.025
CDalpha2 = 0.8
[aerodynamics.Cm]
Cm0 = 0.02
Cmalpha = -0.4
Cmq = -4.0
Cmelevator = -0.5
[aerodynamics.CQ]
CQbeta = -0.2
[aerodynamics.Cl]
Cl0 = 0.001
Clbeta = -0.05
Clp = -0.4
Claileron = 0.2
[aerodynamics.Cn]
Cn0 = 0.001
Cnbeta = 0.04
Cnr = -0.05
"""


def test_an_asymmetric_wing_is_trimmed_with_sideslip() -> None:
    vehicle = parse_vehicle(WING, "wing.toml")
    point = trim(vehicle)
    assert point.residual < 1e-7
    assert point.start["beta"] == pytest.approx(-0.001 / 0.04, rel=0.05)  # Cn0 + Cnbeta beta = 0
    assert linearize(vehicle, point).modes


def test_a_symmetric_wing_flies_without() -> None:
    vehicle = parse_vehicle(WING.replace("Cn0 = 0.001\n", "").replace("Cl0 = 0.001\n", ""), "wing.toml")
    assert trim(vehicle).start.get("beta", 0.0) == 0.0
