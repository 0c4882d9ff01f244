"""A window in which an aircraft stands, before take-off, after landing or after a crash, is named in one line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stoop.checks.rotors import windows_on_ground
from stoop.checks.vehicle import check_vehicle
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle


@pytest.fixture
def crashed(flight: Flight) -> Flight:
    """Return a flight that ends at 20 s."""
    down = flight.time >= 20.0
    V = np.where(down, 0.3 * np.abs(np.sin(flight.time)), flight.column("V"))
    return replace(flight, data=flight.data.assign(V=("time", V)))


def test_windows_of_a_flight_that_ended(aircraft: Vehicle, flight: Flight, crashed: Flight) -> None:
    windows = [Window("sim", 0.0, 10.0), Window("sim", 15.0, 25.0), Window("sim", 21.0, 27.0)]
    assert not windows_on_ground(aircraft, flight, windows)
    partly, whole = windows_on_ground(aircraft, crashed, windows)
    assert (partly.code, partly.subject) == ("window-partly-on-ground", str(windows[1]))
    assert partly.values["share"] == pytest.approx(0.5, abs=0.01)
    assert partly.values["first"] == pytest.approx(15.0)
    assert partly.values["last"] == pytest.approx(20.0, abs=0.03)
    assert "narrow --maneuver to within 15.0:20.0" in str(partly)
    assert (whole.code, whole.subject) == ("window-on-ground", str(windows[2]))


def test_it_is_said_before_any_search(aircraft: Vehicle, crashed: Flight) -> None:
    found = check_vehicle(aircraft, {"sim": crashed}, [Window("sim", 15.0, 25.0)])
    assert [n.code for n in found].count("window-partly-on-ground") == 1
    assert not check_vehicle(aircraft, {"sim": crashed})  # a whole record begins and ends on the ground


def test_a_flight_without_an_airspeed_says_nothing(aircraft: Vehicle, crashed: Flight) -> None:
    blind = replace(crashed, data=crashed.data.drop_vars("V"))
    assert not windows_on_ground(aircraft, blind, [Window("sim", 15.0, 25.0)])
