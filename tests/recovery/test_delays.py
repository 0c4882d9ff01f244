"""Free delays of sensors come back beside coefficients; a filter, which needs known ones, keeps their noise white.

Flights are simulated twenty times as fast as they are recorded, and delays are whole steps of that: none of the
interpolations of the estimators is in the data.
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
DELAYS = {"alpha": 0.033, "q": 0.012, "theta": 0.05}  #: s; 1.65, 0.6, and 2.5 samples
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
amplitude = 0.04
slew = 1.0
"""
GUSTS = """
[turbulence]
u = { intensity = { value = 1.5 }, length = 200.0 }
w = { intensity = { value = 1.2 }, length = 100.0 }
"""
FREE = {
    "CL0": (-1.0, 2.0), "CLalpha": (2.0, 9.0), "CLelevator": (-1.0, 3.0), "Cm0": (-0.5, 0.5), "Cmalpha": (-4.0, 0.0),
    "Cmq": (-90.0, -5.0), "Cmelevator": (-3.0, 0.0),
}  # fmt: skip


def late_flight(vehicle: Vehicle, seed: int) -> Flight:
    """Simulate a vehicle whose sensors are prompt, and read those of `DELAYS` late, at 50 Hz, with noise."""
    flown = simulate_flight(vehicle, parse_maneuver(MANEUVER, "late"), seed=seed, noise=False, name="sim")
    rng, columns = np.random.default_rng([seed, 1]), {}
    for name in map(str, flown.data.data_vars):
        x, late = flown.column(name), round(1000.0 * DELAYS.get(name, 0.0))
        x = np.concatenate([np.full(late, x[0]), x[: len(x) - late]])[::SUBSTEPS]
        sensor = getattr(vehicle.file.sensors, name, None)
        columns[name] = x if sensor is None else x + sensor.sigma * rng.standard_normal(len(x))
    return from_columns("sim", flown.time[::SUBSTEPS], columns)


def delayed_vehicle(more: str = "") -> Vehicle:
    sensors = "".join(f"[sensors.{channel}]\ndelay = 0.0\n" for channel in DELAYS)
    text = (files("stoop") / "data" / "twin_boom.toml").read_text() + sensors + more
    vehicle = parse_vehicle(text, "late").reduced("longitudinal")
    return vehicle.with_numbers({p.name: {"free": False} for p in vehicle.parameters if p.free})


def started(vehicle: Vehicle, seed: int) -> Vehicle:
    """Free coefficients and delays, the former wrong by up to 40 %."""
    rng = np.random.default_rng([seed, 2])
    wrong = {
        n: {"value": vehicle.value(n) * rng.uniform(0.6, 1.4), "bounds": b, "free": True}
        for n, b in FREE.items()
    }
    unknown = {"value": 0.01, "bounds": (-0.05, 0.12), "free": True}
    return vehicle.with_numbers({**wrong, **{f"sensors.{c}.delay": unknown for c in DELAYS}})


def recovered(method: str, vehicle: Vehicle, seed: int) -> tuple[Estimate, FloatArray]:
    """Return the fit, and the errors of delays and coefficients in standard errors."""
    truth = {n: vehicle.value(n) for n in FREE} | {f"sensors.{c}.delay": d for c, d in DELAYS.items()}
    flights = {"sim": late_flight(vehicle, seed)}
    fitter = methods.find(method).fitter()
    window = [Window("sim", 0.0, 15.0)]
    found = fitter(started(vehicle, seed), flights, window, Options(method=method), None, None)
    std = dict(zip((p.name for p in found.problem.layout.parameters), error_bars(found).std, strict=False))
    return found, np.array([(found.estimates[n] - value) / std[n] for n, value in truth.items()])


@pytest.mark.parametrize("method", ["output-error", "multiple-shooting"])
def test_delays_come_back_in_calm_air(method: str) -> None:
    found, z = recovered(method, delayed_vehicle(), 1)
    assert found.outcome.status == "converged"
    assert np.abs(z).max() < 3.5
    assert all(found.estimates[f"sensors.{c}.delay"] == pytest.approx(d, abs=0.01) for c, d in DELAYS.items())


def test_a_known_delay_leaves_the_noise_as_it_is_in_gusts() -> None:
    prompt = delayed_vehicle(GUSTS)
    flight = late_flight(prompt, 1)
    known = {f"sensors.{c}.delay": {"value": late, "free": False} for c, late in DELAYS.items()}
    options, window = Options(method="filter-error"), [Window("sim", 0.0, 15.0)]
    found = methods.find("filter-error").fitter()(
        started(prompt, 1).with_numbers(known), {"sim": flight}, window, options, None, None
    )
    assert found.outcome.status == "converged"
    std = dict(zip((p.name for p in found.problem.layout.parameters), error_bars(found).std, strict=False))
    assert max(abs(found.estimates[n] - prompt.value(n)) / std[n] for n in FREE) < 3.5
    noise = dict(zip(prompt.outputs, np.sqrt(np.diag(found.measurement_noise)), strict=True))
    for channel in DELAYS:
        assert noise[channel] == pytest.approx(getattr(prompt.file.sensors, channel).sigma, rel=0.15)


@pytest.mark.parametrize("method", ["multiple-shooting"])
def test_intervals_hold_the_truth(method: str) -> None:
    z = np.array([recovered(method, delayed_vehicle(), seed)[1] for seed in range(40)])
    inside = np.abs(z) < 1.96
    assert 0.90 <= inside[:, : len(FREE)].mean() <= 0.98
    assert 0.90 <= inside[:, len(FREE) :].mean() <= 0.98
