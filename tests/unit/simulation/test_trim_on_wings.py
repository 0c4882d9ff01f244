"""Steady flight of a flying wing: without a rudder with sideslip, without propulsion in a glide."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from stoop.errors import SimulationError
from stoop.simulation import linearize, trim
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle

WING = """
name = "wing"
mass = { mass = 2.0, inertia = { xx = 0.12, yy = 0.06, zz = 0.17 } }
reference = { area = 0.4, chord = 0.25, span = 1.6, airspeed = 16.0 }
environment = { density = 1.2 }
propulsion = { kind = "constant", thrust = 1.5 }
controls = { elevator = {}, aileron = {} }
[aerodynamics]
CL = { CL0 = 0.2, CLalpha = 4.5 }
CD = { CD0 = 0.025, CDalpha2 = 0.8 }
Cm = { Cm0 = 0.02, Cmalpha = -0.4, Cmq = -4.0, Cmelevator = -0.5 }
CQ = { CQbeta = -0.2 }
Cl = { Cl0 = 0.001, Clbeta = -0.05, Clp = -0.4, Claileron = 0.2 }
Cn = { Cn0 = 0.001, Cnbeta = 0.04, Cnr = -0.05 }
"""
SYMMETRIC = WING.replace("Cn0 = 0.001, ", "").replace("Cl0 = 0.001, ", "")
PROPULSION = 'propulsion = { kind = "constant", thrust = 1.5 }\n'


@pytest.fixture(scope="module")
def glider() -> Vehicle:
    return parse_vehicle(SYMMETRIC.replace(PROPULSION, ""), "glider.toml")


def test_a_wing_flies_the_path_that_was_asked_for_with_sideslip_where_it_is_asymmetric() -> None:
    vehicle = parse_vehicle(WING, "wing.toml")
    point = trim(vehicle)
    assert point.residual < 1e-7
    assert point.start["beta"] == pytest.approx(-0.001 / 0.04, rel=0.05)  # Cn0 + Cnbeta beta = 0
    assert linearize(vehicle, point).modes
    climb = trim(parse_vehicle(SYMMETRIC, "wing.toml"), climb_angle=0.05)
    assert climb.start.get("beta", 0.0) == 0.0
    assert climb.climb_angle == pytest.approx(0.05, abs=1e-7)


@pytest.mark.parametrize("airspeed", [11.0, 13.0, 20.0])
def test_without_propulsion_it_sinks_by_drag_over_lift(glider: Vehicle, airspeed: float) -> None:
    point = trim(glider, airspeed)
    alpha = point.start["alpha"]
    lift, drag = 0.2 + 4.5 * alpha, 0.025 + 0.8 * alpha**2
    assert math.tan(-point.climb_angle) == pytest.approx(drag / lift, rel=1e-6)
    pressure = 0.5 * 1.2 * airspeed**2 * 0.4
    assert pressure * math.hypot(lift, drag) == pytest.approx(2.0 * 9.80665, rel=1e-4)
    assert point.start["theta"] - alpha == pytest.approx(point.climb_angle, abs=1e-9)
    assert linearize(glider, point).modes


def test_without_propulsion_it_does_not_climb(glider: Vehicle) -> None:
    with pytest.raises(SimulationError, match="leave the climb angle out"):
        trim(glider, climb_angle=0.02)


EXAMPLE = Path(__file__).parents[3] / "examples" / "vtail.toml"


def test_finds_full_power_from_a_propeller_at_rest() -> None:
    """At rest the thrust does not change with the throttle, so a search that gets there stays there."""
    draggy = load_vehicle(EXAMPLE).with_numbers({"CD0": {"value": 0.12}, "propulsion.CT1": {"value": -0.15}})
    point = trim(draggy, 23.0, density=1.19)
    assert point.residual < 1e-7
    assert 0.5 < point.thrust["control_throttle"] < 1.5


def test_thrust_balances_drag() -> None:
    """At small angles thrust is drag, eq. (1) and the propeller's form evaluated by hand."""
    vehicle = load_vehicle(EXAMPLE)
    for airspeed in (15.0, 20.0, 25.0):
        point = trim(vehicle, airspeed, density=1.19)
        up = point.start["alpha"] + 0.10
        drag = 0.5 * 1.19 * airspeed**2 * 0.66 * (0.05 + 0.2 * up + 0.8 * up**2)
        n = 147.2 * point.thrust["control_throttle"]
        pull = 1.19 * 0.40**4 * (0.14 * n**2 - 0.10 * n * airspeed / 0.40)
        assert pull == pytest.approx(drag, rel=0.02), airspeed
