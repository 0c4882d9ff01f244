"""Bandwidth, phase delay and equivalent systems: figures of known transfer functions come back."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stoop.assessment.handling import Known, bandwidth, equivalent_system, error_correlation, flight_draws
from stoop.base.arrays import ComplexArray, FloatArray

FREQUENCY = np.geomspace(0.5, 40.0, 400)


def short_period(w: FloatArray, sign: float = -1.0, delay: float = 0.08) -> ComplexArray:
    s = 1j * w
    return np.asarray(sign * 20.0 * (s + 1.5) * np.exp(-delay * s) / (s**2 + 2 * 0.6 * 5.0 * s + 25.0))


def known(response: ComplexArray, w: FloatArray = FREQUENCY) -> Known:
    return Known(w, response, np.ones(len(w)), np.zeros((0, len(w)), dtype=complex))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_pure_lag_with_delay(sign: float) -> None:
    """Attitude K e^(-tau s)/s lags 90 deg and tau w: all four figures are closed expressions, whatever the sign."""
    tau = 0.1
    found = bandwidth(known(np.asarray(sign * 3.0 * np.exp(-1j * tau * FREQUENCY))))
    assert found.crossover.estimate == pytest.approx(0.5 * np.pi / tau, rel=1e-4)
    assert found.phase_bandwidth.estimate == pytest.approx(0.25 * np.pi / tau, rel=1e-4)
    assert found.gain_bandwidth.estimate == pytest.approx(
        0.5 * np.pi / tau / 10 ** (6.0 / 20.0), rel=1e-4
    )  # magnitude 3/w
    assert found.phase_delay.estimate == pytest.approx(0.5 * tau, rel=1e-3)  # (pi + pi/2 - pi)/(2 w180)


def test_what_is_not_reached_has_no_value() -> None:
    found = bandwidth(known(np.ones(len(FREQUENCY), dtype=complex)))
    assert np.isnan([found.crossover.estimate, found.phase_delay.estimate]).all()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_short_period_comes_back(sign: float) -> None:
    w = np.geomspace(1.0, 20.0, 40)
    system = equivalent_system(known(short_period(w, sign), w), "elevator", "q")
    assert system is not None
    found = {n: e.estimate for n, e in system.parameters.items()}
    expected = {"gain": 20.0 * sign, "delay": 0.08, "zero": 1.5, "frequency": 5.0, "damping": 0.6}
    assert found == pytest.approx(expected, rel=1e-4)
    assert system.cost < 1e-6


def test_a_roll_mode_comes_back() -> None:
    w = np.geomspace(1.0, 20.0, 40)
    response = np.asarray(7.0 * np.exp(-0.05j * w) / (0.25j * w + 1.0))
    system = equivalent_system(known(response, w), "aileron", "p")
    assert system is not None
    assert {n: e.estimate for n, e in system.parameters.items()} == pytest.approx(
        {"gain": 7.0, "delay": 0.05, "time_constant": 0.25}, rel=1e-4
    )


def test_too_few_frequencies_have_no_system() -> None:
    w = np.geomspace(1.0, 20.0, 5)
    assert equivalent_system(known(short_period(w), w), "elevator", "q") is None


def test_intervals_hold_what_random_errors_scatter() -> None:
    """Standard errors of a flight's equivalent system are the scatter over draws of its random errors."""
    w, error, window = np.geomspace(1.0, 20.0, 30), np.full(30, 0.05), np.full(30, 8.0)
    draws = flight_draws(w, short_period(w), error, window, seed=3)[:60]
    fits = [
        equivalent_system(Known(w, one, np.ones(30), draws[:0], error, window), "e", "q") for one in draws
    ]
    for name, truth in (("frequency", 5.0), ("damping", 0.6), ("delay", 0.08)):
        found = [f.parameters[name] for f in fits if f is not None]
        scatter = np.std([e.estimate for e in found])
        assert np.median([e.std_error for e in found]) == pytest.approx(scatter, rel=0.35)
        assert np.mean([e.ci95_lower <= truth <= e.ci95_upper for e in found]) >= 0.85


def test_errors_far_apart_are_independent() -> None:
    shared = error_correlation(np.array([1.0, 1.01, 50.0]), np.full(3, 10.0))
    assert_allclose(np.diag(shared), 1.0)
    assert shared[0, 1] > 0.99
    assert abs(shared[0, 2]) < 1e-3
