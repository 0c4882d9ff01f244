"""Inputs that cannot tell, a hover that tells little of wings, and windows in which an aircraft stands, each in one line."""

from dataclasses import replace

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.checks.excitation import collinear, excitation_notices
from stoop.checks.rotors import windows_on_ground
from stoop.checks.vehicle import check_vehicle
from stoop.estimate.fit import Options, estimation_problem
from stoop.flight import Flight
from stoop.problem import Misfit
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle

TIME = 0.01 * np.arange(2000)
RNG = np.random.default_rng(0)
ALPHA, Q = 0.05 * np.sin(2.0 * TIME), 0.1 * np.cos(2.0 * TIME)
MOTIONS = {"V": 0.3 * np.sin(0.3 * TIME), "alpha": ALPHA, "q": Q}
MOTIONS |= {"beta": 0.02 * np.sin(3.0 * TIME), "p": 0.2 * np.cos(5.0 * TIME)}


def noise(size: float) -> FloatArray:
    return size * RNG.standard_normal(len(TIME))


def told(**controls: FloatArray) -> list[Notice]:
    return list(collinear(controls, MOTIONS))


def test_feedback_and_mixed_controls_are_named() -> None:
    moved, other = 0.1 * np.sign(np.sin(0.7 * TIME)), 0.1 * np.sign(np.sin(1.3 * TIME))
    assert told(elevator=other, aileron=moved) == []
    (one,) = told(elevator=-2.0 * ALPHA + noise(0.005))
    assert (one.code, one.subject, one.values["other"]) == ("control-follows-motion", "elevator", "alpha")
    assert one.values["correlation"] == pytest.approx(-1.0, abs=0.01)
    (several,) = told(elevator=1.0 * ALPHA + 0.6 * Q + noise(0.002))
    assert (several.code, several.values["motions"]) == ("control-combination", ("V", "alpha", "q"))
    mixed = told(aileron=moved, rudder=0.5 * moved + noise(0.002))
    named = ("controls-correlated", "aileron", "rudder")
    assert named in [(n.code, n.subject, n.values.get("other")) for n in mixed]


@pytest.fixture(scope="module")
def hover() -> Flight:
    forward = [{"control": "forward", "shape": "pulse", "start": 0.5, "duration": 2.0, "amplitude": 1.0}]
    flown = {"duration": 4.0, "rate": 100.0, "wind": [-3.0, 0.0, 0.0], "input": forward}
    return simulate_flight(builtin_vehicle("quadplane"), Maneuver.model_validate(flown), name="sim")


def said(vehicle: Vehicle, flight: Flight) -> list[Notice]:
    problem: Misfit = estimation_problem(vehicle, {"sim": flight}, [Window("sim", 0.0, 4.0)], Options())[0]
    z = np.zeros(problem.dimension + len(problem.layout.nuisances))
    return [n for n in excitation_notices(problem, z) if n.code == "low-airspeed"]


def test_wings_that_hardly_carry_are_told_once_unless_fast_or_held(hover: Flight) -> None:
    vehicle = builtin_vehicle("quadplane")
    free = sum(p.free and p.name.startswith("C") for p in vehicle.parameters)
    (found,) = said(vehicle, hover)
    assert (found.values["reference"], found.values["free"]) == (18.0, free)
    assert 0.0 < found.values["airspeed"] < 9.0
    north = hover.data["vn"]
    fast = replace(hover, data=hover.data.assign(vn=north + 15.0))
    assert said(vehicle, fast) == []
    held = {p.name: {"free": False} for p in vehicle.parameters if p.free and p.name.startswith("C")}
    assert said(vehicle.with_numbers(held), hover) == []
    assert said(builtin_vehicle("quad-x"), hover) == []


def test_windows_of_a_flight_that_ended(aircraft: Vehicle, flight: Flight) -> None:
    V = np.where(flight.time >= 20.0, 0.3 * np.abs(np.sin(flight.time)), flight.column("V"))
    crashed = replace(flight, data=flight.data.assign(V=("time", V)))
    windows = [Window("sim", 0.0, 10.0), Window("sim", 15.0, 25.0), Window("sim", 21.0, 27.0)]
    assert not windows_on_ground(aircraft, flight, windows)
    partly, whole = windows_on_ground(aircraft, crashed, windows)
    assert (partly.code, partly.subject) == ("window-partly-on-ground", str(windows[1]))
    assert partly.values["share"] == pytest.approx(0.5, abs=0.01)
    assert partly.values["first"] == pytest.approx(15.0)
    assert partly.values["last"] == pytest.approx(20.0, abs=0.03)
    assert "narrow --maneuver to within 15.0:20.0" in str(partly)
    assert (whole.code, whole.subject) == ("window-on-ground", str(windows[2]))
    found = check_vehicle(aircraft, {"sim": crashed}, windows[1:2])
    assert [n.code for n in found].count("window-partly-on-ground") == 1
    assert not check_vehicle(aircraft, {"sim": crashed})  # a whole record begins and ends on the ground
    blind = replace(crashed, data=crashed.data.drop_vars("V"))
    assert not windows_on_ground(aircraft, blind, windows[1:2])
