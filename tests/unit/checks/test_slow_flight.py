"""A hover tells little of wings, and that is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stoop.base.notices import Notice
from stoop.checks.excitation import excitation_notices
from stoop.estimate.fit import Options, estimation_problem
from stoop.flight import Flight
from stoop.problem import Misfit
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
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


def said(vehicle: Vehicle, flight: Flight) -> list[Notice]:
    problem: Misfit = estimation_problem(vehicle, {"sim": flight}, [Window("sim", 0.0, 4.0)], Options())[0]
    z = np.zeros(problem.dimension + len(problem.layout.nuisances))
    return [n for n in excitation_notices(problem, z) if n.code == "low-airspeed"]


def test_wings_that_hardly_carry_are_told_once(hover: Flight) -> None:
    vehicle = builtin_vehicle("quadplane")
    free = sum(p.free and p.name.startswith("C") for p in vehicle.parameters)
    (found,) = said(vehicle, hover)
    assert (found.values["reference"], found.values["free"]) == (18.0, free)
    assert 0.0 < found.values["airspeed"] < 9.0


def test_nothing_is_said_of_fast_flight_or_of_held_coefficients(hover: Flight) -> None:
    vehicle = builtin_vehicle("quadplane")
    north = hover.data["vn"]
    fast = replace(hover, data=hover.data.assign(vn=north + 15.0))
    assert said(vehicle, fast) == []
    held = {p.name: {"free": False} for p in vehicle.parameters if p.free and p.name.startswith("C")}
    assert said(vehicle.with_numbers(held), hover) == []
    assert said(builtin_vehicle("quad-x"), hover) == []
