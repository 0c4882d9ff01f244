"""A hover tells little of wings, and that is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stoop.estimate.excitation import excitation_warnings
from stoop.estimate.fit import Options, pose
from stoop.flight import Flight
from stoop.problem import Misfit
from stoop.problem.windows import Window
from stoop.simulate import parse_maneuver, simulate_flight
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle

MANEUVER = """
duration = 4.0
rate = 100.0
wind = [-3.0, 0.0, 0.0]
[[input]]
control = "forward"
shape = "pulse"
start = 0.5
duration = 2.0
amplitude = 1.0
"""


@pytest.fixture(scope="module")
def hover() -> Flight:
    return simulate_flight(builtin_vehicle("quadplane"), parse_maneuver(MANEUVER, "m"), name="sim")


def said(vehicle: Vehicle, flight: Flight) -> list[str]:
    problem: Misfit = pose(vehicle, {"sim": flight}, [Window("sim", 0.0, 4.0)], Options())[0]
    z = np.zeros(problem.dimension + len(problem.layout.nuisances))
    return [line for line in excitation_warnings(problem, z) if "aerodynamic" in line]


def test_wings_that_hardly_carry_are_told_once(hover: Flight) -> None:
    vehicle = builtin_vehicle("quadplane")
    free = sum(p.free and p.name.startswith("C") for p in vehicle.parameters)
    (line,) = said(vehicle, hover)
    assert "of the pressure at reference.airspeed (18 m/s)" in line
    assert (
        f"a hover tells little of aerodynamic coefficients, {free} of which are free. Hold them (--fix NAME"
        in line
    )


def test_nothing_is_said_of_fast_flight_or_of_held_coefficients(hover: Flight) -> None:
    vehicle = builtin_vehicle("quadplane")
    north = hover.data["vn"]
    fast = replace(hover, data=hover.data.assign(vn=north + 15.0))
    assert said(vehicle, fast) == []
    held = {p.name: {"free": False} for p in vehicle.parameters if p.free and p.name.startswith("C")}
    assert said(vehicle.with_numbers(held), hover) == []
    assert said(builtin_vehicle("quad-x"), hover) == []
