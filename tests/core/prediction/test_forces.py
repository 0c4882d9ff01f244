"""The specific force of vehicles with rotors beside a flight, on simulated flights whose truth is known."""

import numpy as np
import pytest

from stoop.flight import Flight
from stoop.flight.flight import from_columns
from stoop.prediction.predict import CUTOFF, ForceCurves, force_curves, low_passed
from stoop.problem.prepare import with_average_voltage
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.load import parse_vehicle

DT = 0.01


def flown(vehicle: Vehicle) -> Flight:
    t = DT * np.arange(200)
    swing = 0.02 * np.sin(np.outer(t, [9.0, 11.0, 13.0, 7.0]))
    inputs = np.zeros((len(t), len(vehicle.inputs)))
    for i, name in enumerate(vehicle.rotors):
        inputs[:, vehicle.inputs.index(vehicle.file.rotor[name].channel)] = 0.6 + swing[:, i]
    rows = vehicle.parameter_rows()
    start = vehicle.initial_states({"u": 3.0, "v": -1.0, "w": 0.5, "h": 50.0}, rows, inputs[0])
    out = vehicle.kernel().trajectories(rows, start, inputs, DT)[0]
    recorded = dict(zip(vehicle.inputs, inputs.T, strict=True))
    motors = {c: x for c, x in recorded.items() if c.startswith("motor")}
    columns = dict(zip(vehicle.outputs, out.T, strict=True)) | motors
    return from_columns("quad", t, columns | {"altitude": np.full(len(t), 50.0)})


@pytest.fixture(scope="module")
def quad() -> Vehicle:
    return builtin_vehicle("quad-x")


def test_the_true_model_leaves_nothing_but_a_bias_of_the_fit(quad: Vehicle) -> None:
    flights, window = {"quad": flown(quad)}, Window("quad", 0.0, 1.99)
    curves, biased = (force_curves(quad, flights, window, b) for b in ({}, {"sensors.ax.bias": 0.5}))
    assert len(curves.time) == 200
    np.testing.assert_allclose(curves.model, curves.measured, atol=2e-3)
    np.testing.assert_allclose(biased.model[:, 0] - curves.model[:, 0], 0.5, atol=1e-9)


def test_half_is_left_at_the_cutoff() -> None:
    t = DT * np.arange(4000)
    for frequency, share in ((0.5, 1.0), (CUTOFF, 0.5), (25.0, 0.0)):
        wave = np.sin(2.0 * np.pi * frequency * t)[:, None]
        left = np.std(low_passed(wave, DT)[500:-500]) / np.std(wave)
        assert left == pytest.approx(share, abs=0.01)
    squares = np.linspace(1.0, 2.0, 50)
    force = np.column_stack([np.full(50, 0.3), np.full(50, -0.1), -4.0 - 3.0 * squares])
    learned = ForceCurves(DT * np.arange(50), force, force, squares)
    later = ForceCurves(learned.time, force + np.array([1.0, 0.0, 0.0]), force, squares)
    ax, az = (later.residuals([learned])[name] for name in ("ax", "az"))
    assert (ax.constant, ax.static, ax.model) == pytest.approx((1.0, 1.0, 1.0))
    assert az.static == pytest.approx(0.0, abs=1e-9)
    assert az.constant == pytest.approx(float(np.std(force[:, 2])))


def test_the_voltage_is_averaged_where_the_file_says_so(quad: Vehicle) -> None:
    t = DT * np.arange(6000)
    drained = 16.0 - 0.01 * t
    sagging = drained - 0.5 * (np.sin(5.0 * t) > 0.0)
    sagging[1000:1200] = np.nan
    flight = from_columns("quad", t, {"voltage": sagging, "p": 0.0 * t})
    text = """
name = "one"
mass = { mass = 1.0, inertia = { xx = 0.01, yy = 0.01, zz = 0.02 } }
rotors = { nominal_voltage = 16.8, voltage_average = 10.0, T2 = 30.0 }
rotor.m1 = { channel = "motor_1", position = [0.0, 0.0, 0.0], spin = "ccw" }
"""
    steady = from_columns("quad", t, {"voltage": drained})
    vehicle = parse_vehicle(text, "one")
    slow, mean = (with_average_voltage(vehicle, f).column("voltage") for f in (flight, steady))
    inner = slice(600, -600)
    np.testing.assert_allclose(mean[inner], drained[inner], atol=1e-9)  # the mean of a line is its middle
    np.testing.assert_array_equal(np.isnan(slow), np.isnan(sagging))
    inside = np.isfinite(slow) & (t > 15.0) & (t < 50.0)
    np.testing.assert_allclose(slow[inside], (drained - 0.25)[inside], atol=0.03)
    assert with_average_voltage(quad, flight) is flight
