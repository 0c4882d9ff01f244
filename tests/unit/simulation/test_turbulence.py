"""Dryden gusts: variance and spectrum as MIL-F-8785C prints them, read off a flight that nothing deflects."""

import numpy as np
import pytest
from scipy.signal import welch

from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.simulation.trajectories import finer, gust_start
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.load import parse_vehicle

SPEED, RATE = 35.0, 50.0
SIGMA = {"u": 1.0, "v": 1.5, "w": 0.8}
LENGTH = {"u": 8.0, "v": 5.0, "w": 6.0}


def gusty(text: str):
    table = "\n".join(f"{a} = {{ intensity = {SIGMA[a]}, length = {LENGTH[a]} }}" for a in "uvw")
    return parse_vehicle(f"{text}\n[turbulence]\n{table}\n", "gusty")


@pytest.fixture(scope="module")
def gusts():
    """Gusts (n,) by axis: what an arrow without weight or lift, as heavy as a mountain, reads off its vanes."""
    text = resolve_vehicle("twin-boom").text
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
    vehicle = gusty(resolve_vehicle("twin-boom").text)
    starts = [gust_start(vehicle, np.random.default_rng(i)) for i in range(4000)]
    root = np.sqrt(3.0)
    v = np.array([root * s["gust.v.fast"] + (1.0 - root) * s["gust.v.slow"] for s in starts])
    assert np.std(v) == pytest.approx(SIGMA["v"], rel=0.05)
    assert np.std([s["gust.u"] for s in starts]) == pytest.approx(SIGMA["u"], rel=0.05)


def test_finer_inputs_are_linear_between_the_samples():
    fine = finer(np.array([[0.0, 1.0], [2.0, 1.0], [0.0, 5.0]]), 4)
    assert np.allclose(fine.T, [[0, 0.5, 1, 1.5, 2, 1.5, 1, 0.5, 0], [1, 1, 1, 1, 1, 2, 3, 4, 5]])
