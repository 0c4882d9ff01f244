"""Repeatability on simulated flights: equal maneuvers agree, one of another aircraft does not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stoop.assessment.uncertainty import repeatability, scatter
from stoop.base.notices import notice
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
duration = 8.0
rate = 50.0
[[input]]
control = "elevator"
shape = "3-2-1-1"
start = 0.5
step = 0.4
amplitude = 0.05
"""


def repeated(truth: Vehicle, flown: dict[int, Vehicle]) -> FittedModel:
    """Return a fit to a maneuver of each vehicle, by seed of its noise, and what the maneuvers say alone."""
    maneuver = parse_maneuver(MANEUVER, "3-2-1-1")
    flights = [simulate_flight(one, maneuver, seed, name=f"flight{seed}") for seed, one in flown.items()]
    done = search(truth, flights, [f"{flight.name}@0:8" for flight in flights])
    job = finish(done)
    found = repeatability(done.estimate, done.flights, done.options, lambda _: None)
    return job.with_result(replace(job.result, repeatability=found))


def test_maneuvers_of_one_aircraft_agree_and_one_of_another_stands_out() -> None:
    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
    truth = vehicle.with_numbers({p.name: {"free": p.name in FREE} for p in vehicle.parameters if p.free})
    alike = repeated(truth, dict.fromkeys(range(4, 8), truth))
    found = alike.result.repeatability
    assert found.maneuvers == (0, 1, 2, 3)
    for name in FREE:
        one, joint = found.parameters[name], alike.result.parameters[name]
        assert one.degrees == 3
        assert one.p_value > 0.001
        assert abs(one.mean - truth.value(name)) < 4.0 * one.std_error
        assert one.std_error == pytest.approx(joint.std_error, rel=0.4)
        assert abs(one.mean - joint.estimate) < 2.0 * joint.std_error
    first, *others = repeatability_lines(found)
    summary = found.summary()
    assert (summary.code, summary.values["compared"], first) == ("repeatability", 4, str(summary))
    assert sorted(n for line in others for n in FREE if f"{n} (4 maneuvers" in line) == sorted(FREE)
    assert "each maneuver fitted alone" in render(alike)
    other = truth.with_numbers({"Cmq": {"value": 1.6 * truth.value("Cmq")}})
    scattered = repeated(truth, {0: truth, 1: truth, 2: other}).result.repeatability
    assert scattered.parameters["Cmq"].verdict == "scatter"
    line = next(line for line in repeatability_lines(scattered) if line.startswith("scatter: "))
    assert "Cmq (3 maneuvers, p = " in line


def test_what_only_one_maneuver_tells_is_not_compared() -> None:
    one, none = SingleEstimate(1.0, 0.1, True), SingleEstimate(1.0, 0.1, False)
    remark = notice("maneuver-stopped", "f 1:2")
    found = Repeatability((0, 1), {"CLalpha": scatter([one, none])}, (remark,))
    assert found.summary().code == "repeatability-nothing-compared"
    assert repeatability_lines(found) == [str(found.summary()), "f 1:2: left out, stopped by the user"]
    assert repeatability_lines(Repeatability()) == []
