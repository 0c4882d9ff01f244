"""Rate limit and dead zone of a servo, and delays of sensors, come back beside coefficients.

Flights are simulated twenty times as fast as they are recorded, so that servos move between the samples and delays are
whole steps: none of the interpolations of the estimators is in the data.
"""

from __future__ import annotations

import numpy as np
import pytest
from unit.estimate.fits import deviations, fit_by

from stoop.estimate.estimate import Estimate
from stoop.flight import Flight, from_columns
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text

SUBSTEPS = 20
WINDOW = [Window("sim", 0.0, 15.0)]
SERVO = {"controls.elevator.rate_limit": 0.35, "controls.elevator.dead_zone": 0.012}  #: rad/s, rad
DELAYS = {"alpha": 0.033, "q": 0.012, "theta": 0.05}  #: s; 1.65, 0.6, and 2.5 samples
LATE = {f"sensors.{channel}.delay": late for channel, late in DELAYS.items()}
INPUTS = (("3-2-1-1", 1.0, 0.4, 0.06), ("doublet", 7.0, 1.0, 0.05))
GUSTS = "[turbulence]\nu = { intensity = 1.5, length = 200.0 }\nw = { intensity = 1.2, length = 100.0 }\n"
FREE = {
    "CL0": (-1.0, 2.0), "CLalpha": (2.0, 9.0), "CLelevator": (-1.0, 3.0), "Cm0": (-0.5, 0.5), "Cmalpha": (-4.0, 0.0),
    "Cmq": (-90.0, -5.0), "Cmelevator": (-3.0, 0.0),
}  # fmt: skip
UNKNOWN = {
    "controls.elevator.rate_limit": (0.6, (0.1, 1.0)), "controls.elevator.dead_zone": (0.0, (0.0, 0.05)),
    **dict.fromkeys(LATE, (0.01, (-0.05, 0.12))),
}  # fmt: skip


def truth(tables: str) -> Vehicle:
    vehicle = parse_vehicle(builtin_text("twin-boom") + tables, "truth").reduced("longitudinal")
    return vehicle.with_numbers({p.name: {"free": False} for p in vehicle.parameters if p.free})


def prompt(more: str = "") -> Vehicle:
    """Return a vehicle whose delays are numbers, all zero."""
    return truth("".join(f"[sensors.{channel}]\ndelay = 0.0\n" for channel in DELAYS) + more)


def flight(vehicle: Vehicle, seed: int, late: dict[str, float]) -> Flight:
    """Simulate a vehicle at 1 kHz and read its sensors, some late, at 50 Hz, with noise."""
    keys = ("control", "shape", "start", "step", "amplitude", "slew")
    inputs = [dict(zip(keys, ("elevator", *one, 1.0), strict=True)) for one in INPUTS]
    maneuver = Maneuver.model_validate({"duration": 15.0, "rate": 1000.0, "input": inputs})
    flown = simulate_flight(vehicle, maneuver, seed=seed, noise=False, name="sim")
    rng, columns = np.random.default_rng([seed, 1]), {}
    for name in map(str, flown.data.data_vars):
        x, steps = flown.column(name), round(1000.0 * late.get(name, 0.0))
        x = np.concatenate([np.full(steps, x[0]), x[: len(x) - steps]])[::SUBSTEPS]
        sensor = getattr(vehicle.file.sensors, name, None)
        columns[name] = x if sensor is None else x + sensor.sigma * rng.standard_normal(len(x))
    return from_columns("sim", flown.time[::SUBSTEPS], columns)


def spoiled(vehicle: Vehicle, seed: int) -> Vehicle:
    """Free the coefficients, wrong by up to 40 %."""
    rng = np.random.default_rng([seed, 2])
    return vehicle.with_numbers({
        n: {"value": vehicle.value(n) * rng.uniform(0.6, 1.4), "bounds": b, "free": True} for n, b in FREE.items()
    })  # fmt: skip


def recovered(
    method: str, vehicle: Vehicle, seed: int, added: dict[str, float]
) -> tuple[Estimate, np.ndarray]:
    """Fit coefficients and what else is unknown; return the fit and all errors in standard errors."""
    unknown = {n: {"value": UNKNOWN[n][0], "bounds": UNKNOWN[n][1], "free": True} for n in added}
    flown = {"sim": flight(vehicle, seed, DELAYS if added is LATE else {})}
    found = fit_by(method, spoiled(vehicle, seed).with_numbers(unknown), flown, WINDOW)
    return found, deviations(found, {n: vehicle.value(n) for n in FREE} | added)


@pytest.mark.parametrize("method", ["output-error", "multiple-shooting", "filter-error"])
def test_a_servo_comes_back(method: str) -> None:
    numbers = "".join(f"{name.rpartition('.')[2]} = {value}\n" for name, value in SERVO.items())
    vehicle = truth(f"[controls.elevator]\n{numbers}[controls.aileron]\n[controls.rudder]\n")
    found, z = recovered(method, vehicle, 1, SERVO)
    assert found.outcome.status == "converged"
    assert np.abs(z).max() < 3.5
    assert found.estimates["controls.elevator.rate_limit"] == pytest.approx(0.35, rel=0.1)
    assert found.estimates["controls.elevator.dead_zone"] == pytest.approx(0.012, abs=0.004)


@pytest.mark.parametrize("method", ["output-error", "multiple-shooting"])
def test_delays_come_back_in_calm_air(method: str) -> None:
    found, z = recovered(method, prompt(), 1, LATE)
    assert found.outcome.status == "converged"
    assert np.abs(z).max() < 3.5
    assert {n: found.estimates[n] for n in LATE} == pytest.approx(LATE, abs=0.01)


def test_known_delays_leave_the_noise_as_it_is_in_gusts() -> None:
    vehicle = prompt(GUSTS)
    known = {n: {"value": late, "free": False} for n, late in LATE.items()}
    start, flown = spoiled(vehicle, 1).with_numbers(known), {"sim": flight(vehicle, 1, DELAYS)}
    found = fit_by("filter-error", start, flown, WINDOW)
    assert found.outcome.status == "converged"
    assert np.abs(deviations(found, {n: vehicle.value(n) for n in FREE})).max() < 3.5
    noise = dict(zip(vehicle.outputs, np.sqrt(np.diag(found.measurement_noise)), strict=True))
    for channel in DELAYS:
        assert noise[channel] == pytest.approx(getattr(vehicle.file.sensors, channel).sigma, rel=0.15)


def test_intervals_hold_the_truth() -> None:
    z = np.array([recovered("multiple-shooting", prompt(), seed, LATE)[1] for seed in range(40)])
    inside = np.abs(z) < 1.96
    assert 0.90 <= inside[:, : len(FREE)].mean() <= 0.98
    assert 0.90 <= inside[:, len(FREE) :].mean() <= 0.98
