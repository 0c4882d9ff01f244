"""Repeatability on simulated flights: equal maneuvers agree, one of another aircraft does not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stoop.assessment.uncertainty import repeatability, scatter
from stoop.base.notices import notice
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.report.identification import render
from stoop.results.uncertainty import Repeatability, SingleEstimate
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.identification import finish, search
from stoop.workflow.summary import repeatability_lines

FREE = ("CLalpha", "Cmalpha", "Cmq", "Cmelevator")
MANEUVER = """
format = "stoop-maneuver/1"
duration = 8.0
rate = 50.0
[[input]]
control = "elevator"
shape = "3-2-1-1"
start = 0.5
step = 0.4
amplitude = 0.05
"""


def aircraft() -> Vehicle:
    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
    others = {p.name: {"free": False} for p in vehicle.parameters if p.free and p.name not in FREE}
    return vehicle.with_numbers(others)


def flown(vehicle: Vehicle, seed: int) -> Flight:
    return simulate_flight(vehicle, parse_maneuver(MANEUVER, "3-2-1-1"), seed, name=f"flight{seed}")


def repeated(flights: list[Flight]) -> FittedModel:
    windows = [f"{flight.name}@0:8" for flight in flights]
    done = search(aircraft(), flights, windows, options=Options())
    job = finish(done)
    found = repeatability(done.estimate, done.flights, done.options, lambda _: None)
    return job.with_result(replace(job.result, repeatability=found))


@pytest.fixture(scope="module")
def alike() -> FittedModel:
    return repeated([flown(aircraft(), seed) for seed in range(4, 8)])


def test_maneuvers_of_one_aircraft_agree_with_each_other_and_the_joint_fit(alike: FittedModel) -> None:
    result = alike.result
    assert result.repeatability.maneuvers == (0, 1, 2, 3)
    for name in FREE:
        found = result.repeatability.parameters[name]
        assert found.degrees == 3
        assert found.p_value > 0.001
        truth = aircraft().value(name)
        assert abs(found.mean - truth) < 4.0 * found.std_error
        joint = result.parameters[name]
        assert found.std_error == pytest.approx(joint.std_error, rel=0.4)
        assert abs(found.mean - joint.estimate) < 2.0 * joint.std_error


def test_one_maneuver_of_another_aircraft_stands_out() -> None:
    other = aircraft().with_numbers({"Cmq": {"value": 1.6 * aircraft().value("Cmq")}})
    found = repeated([flown(aircraft(), 0), flown(aircraft(), 1), flown(other, 2)])
    scattered = found.result.repeatability
    assert scattered.parameters["Cmq"].verdict == "scatter"
    scattering = next(line for line in repeatability_lines(scattered) if line.startswith("scatter: "))
    assert "Cmq (3 maneuvers, p = " in scattering


def test_the_terminal_says_how_many_agree(alike: FittedModel) -> None:
    found = alike.result.repeatability
    first, *others = repeatability_lines(found)
    summary = found.summary()
    assert (summary.code, summary.values["compared"], first) == ("repeatability", 4, str(summary))
    named = [name for line in others for name in FREE if f"{name} (4 maneuvers" in line]
    assert sorted(named) == sorted(FREE)
    assert repeatability_lines(Repeatability()) == []


def test_what_only_one_maneuver_tells_is_not_compared() -> None:
    one, none = SingleEstimate(1.0, 0.1, True), SingleEstimate(1.0, 0.1, False)
    remark = notice("maneuver-stopped", "f 1:2")
    found = Repeatability((0, 1), {"CLalpha": scatter([one, none])}, (remark,))
    assert found.summary().code == "repeatability-nothing-compared"
    assert repeatability_lines(found) == [str(found.summary()), "f 1:2: left out, stopped by the user"]


def test_the_report_draws_them(alike: FittedModel) -> None:
    assert "each maneuver fitted alone" in render(alike)
    without = replace(alike, result=replace(alike.result, repeatability=Repeatability()))
    assert "each maneuver fitted alone" not in render(without)
