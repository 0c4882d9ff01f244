"""The PS-GDE paper's (14): V0 = 35 m/s, alpha0 = 5.88 deg, elevator -1.7 deg, h0 = 200 m, T0 = 220.87 N.

Mass (189.40 kg) and wing area (2.8667 m2) are not printed; they follow from (14), whose angles are rounded: 0.005 deg of alpha
is 0.08 N of thrust.
"""

from __future__ import annotations

import math

import pytest

from stoop.simulation import trim
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle.builtin import builtin_vehicle


@pytest.mark.parametrize("reduce", ["full", "longitudinal"])
def test_trim(reduce: str) -> None:
    point = trim(builtin_vehicle("twin-boom").reduced(reduce), 35.0, 200.0)
    assert math.degrees(point.start["alpha"]) == pytest.approx(5.88, abs=0.005)
    assert math.degrees(point.deflections["elevator"]) == pytest.approx(-1.7, abs=0.05)
    assert point.thrust["propulsion.thrust"] == pytest.approx(220.87, abs=0.08)
    assert point.residual < 1e-12


def test_start_of_a_maneuver_stays_where_it_is() -> None:
    flown = fly(builtin_vehicle("twin-boom"), Maneuver(duration=20.0))
    assert abs(flown.outputs - flown.outputs[0]).max() < 1e-9
