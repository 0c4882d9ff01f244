"""Simulated flights: what is recorded is what the instruments would have seen."""

import json

import numpy as np
import pytest
from scipy.signal import welch

from stoop.base.notices import notice
from stoop.errors import ManeuverError, SimulationError
from stoop.simulation import trim
from stoop.simulation.fly import fly, simulate, simulate_flight
from stoop.simulation.maneuver import Maneuver, parse_maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import BUILT_IN, builtin_vehicle, load_vehicle
from stoop.vehicle.channels import rigid_states
from stoop.vehicle.delays import delayed
from stoop.vehicle.trajectories import finer


def maneuver(control: str = "elevator", **changes: object) -> Maneuver:
    step = {"control": control, "shape": "doublet", "start": 1.0, "step": 0.4, "amplitude": 0.05}
    return Maneuver.model_validate({"duration": 4.0, "input": [step]} | changes)


def test_noise_free_readings_and_commands_are_recorded(twin_boom: Vehicle, v_tail: Vehicle) -> None:
    """Commands, not deflections: the V-tail's aileron has an offset, which a fit would count twice."""
    for vehicle, control in ((twin_boom, "elevator"), (v_tail, "aileron")):
        flown = fly(vehicle, maneuver(control))
        flight = simulate_flight(vehicle, maneuver(control), noise=False)
        recorded = np.hstack([flown.outputs, flown.inputs])
        for i, channel in enumerate((*vehicle.outputs, *vehicle.inputs)):
            assert np.array_equal(flight.column(channel), recorded[:, i])
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
        rows = np.repeat(v_tail.parameter_rows(), len(flown.time), axis=1)
        for other in v_tail.controls:
            moved = v_tail.commanded(other, rows, flown.inputs.T) - flown.trim.deflections[other]
            expected = maneuver(control).deflections()[control] if other == control else 0.0
            assert moved == pytest.approx(expected * np.ones_like(moved), abs=1e-12)


def test_delays_of_the_file_are_flown(twin_boom: Vehicle) -> None:
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
    names = ("altitude", "V", "alpha", "beta", "phi", "theta")
    h, V, alpha, beta, phi, theta = (flight.column(name) for name in names)
    level = np.sin(beta) * np.sin(phi) + np.sin(alpha) * np.cos(beta) * np.cos(phi)
    climb = V * (np.cos(alpha) * np.cos(beta) * np.sin(theta) - level * np.cos(theta))
    assert h[0] == 350.0
    assert np.gradient(h, flight.time)[2:-2] == pytest.approx(climb[2:-2], abs=2e-3)


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


def test_inputs_as_arrays_fly_the_maneuver_again_with_noise_by_seed(twin_boom: Vehicle) -> None:
    asked = maneuver(rate=50.0)
    flight = simulate_flight(twin_boom, asked, noise=False)
    deflection = trim(twin_boom).deflections["elevator"] + asked.deflections()["elevator"]
    flown = simulate(twin_boom, flight), simulate(twin_boom, {"elevator": deflection}, np.arange(201) / 50.0)
    for again in flown:
        for channel in ("q", "alpha", "az", "altitude"):
            np.testing.assert_allclose(again.column(channel), flight.column(channel), rtol=0.0, atol=1e-9)
    one, two = (simulate(twin_boom, flight.data, noise=True, seed=s) for s in (1, 1))
    np.testing.assert_array_equal(one.column("q"), two.column("q"))
    error = one.column("q") - flight.column("q")
    assert np.std(error) == pytest.approx(twin_boom.file.sensors.q.sigma, rel=0.2)


def test_inputs_that_cannot_be_flown(twin_boom: Vehicle) -> None:
    three = np.arange(3.0)
    for name, values, time, advice in (
        ("elevater", np.zeros(3), three, "did you mean elevator"), ("elevator", np.zeros(2), three, "as long as the time"),
        ("elevator", np.zeros(3), three**2, "one rate"), ("elevator", np.zeros(3), None, "no time"),
        ("elevator", np.array([0.0, np.nan, 0.0]), three, "not finite"),
    ):  # fmt: skip
        with pytest.raises(ManeuverError, match=advice):
            simulate(twin_boom, {name: values}, time)


def test_a_start_may_be_told_either_way_and_for_many_lanes() -> None:
    by_air = rigid_states({"V": 20.0, "alpha": 0.1, "beta": -0.05, "theta": 0.2})
    by_body = rigid_states({"u": by_air["u"], "v": by_air["v"], "w": by_air["w"], "theta": 0.2})
    assert by_air.keys() == by_body.keys()
    assert all(np.array_equal(by_air[name], by_body[name]) for name in by_air)
    states = rigid_states({"u": np.array([0.0, 1.0]), "q": 0.3})
    assert {n: states[n].tolist() for n in "uqv"} == {"u": [0.0, 1.0], "q": [0.3, 0.3], "v": [0.0, 0.0]}
    for name in BUILT_IN:
        vehicle = builtin_vehicle(name)
        start = dict.fromkeys(vehicle.start_names, 0.1)
        x = vehicle.initial_states(start, vehicle.parameter_rows(), np.zeros(len(vehicle.inputs)))
        known = dict(zip(vehicle.states, x[:, 0], strict=True))
        assert all(known[n] == 0.1 for n in set(vehicle.start_names) & set(vehicle.states)), name


def test_lagged_rotors_start_where_they_are_commanded() -> None:
    vehicle = builtin_vehicle("quad-x")
    rows, u = vehicle.parameter_rows(None, 2), np.array([0.2, 0.4, 0.6, -0.3])
    start = {"u": 0.0, "m3.lag": np.array([0.0, 0.1])}
    x = dict(zip(vehicle.states, vehicle.initial_states(start, rows, u), strict=True))
    assert np.array_equal(x["m1.lag"], [0.2, 0.2])
    assert x["m3.lag"] == pytest.approx([0.6, 0.7])
    assert np.array_equal(x["m4.lag"], [0.0, 0.0]), "not below zero"


SPEED, RATE = 35.0, 50.0
SIGMA = {"u": 1.0, "v": 1.5, "w": 0.8}
LENGTH = {"u": 8.0, "v": 5.0, "w": 6.0}


def gusty(text: str):
    table = "\n".join(f"{a} = {{ intensity = {SIGMA[a]}, length = {LENGTH[a]} }}" for a in "uvw")
    return parse_vehicle(f"{text}\n[turbulence]\n{table}\n", "gusty")


@pytest.fixture(scope="module")
def gusts():
    """Gusts (n,) by axis: what an arrow without weight or lift, as heavy as a mountain, reads off its vanes."""
    text = load_vehicle("twin-boom").text
    for number in ("mass = 189.40", "xx = 100.0", "yy = 120.0", "zz = 200.0"):
        text = text.replace(number, f"{number.split()[0]} = 1e12")
    vehicle = gusty(text.replace("density = 1.20165", "density = 1.2\ngravity = 1e-12"))
    maneuver = parse_maneuver(f"duration = 1000.0\nrate = {RATE}\nairspeed = {SPEED}", "straight")
    read = simulate_flight(vehicle, maneuver, seed=5, noise=False).data
    V, alpha, beta = (read[c].values for c in ("V", "alpha", "beta"))
    plane = V * np.cos(beta)
    moving = {"u": plane * np.cos(alpha), "v": V * np.sin(beta), "w": plane * np.sin(alpha)}
    return {axis: np.mean(moving[axis]) - moving[axis] for axis in "uvw"}


def dryden(axis: str, spatial: np.ndarray) -> np.ndarray:
    """MIL-F-8785C, section 3.7.1.2: one-sided spectrum over the spatial frequency, rad/m."""
    x, scale = (LENGTH[axis] * spatial) ** 2, SIGMA[axis] ** 2 * LENGTH[axis] / np.pi
    return 2.0 * scale / (1.0 + x) if axis == "u" else scale * (1.0 + 3.0 * x) / (1.0 + x) ** 2


def test_variance_and_spectrum(gusts):
    for axis in "uvw":
        independent = 1000.0 * SPEED / LENGTH[axis] / 2.0
        scatter = 4.0 * np.sqrt(2.0 / independent)
        assert np.var(gusts[axis]) == pytest.approx(SIGMA[axis] ** 2, rel=scatter), axis
        f, power = welch(gusts[axis], RATE, nperseg=1024)
        expected = 2.0 * np.pi / SPEED * dryden(axis, 2.0 * np.pi * f / SPEED)
        for low, high in ((0.1, 0.5), (0.5, 1.5), (1.5, 4.0), (4.0, 8.0)):
            band = (f >= low) & (f < high)
            windows = 2.0 * 1000.0 * RATE / 1024
            chance = 4.0 / np.sqrt(windows * band.sum() / 2.0)
            assert np.mean(power[band]) == pytest.approx(np.mean(expected[band]), rel=chance + 0.01), axis


def test_gusts_blow_as_hard_at_the_beginning(gusts):
    """No run-in: over seeds the first sample has the variance of any other."""
    vehicle = gusty(load_vehicle("twin-boom").text)
    starts = [vehicle.gust_start(np.random.default_rng(i)) for i in range(4000)]
    root = np.sqrt(3.0)
    v = np.array([root * s["gust.v.fast"] + (1.0 - root) * s["gust.v.slow"] for s in starts])
    assert np.std(v) == pytest.approx(SIGMA["v"], rel=0.05)
    assert np.std([s["gust.u"] for s in starts]) == pytest.approx(SIGMA["u"], rel=0.05)


def test_finer_inputs_are_linear_between_the_samples():
    fine = finer(np.array([[0.0, 1.0], [2.0, 1.0], [0.0, 5.0]]), 4)
    assert np.allclose(fine.T, [[0, 0.5, 1, 1.5, 2, 1.5, 1, 0.5, 0], [1, 1, 1, 1, 1, 2, 3, 4, 5]])
