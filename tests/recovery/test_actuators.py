"""Rate limit and dead zone of a servo come back beside coefficients, by every estimator that simulates.

Flights are simulated twenty times as fast as they are recorded, so that the servo moves between the samples.
"""

from __future__ import annotations

from importlib.resources import files

import numpy as np
import pytest

from stoop.assessment.error_bars import error_bars
from stoop.base.arrays import FloatArray
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.flight import Flight, from_columns
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle, parse_vehicle

SUBSTEPS = 20
SERVO = {"controls.elevator.rate_limit": 0.35, "controls.elevator.dead_zone": 0.012}  #: rad/s, rad
MANEUVER = """
duration = 15.0
rate = 1000.0
[[input]]
control = "elevator"
shape = "3-2-1-1"
start = 1.0
step = 0.4
amplitude = 0.06
slew = 1.0
[[input]]
control = "elevator"
shape = "doublet"
start = 7.0
step = 1.0
amplitude = 0.05
slew = 1.0
"""
FREE = {
    "CL0": (-1.0, 2.0), "CLalpha": (2.0, 9.0), "CLelevator": (-1.0, 3.0), "Cm0": (-0.5, 0.5), "Cmalpha": (-4.0, 0.0),
    "Cmq": (-90.0, -5.0), "Cmelevator": (-3.0, 0.0),
}  # fmt: skip


def truth() -> Vehicle:
    numbers = "".join(f"{name.rpartition('.')[2]} = {value}\n" for name, value in SERVO.items())
    tables = f"[controls.elevator]\n{numbers}[controls.aileron]\n[controls.rudder]\n"
    vehicle = parse_vehicle((files("stoop") / "data" / "twin_boom.toml").read_text() + tables, "servo")
    vehicle = vehicle.reduced("longitudinal")
    return vehicle.with_numbers({p.name: {"free": False} for p in vehicle.parameters if p.free})


def flight(vehicle: Vehicle, seed: int) -> Flight:
    """Simulate a vehicle at 1 kHz and record it at 50 Hz, with noise."""
    flown = simulate_flight(vehicle, parse_maneuver(MANEUVER, "servo"), seed=seed, noise=False, name="sim")
    rng, columns = np.random.default_rng([seed, 1]), {}
    for name in map(str, flown.data.data_vars):
        x, sensor = flown.column(name)[::SUBSTEPS], getattr(vehicle.file.sensors, name, None)
        columns[name] = x if sensor is None else x + sensor.sigma * rng.standard_normal(len(x))
    return from_columns("sim", flown.time[::SUBSTEPS], columns)


def recovered(method: str, seed: int) -> tuple[Estimate, FloatArray]:
    """Return the fit, and the errors of servo and coefficients in standard errors."""
    vehicle, rng = truth(), np.random.default_rng([seed, 2])
    wrong = {
        n: {"value": vehicle.value(n) * rng.uniform(0.6, 1.4), "bounds": b, "free": True}
        for n, b in FREE.items()
    }
    unknown = {
        "controls.elevator.rate_limit": {"value": 0.6, "bounds": (0.1, 1.0), "free": True},
        "controls.elevator.dead_zone": {"value": 0.0, "bounds": (0.0, 0.05), "free": True},
    }
    found = methods.find(method).fitter()(
        vehicle.with_numbers({**wrong, **unknown}), {"sim": flight(vehicle, seed)}, [Window("sim", 0.0, 15.0)],
        Options(method=method), None, None,
    )  # fmt: skip
    std = dict(zip((p.name for p in found.problem.layout.parameters), error_bars(found).std, strict=False))
    known = {n: vehicle.value(n) for n in FREE} | SERVO
    return found, np.array([(found.estimates[n] - value) / std[n] for n, value in known.items()])


@pytest.mark.parametrize("method", ["output-error", "multiple-shooting", "filter-error"])
def test_a_servo_comes_back(method: str) -> None:
    found, z = recovered(method, 1)
    assert found.outcome.status == "converged"
    assert np.abs(z).max() < 3.5
    assert found.estimates["controls.elevator.rate_limit"] == pytest.approx(0.35, rel=0.1)
    assert found.estimates["controls.elevator.dead_zone"] == pytest.approx(0.012, abs=0.004)
