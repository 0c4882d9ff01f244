"""Modes of a fitted model: about its trim, about the mean state where it has none, and how often they hold the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from unit.flown import maneuver, with_few_free

from stoop.assessment.error_bars import error_bars
from stoop.assessment.free_response import free_response, measured_mode
from stoop.assessment.modes import conditions, modes
from stoop.errors import SimulationError
from stoop.estimate.fit import fit
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulation import linearize, trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle
from stoop.workflow import FittedModel
from stoop.workflow.demo import MANEUVER as DEMO


def test_the_result_has_the_modes_of_its_flight_condition(job: FittedModel) -> None:
    (condition,) = job.result.modes
    assert (condition.maneuvers, condition.about, condition.remark) == ((0,), "trim", None)
    flown = job.flights[0].column("V")[job.flights[0].time <= 20.0]
    assert condition.airspeed == pytest.approx(float(np.mean(flown)), rel=0.01)
    steady = trim(job.vehicle, condition.airspeed, condition.altitude)
    known = {m.name: m for m in linearize(job.vehicle, steady).modes}
    assert {m.name for m in condition.modes} == {"short period", "phugoid"}
    for mode in condition.modes:
        assert mode.frequency.estimate == pytest.approx(known[mode.name].frequency, rel=1e-6)
        assert mode.damping.estimate == pytest.approx(known[mode.name].damping, rel=1e-6)
        assert 0.0 < mode.frequency.std_error < 0.2 * mode.frequency.estimate
        assert [seen.maneuver for seen in mode.measured] == [0]


def test_without_a_trim_about_the_mean_state(job: FittedModel, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise SimulationError("none found")

    monkeypatch.setattr("stoop.assessment.modes.trim", fails)
    covariance = job.result.covariance
    (condition,) = modes(job.estimate, covariance.names, covariance.matrix)
    assert condition.about == "mean state"
    assert condition.remark is not None
    assert condition.remark.code == "modes-about-mean-state"
    short, about_trim = (
        next(m for m in one.modes if m.name == "short period") for one in (condition, job.result.modes[0])
    )
    assert short.frequency.estimate == pytest.approx(about_trim.frequency.estimate, rel=0.05)
    assert short.frequency.std_error > 0.0


def test_maneuvers_alike_are_one_condition(wrong: Vehicle, flight: Flight) -> None:
    flights = {name: replace(flight, name=name) for name in "ab"}
    windows = [Window("a", 0.0, 8.0), Window("b", 0.0, 8.0), Window("a", 10.0, 20.0)]
    found = fit(with_few_free(wrong, ["Cmq"]), flights, windows)
    assert [c.maneuvers for c in conditions(found)] == [(0, 1), (2,)]  # the phugoid was 6 % slower later


def test_intervals_hold_the_truth_as_often_as_they_should(aircraft: Vehicle) -> None:
    vehicle, off = with_few_free(aircraft, ("CLalpha", "Cmalpha", "Cmq", "Cmelevator")), []
    flown = maneuver(12.0, ("elevator", "3-2-1-1", 0.5, 0.4, 0.05))
    for seed in range(30):
        flight = simulate_flight(vehicle, flown, seed, name="sim")
        found = fit(vehicle, {"sim": flight}, [Window("sim", 0.0, 12.0)])
        names = tuple(p.name for p in found.problem.layout.parameters)
        bars = error_bars(found)
        (condition,) = modes(found, names, bars.covariance[: len(names), : len(names)])
        short = next(m for m in condition.modes if m.name == "short period")
        truth = linearize(vehicle, trim(vehicle, condition.airspeed, condition.altitude)).modes[0]
        off.append((short.frequency.estimate - truth.frequency) / short.frequency.std_error)
        off.append((short.damping.estimate - truth.damping) / short.damping.std_error)
    assert np.mean(np.abs(off) < 1.96) >= 0.85  # 60 intervals: 95 % less three standard errors
    assert np.std(off) == pytest.approx(1.0, abs=0.3)


PULSE = "duration = 40.0\nrate = 50.0\n" + (
    '[[input]]\ncontrol = "elevator"\nshape = "pulse"\nstart = 1.0\nduration = 3.0\namplitude = 0.1\n'
)


@pytest.mark.parametrize("text", [DEMO, PULSE])
def test_where_the_model_is_the_truth_the_record_agrees_with_it(aircraft: Vehicle, text: str) -> None:
    """Phugoids of a tenth of the airspeed, the short period at their start: noise alone was up to seven errors off."""
    off = []
    for seed in range(3):
        flight = simulate_flight(aircraft, parse_maneuver(text, "test"), seed, name="sim")
        V = float(np.mean(flight.column("V")))
        controls = np.column_stack([flight.column(c) for c in aircraft.controls])
        free = free_response(flight.time, controls, {c: flight.column(c) for c in aircraft.outputs})
        for mode in linearize(aircraft, trim(aircraft, V, 200.0)).modes:
            seen = measured_mode(mode.name, 0, free, mode.frequency, V)
            if not seen.remark:
                off.append((seen.frequency.estimate - mode.frequency) / seen.frequency.std_error)
                off.append((seen.damping.estimate - mode.damping) / seen.damping.std_error)
    assert len(off) >= 6
    assert np.max(np.abs(off)) < 3.5  # the greatest of a dozen
    assert np.sqrt(np.mean(np.square(off))) < 1.7
