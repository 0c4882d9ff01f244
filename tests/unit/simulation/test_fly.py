"""Simulated flights: what is recorded is what the instruments would have seen."""

from __future__ import annotations

import json

import numpy as np
import pytest

from stoop.base.notices import notice
from stoop.errors import ManeuverError, SimulationError
from stoop.simulation import initial_states, parameter_rows, trim
from stoop.simulation.delays import delayed
from stoop.simulation.fly import fly, simulate_flight
from stoop.simulation.initial import commanded, rigid_states
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle


def maneuver(control: str = "elevator", **changes: object) -> Maneuver:
    step = {"control": control, "shape": "doublet", "start": 1.0, "step": 0.4, "amplitude": 0.05}
    return Maneuver.model_validate({"duration": 4.0, "input": [step]} | changes)


def test_noise_free_readings_and_commands_are_recorded(twin_boom: Vehicle, v_tail: Vehicle) -> None:
    """Commands, not deflections: the V-tail's aileron has an offset, which a fit would count twice."""
    for vehicle, control in ((twin_boom, "elevator"), (v_tail, "aileron")):
        flown = fly(vehicle, maneuver(control))
        flight = simulate_flight(vehicle, maneuver(control), noise=False)
        for i, channel in enumerate(vehicle.outputs):
            assert np.array_equal(flight.column(channel), flown.outputs[:, i])
        for i, channel in enumerate(vehicle.inputs):
            assert np.array_equal(flight.column(channel), flown.inputs[:, i])
        assert flight.rate == 100.0
        assert np.array_equal(flight.time, flown.time)


def test_a_thrust_that_the_trim_sets_is_told(twin_boom: Vehicle) -> None:
    assert simulate_flight(twin_boom, maneuver()).notices == (notice("simulated", "simulated"),)
    draggy = twin_boom.with_numbers({"CD0": {"value": 0.08}})
    found = simulate_flight(draggy, maneuver()).notices[1]
    assert (found.code, found.subject) == ("set-by-trim", "propulsion.thrust")
    assert found.values["value"] == pytest.approx(262.8389, abs=1e-3)
    assert (found.values["airspeed"], found.values["given"]) == (35.0, pytest.approx(220.87))
    freed = draggy.with_numbers({"propulsion.thrust": {"free": True}})
    truth = json.loads(simulate_flight(freed, maneuver()).data.attrs["truth"])
    assert truth["propulsion.thrust"] == pytest.approx(262.8389, abs=1e-3)  # as flown, not as the file says


def test_noise_has_the_size_that_was_asked_for_and_follows_the_seed(twin_boom: Vehicle) -> None:
    one, again, other = (simulate_flight(twin_boom, maneuver(), seed=s).column("q") for s in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    quiet = simulate_flight(twin_boom, maneuver(duration=40.0), noise=False)
    noisy = simulate_flight(twin_boom, maneuver(duration=40.0, noise={"q": 0.5, "V": 0.0}), seed=3)
    asked = {c: getattr(twin_boom.file.sensors, c).sigma for c in twin_boom.outputs} | {"q": 0.5, "V": 0.0}
    for channel, sigma in asked.items():
        error = noisy.column(channel) - quiet.column(channel)
        assert np.std(error) == pytest.approx(sigma, rel=0.05), channel
        assert abs(np.mean(error)) < 4 * sigma / np.sqrt(error.size) + 1e-15


def test_mixed_channels_give_the_deflection(v_tail: Vehicle) -> None:
    for control in v_tail.controls:
        flown = fly(v_tail, maneuver(control))
        rows = np.repeat(parameter_rows(v_tail), len(flown.time), axis=1)
        for other in v_tail.controls:
            moved = commanded(v_tail, other, rows, flown.inputs.T) - flown.trim.deflections[other]
            expected = maneuver(control).deflections()[control] if other == control else 0.0
            assert moved == pytest.approx(expected * np.ones_like(moved), abs=1e-12)


def test_delays_of_the_file_are_flown(twin_boom: Vehicle) -> None:
    from stoop.vehicle import parse_vehicle

    controls = "\n[controls.elevator]\ndelay = 0.05\n[controls.aileron]\n[controls.rudder]\n"
    late = parse_vehicle(f"{twin_boom.text}{controls}[sensors.q]\ndelay = 0.03\n", "late")
    quick, slow = fly(twin_boom, maneuver()), fly(late, maneuver())
    assert np.array_equal(quick.inputs, slow.inputs), "the command is recorded when it is given"
    for i, channel in enumerate(twin_boom.outputs):
        samples = 8.0 if channel == "q" else 5.0
        shifted = delayed(quick.outputs[:, i], samples)
        size = np.ptp(quick.outputs[:, i])
        assert np.abs(slow.outputs[:, i] - shifted).max() <= 1e-9 * size + 1e-12, channel


def test_the_altitude_is_the_integral_of_the_climb(twin_boom: Vehicle) -> None:
    flight = simulate_flight(twin_boom, maneuver(duration=10.0, altitude=350.0), noise=False)
    flown = fly(twin_boom, maneuver(duration=10.0, altitude=350.0))
    h = flight.column("altitude")
    assert h[0] == 350.0
    theta, phi = flight.column("theta"), flight.column("phi")
    V, alpha, beta = (flight.column(c) for c in ("V", "alpha", "beta"))
    climb = V * (
        np.cos(alpha) * np.cos(beta) * np.sin(theta)
        - np.sin(beta) * np.sin(phi) * np.cos(theta)
        - np.sin(alpha) * np.cos(beta) * np.cos(phi) * np.cos(theta)
    )
    assert np.gradient(h, flown.time)[2:-2] == pytest.approx(climb[2:-2], abs=2e-3)


def test_reduced_models_fly(twin_boom: Vehicle) -> None:
    whole = fly(twin_boom, maneuver())
    for reduce, control in (("longitudinal", "elevator"), ("lateral", "rudder")):
        part = twin_boom.reduced(reduce)
        flown = fly(part, maneuver(control))
        assert np.isfinite(flown.outputs).all()
        assert flown.trim.start["alpha"] == pytest.approx(whole.trim.start["alpha"], abs=1e-4)
        start = flown.outputs[0]
        assert np.abs(flown.outputs[:90] - start).max() < 1e-9, "steady until the control moves"


def test_flights_that_cannot_be(twin_boom: Vehicle) -> None:
    def changed(name: str, value: float) -> Vehicle:
        return twin_boom.with_numbers({name: {"value": value}})

    for error, says, flown in (
        (ManeuverError, "moves 'flap', but the controls are elevator, aileron, rudder; correct",
         lambda: fly(twin_boom, maneuver("flap"))),
        (ManeuverError, "'gamma' is not observed", lambda: simulate_flight(twin_boom, maneuver(noise={"gamma": 1.0}))),
        (SimulationError, r"diverges at \d+\.\d\d s; reduce the amplitude",
         lambda: fly(changed("Cmq", 300.0), maneuver(duration=60.0))),
        (SimulationError, r"\(elevator would be .* rad\); try another airspeed", lambda: trim(changed("Cmalpha", 40.0))),
        (SimulationError, r"no steady flight found at 6 m/s .*; try another airspeed", lambda: trim(twin_boom, 6.0)),
    ):  # fmt: skip
        with pytest.raises(error, match=says):
            flown()


def test_starts_are_broadcast(twin_boom: Vehicle) -> None:
    states = rigid_states({"V": 30.0, "alpha": np.array([0.0, 0.1]), "beta": 0.2})
    assert states["u"] == pytest.approx(30.0 * np.cos(0.2) * np.cos([0.0, 0.1]))
    assert states["v"] == pytest.approx([30.0 * np.sin(0.2)] * 2)
    x = initial_states(
        twin_boom, {"V": np.array([30.0, 40.0])}, parameter_rows(twin_boom, None, 2), np.zeros(3)
    )
    assert x.shape == (11, 2)
    assert x[0] == pytest.approx([30.0, 40.0])
