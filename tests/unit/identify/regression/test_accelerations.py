"""Equation error of vehicles with rotors on a simulated fall, whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.flight import Flight
from stoop.flight.make import from_columns
from stoop.identify.fit import Options, pose
from stoop.identify.regression.accelerations import MOMENTS, Unknowns, fitted
from stoop.identify.regression.domain import Time
from stoop.identify.regression.estimate import boxed
from stoop.identify.regression.least_squares import Solved
from stoop.identify.windows import Window
from stoop.simulate import initial_states, parameter_rows
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle

DT = 0.01
TRUTH = {"rotors.T2": 7.0, "rotors.inflow": 0.3, "rotors.drag": 0.1}


def flown(vehicle: Vehicle, mixed: bool) -> Flight:
    """Return seconds of a quadrotor under commands that swing; mixed hides which of its motors was which."""
    t = DT * np.arange(400)
    common = 0.12 * np.sin(6.0 * t) + 0.06 * np.sin(17.0 * t)
    own = 0.006 * np.sin(np.outer(t, [19.0, 23.0, 29.0, 31.0]))
    own -= own.mean(axis=1, keepdims=True)
    inputs = np.zeros((len(t), len(vehicle.inputs)))
    motors = [vehicle.inputs.index(vehicle.file.rotor[name].channel) for name in vehicle.rotors]
    inputs[:, motors] = 0.6 + common[:, None] + own
    rows = parameter_rows(vehicle, TRUTH)
    start = initial_states(vehicle, {"u": 3.0, "v": -1.0, "w": 0.5, "h": 50.0}, rows, inputs[0])
    out = vehicle.kernel().trajectories(rows, start, inputs, DT)[0]
    told = inputs.copy()
    if mixed:
        told[:, motors] -= 2.0 * own  # what the log holds turns the vehicle the other way
    columns = dict(zip(vehicle.outputs, out.T, strict=True))
    recorded = {c: told[:, i] for i, c in enumerate(vehicle.inputs) if c.startswith("motor")}
    return from_columns("quad", t, columns | recorded | {"altitude": np.full(len(t), 50.0)})


def regressed(mixed: bool) -> tuple[dict[str, float], Solved]:
    vehicle = builtin_vehicle("quad-x")
    held = [p.name for p in vehicle.parameters if p.free and p.name not in TRUTH]
    own = vehicle.with_numbers({name: {"free": False} for name in held})
    problem, _ = pose(own, {"quad": flown(vehicle, mixed)}, [Window("quad", 0.0, 3.99)], Options())
    found = fitted(problem.layout, problem.pieces, Time(), boxed(problem.layout.parameters))
    assert found is not None
    unknowns, solved = found
    assert isinstance(unknowns, Unknowns)
    names = [p.name for p in problem.layout.parameters]
    return dict(zip(names, solved.values, strict=False)), solved


def test_the_truth_comes_back() -> None:
    values, solved = regressed(mixed=False)
    assert values == {name: pytest.approx(value, rel=0.02) for name, value in TRUTH.items()}
    assert set(MOMENTS) <= solved.r2.keys()


def test_moments_that_no_command_explains_are_left_out() -> None:
    """They would only teach how little the commands do; the forces tell the numbers without them."""
    values, solved = regressed(mixed=True)
    assert not {"roll", "yaw"} & solved.r2.keys()
    assert values == {name: pytest.approx(value, rel=0.1) for name, value in TRUTH.items()}
