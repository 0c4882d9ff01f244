"""Weights against the likelihood sample by sample, and by the color of residuals against dense covariances."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from stoop.assessment.error_bars import error_bars
from stoop.estimate.fit import Options, fit
from stoop.estimate.treatment import Treatment
from stoop.flight import Flight
from stoop.problem import Weights
from stoop.problem.color import ChannelColor, Color, ColoredWeights
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle


def test_a_sample_that_lacks_channels_has_the_covariance_of_those_it_has() -> None:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 4))
    covariance = root @ root.T + np.eye(4)
    seen = rng.random((50, 4)) < 0.6
    error = rng.standard_normal((50, 4)) * seen
    each = zip(error, seen, strict=True)
    plain = sum(e[s] @ np.linalg.solve(covariance[np.ix_(s, s)], e[s]) for e, s in each)
    assert np.sum(Weights.of(covariance).whiten(error, seen) ** 2) == pytest.approx(plain)


@pytest.mark.parametrize("covariance", [np.array([4.0, 9.0, 1.0]), np.eye(3) + 0.5])
def test_coloring_undoes_whitening(covariance: np.ndarray) -> None:
    rng, weights = np.random.default_rng(1), Weights.of(covariance)
    seen = rng.random((30, 3)) < 0.7
    error = rng.standard_normal((30, 3)) * seen
    np.testing.assert_allclose(weights.colored(weights.whiten(error, seen), seen), error, atol=1e-12)


def process(color: ChannelColor, count: int) -> np.ndarray:
    """Return the covariance (count, count) of readings: the autocorrelation goes on as its autoregression says."""
    r = color.autocorrelation.tolist()
    a = np.linalg.solve(toeplitz(r[:-1]), r[1:])
    while len(r) < count:
        r.append(float(a @ r[: -len(a) - 1 : -1]))
    return toeplitz(r[:count])


@given(st.integers(1, 6), st.integers(1, 30), st.floats(0.0, 0.98), st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_whitening_is_the_inverse_root_of_the_covariance(
    order: int, count: int, slow: float, seed: int
) -> None:
    """Of the stationary process, from its first reading on; the others are its transpose and its inverse."""
    color = ChannelColor(np.append(1.0, 0.9 * slow ** np.arange(1, order + 1)))
    one = np.eye(count)
    white = color.whiten(one)
    np.testing.assert_allclose(white @ process(color, count) @ white.T, one, atol=1e-9)
    assert np.all(np.triu(white, 1) == 0.0)
    left = np.random.default_rng(seed).standard_normal((count, 2))
    np.testing.assert_allclose(color.whiten_back(left), white.T @ left, atol=1e-12)
    np.testing.assert_allclose(color.colored(white @ left), left, atol=1e-9)


def test_readings_that_are_missing_or_slow_are_no_neighbors() -> None:
    """After a gap a stretch begins anew; of a channel read every third sample, neighbors are three samples apart."""
    color = ChannelColor(np.array([1.0, 0.8, 0.5]))
    present = np.zeros((20, 3), dtype=bool)
    present[:8, 0] = present[11:, 0] = present[::3, 1] = present[:, 2] = True
    rng = np.random.default_rng(1)
    residuals = rng.standard_normal((4, 20, 3)) * present
    colors = Color((color, color, ChannelColor(np.ones(1))), (1, 3, 1))
    weights = ColoredWeights(np.eye(3), np.eye(3), colors)
    white = weights.whiten(residuals, present)
    for lane, own in zip(white, residuals, strict=True):
        np.testing.assert_allclose(lane[:8, 0], color.whiten(own[:8, :1])[:, 0])
        np.testing.assert_allclose(lane[11:, 0], color.whiten(own[11:, :1])[:, 0])
        np.testing.assert_allclose(lane[::3, 1], color.whiten(own[::3, 1:2])[:, 0])
        np.testing.assert_array_equal(lane[:, 2], own[:, 2])
    assert np.all(white[:, ~present] == 0.0)
    left = rng.standard_normal((20, 3))
    total = np.sum(left * present * white[0])
    assert np.sum(weights.whiten_back(left, present) * residuals[0]) == pytest.approx(total)
    np.testing.assert_allclose(weights.colored(white[0], present), residuals[0], atol=1e-12)


def test_slow_errors_of_the_sensors_are_weighed_by_their_color(
    aircraft: Vehicle, wrong: Vehicle, flight: Flight
) -> None:
    """Estimates are nearer the truth, and error bars hold both weightings."""
    rng, data = np.random.default_rng(5), flight.data
    for channel in ("p", "q", "r", "alpha", "beta", "phi", "theta"):
        steps = np.append(0.0, np.radians(0.05) * rng.standard_normal(len(flight.time) - 1))
        if channel in flight.names:
            data = data.assign({channel: data[channel] + lfilter([1.0], [1.0, -0.98], steps)})
    disturbed, window = {"sim": dataclasses.replace(flight, data=data)}, [Window("sim", 0.0, 30.0)]
    found = fit(wrong, disturbed, window, Options())
    plain = fit(wrong, disturbed, window, Options(treatment=Treatment(noise_color=False)))
    assert [one.name for one in found.decisions if one.name == "noise-color"]
    assert not isinstance(plain.problem.weights, ColoredWeights)
    np.testing.assert_array_equal(plain.disagreement, 0.0)
    true = np.array([aircraft.value(n) for n in plain.estimates])
    size = error_bars(plain).std[: len(true)]
    known = size > 0.0
    off = [(np.array([*one.estimates.values()]) - true)[known] / size[known] for one in (found, plain)]
    assert np.sqrt(np.mean(off[0] ** 2)) < 0.8 * np.sqrt(np.mean(off[1] ** 2))
    free, bars = found.evidence.free, error_bars(found)
    assert np.all(bars.std[free] >= np.minimum(np.abs(found.disagreement[free]), bars.priors))
