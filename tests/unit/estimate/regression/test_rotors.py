"""Equation error of vehicles with rotors on a simulated fall, whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from unit.estimate.regression.conftest import posed
from unit.flown import with_few_free

from stoop.estimate.regression.least_squares import Estimates, TimeDomain, estimate
from stoop.estimate.regression.rotors import MOMENTS, RotorEquations
from stoop.flight import Flight
from stoop.flight.flight import from_columns
from stoop.simulation import initial_states, parameter_rows
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle

DT = 0.01
TRUTH = {"rotors.T2": 7.0, "rotors.inflow": 0.3, "rotors.drag": 0.1}
WOBBLE = 0.06  #: rad/s, of the gyros' noise


def flown(
    vehicle: Vehicle, mixed: bool, truth: dict[str, float], noise: dict[str, np.ndarray] | None = None
) -> Flight:
    """Return seconds of a quadrotor under commands that swing; mixed hides which of its motors was which."""
    t = DT * np.arange(400)
    common = 0.12 * np.sin(6.0 * t) + 0.06 * np.sin(17.0 * t)
    own = 0.006 * np.sin(np.outer(t, [19.0, 23.0, 29.0, 31.0]))
    own -= own.mean(axis=1, keepdims=True)
    inputs = np.zeros((len(t), len(vehicle.inputs)))
    motors = [vehicle.inputs.index(vehicle.file.rotor[name].channel) for name in vehicle.rotors]
    inputs[:, motors] = 0.6 + common[:, None] + own
    rows = parameter_rows(vehicle, truth)
    start = initial_states(vehicle, {"u": 3.0, "v": -1.0, "w": 0.5, "h": 50.0}, rows, inputs[0])
    out = vehicle.kernel().trajectories(rows, start, inputs, DT)[0]
    told = inputs.copy()
    if mixed:
        told[:, motors] -= 2.0 * own  # what the log holds turns the vehicle the other way
    columns = dict(zip(vehicle.outputs, out.T, strict=True))
    columns |= {name: columns[name] + x for name, x in (noise or {}).items()}
    recorded = {c: told[:, i] for i, c in enumerate(vehicle.inputs) if c.startswith("motor")}
    return from_columns("quad", t, columns | recorded | {"altitude": np.full(len(t), 50.0)})


def regressed(mixed: bool) -> tuple[dict[str, float], Estimates]:
    vehicle = builtin_vehicle("quad-x")
    return solved_for(vehicle, flown(vehicle, mixed, TRUTH), tuple(TRUTH))


def solved_for(vehicle: Vehicle, flight: Flight, free: tuple[str, ...]) -> tuple[dict[str, float], Estimates]:
    """Fit some numbers and hold the others."""
    problem = posed(with_few_free(vehicle, free), flight, 3.99)
    solved = estimate(RotorEquations.of(problem.layout, problem.pieces), TimeDomain(), bounded=True)
    assert solved is not None
    return {p.name: v for p, v in zip(problem.layout.parameters, solved.values, strict=False)}, solved


def test_the_truth_comes_back() -> None:
    values, solved = regressed(mixed=False)
    assert values == {name: pytest.approx(value, rel=0.02) for name, value in TRUTH.items()}
    assert set(MOMENTS) <= solved.r2.keys()


def test_gyros_and_accelerometers_are_enough() -> None:
    """Thrust, lag and inertia of a vehicle without drag, from a log that holds neither velocity nor attitude."""
    truth = {"rotors.T2": 7.0, "rotors.lag": 0.06, "mass.inertia.xx": 0.02, "mass.inertia.yy": 0.03}
    vehicle, none = builtin_vehicle("quad-x"), ("rotors.inflow", "rotors.drag", "body_drag.")
    still = {p.name: {"value": 0.0} for p in vehicle.parameters if p.name.startswith(none)}
    vehicle = vehicle.with_numbers({**still, **{n: {"free": True} for n in truth}})
    noise = {c: 0.01 * np.random.default_rng(i).standard_normal(400) for i, c in enumerate(("ax", "ay"))}
    whole = flown(vehicle, False, truth, noise)  # without drag they would read zero, as a dead sensor does
    sensed = replace(whole, data=whole.data.drop_vars(["vn", "ve", "vd", "phi", "theta", "psi"]))
    values, solved = solved_for(vehicle, sensed, tuple(truth))
    assert values == {name: pytest.approx(value, rel=0.02) for name, value in truth.items()}
    assert {"roll", "pitch", "vertical"} <= solved.r2.keys()


def test_moments_that_no_command_explains_are_left_out() -> None:
    """They would only teach how little the commands do; the forces tell the numbers without them."""
    values, solved = regressed(mixed=True)
    assert not {"roll", "yaw"} & solved.r2.keys()
    assert values == {name: pytest.approx(value, rel=0.1) for name, value in TRUTH.items()}


def test_a_turned_inertial_unit_with_scale_errors_is_in_the_equations() -> None:
    """At the truth the accelerations of the equations are those that the instruments tell."""
    text = builtin_vehicle("quad-x").text + (
        "\n[sensors]\nimu_alignment = [0.05, -0.04, 0.3]\naccelerometer_position = [0.05, 0.0, -0.02]\n"
        "p = { scale = 1.1 }\nr = { scale = 0.9 }\naz = { scale = 1.05 }\n"
    )
    vehicle = parse_vehicle(text, "turned")
    problem = posed(vehicle, flown(vehicle, False, {}), 3.99)
    (stretch,) = RotorEquations.of(problem.layout, problem.pieces).stretches
    inside = slice(20, -20)
    error = (stretch.measured - stretch.modeled(vehicle, parameter_rows(vehicle, {})))[inside]
    assert np.all(np.abs(error).max(axis=0) < 0.02 * np.ptp(stretch.measured[inside], axis=0))
