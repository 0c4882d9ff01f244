"""The covariance of estimates from windows, against many repetitions of noise that grows along each window."""

import numpy as np
import pytest

from stoop.uncertainty.sensitivity import Sensitivity
from stoop.uncertainty.windowed import FEWEST, widened, windowed_covariance

WINDOWS, LENGTH = 60, 40
EDGES = tuple(range(0, (WINDOWS + 1) * LENGTH, LENGTH))


def gusty(rng: np.random.Generator) -> np.ndarray:
    """White noise beside a walk that begins anew with each window (n, 1)."""
    walk = 0.3 * np.cumsum(rng.standard_normal((WINDOWS, LENGTH)), axis=1)
    return (walk + rng.standard_normal((WINDOWS, LENGTH))).reshape(-1, 1)


def test_standard_errors_are_those_of_repetitions():
    rng = np.random.default_rng(1)
    slopes = np.stack([np.tile(np.linspace(-1, 1, LENGTH), WINDOWS), rng.standard_normal(EDGES[-1])], axis=1)
    pull = np.linalg.inv(slopes.T @ slopes) @ slopes.T
    found, told = [], []
    for _ in range(200):
        noise = gusty(rng)
        estimate = pull @ noise[:, 0]
        segment = Sensitivity(noise - (slopes @ estimate)[:, None], slopes[:, None, :])
        none = (np.empty((WINDOWS - 1, 0)), np.empty((WINDOWS - 1, 0, 2)))
        covariance = windowed_covariance([segment], [EDGES], [none], np.zeros((2, 2)))
        found.append(estimate)
        told.append(np.diag(covariance))
    assert np.mean(told, axis=0) == pytest.approx(np.var(found, axis=0), rel=0.25)


def test_few_windows_say_nothing():
    segment = Sensitivity(np.zeros((10, 1)), np.ones((10, 1, 1)))
    gap = (np.zeros((1, 1)), np.zeros((1, 1, 1)))
    assert FEWEST > 2
    assert windowed_covariance([segment], [(0, 5, 10)], [gap], np.zeros((1, 1))) is None


def test_the_wider_of_two_stands():
    one, other = np.array([[1.0, 0.5], [0.5, 4.0]]), np.diag([9.0, 1.0])
    wide = widened(one, other)
    assert np.allclose(wide, [[9.0, 1.5], [1.5, 4.0]])
    assert np.array_equal(widened(one, np.diag([np.inf, np.nan])), one)
