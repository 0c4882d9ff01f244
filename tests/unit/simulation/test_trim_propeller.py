"""Steady flight of a propeller aircraft that needs most of its power."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop.simulation import trim
from stoop.vehicle import load_vehicle

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
