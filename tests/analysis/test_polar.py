"""The polar's regression against truth, and momentum theory against its closed form."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from stoop_analysis.performance.polar import Blocks, Propulsion, fit_polar, useful_power

AREA, MASS, GRAVITY, DENSITY = 1.5, 9.4, 9.81, 1.2
EFFICIENCY, DIAMETER = 0.72, 0.4
DISC = 0.25 * np.pi * DIAMETER**2
TRUTH = (0.04, 0.08, 0.5)  #: CD0, K, CL0


def flown(seed: int, count: int = 80, gusty: float = 0.15) -> Blocks:
    """Climb, cruise and sink at many speeds, in vertical gusts that remember."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform(9.0, 17.0, count)
    power = rng.uniform(0.0, 500.0, count)
    dynamic = 0.5 * DENSITY * speed**2 * AREA
    CL = MASS * GRAVITY / dynamic
    CD = TRUTH[0] + TRUTH[1] * (CL - TRUTH[2]) ** 2
    useful = useful_power(power, speed, np.full(count, DENSITY), EFFICIENCY, DISC)
    gust = lfilter([1.0], [1.0, -0.5], gusty * rng.standard_normal(count))
    climbing = useful - CD * dynamic * speed + MASS * GRAVITY * gust
    zeros = np.zeros(count)
    return Blocks(
        5.0 * np.arange(count), zeros.astype(np.intp), speed, np.full(count, DENSITY),
        np.full(count, MASS * GRAVITY), zeros, climbing, 0.1 * CL, power, True,
    )  # fmt: skip


def test_intervals_hold_the_truth() -> None:
    CL = np.array([0.5, 0.8, 1.1])
    truth = TRUTH[0] + TRUTH[1] * (CL - TRUTH[2]) ** 2
    inside = []
    for seed in range(60):
        rng = np.random.default_rng(1000 + seed)
        assumed = Propulsion(EFFICIENCY + 0.1 * rng.standard_normal(), 0.1, DIAMETER)
        value, std = fit_polar(flown(seed), MASS, AREA, 0.01, assumed).drag(CL)
        inside.append(np.abs(value - truth) < 1.96 * std)
    assert 0.88 <= np.mean(inside) <= 0.995


def test_with_next_to_no_gusts_the_polar_and_the_efficiency_come_back() -> None:
    found = fit_polar(flown(0, gusty=0.002), MASS, AREA, 1e-3, Propulsion(0.65, 0.2, DIAMETER)).summary
    CL = np.linspace(0.1, 2.0, 2000)
    glide = np.max(CL / (TRUTH[0] + TRUTH[1] * (CL - TRUTH[2]) ** 2))
    names = ("CD0", "K", "CL0", "best glide", "efficiency")
    truth = dict(zip(names, (*TRUTH, glide, EFFICIENCY), strict=True))
    assert {n: found[n][0] for n in truth} == pytest.approx(truth, rel=0.02)
    found = replace(fit_polar(flown(0), MASS, AREA, 0.01), values=np.array([-50.0, 0.0, 0.0, 1.0, 0.7, -1.0]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        power, std = found.level_power(np.array([5.0, 20.0]))
    assert np.isnan(power).all()
    assert np.isnan(std).all()


def test_momentum_theory_against_its_closed_form() -> None:
    """At a thrust T the induced speed is (sqrt(V^2 + 2 T / (rho A)) - V) / 2."""
    speed, thrust = np.array([5.0, 10.0, 20.0]), np.array([20.0, 8.0, 3.0])
    induced = 0.5 * (np.sqrt(speed**2 + 2.0 * thrust / (DENSITY * DISC)) - speed)
    power = thrust * (speed + induced) / 0.7
    useful = useful_power(power, speed, np.full(3, DENSITY), 0.7, DISC)
    np.testing.assert_allclose(useful, thrust * speed, rtol=1e-12)
