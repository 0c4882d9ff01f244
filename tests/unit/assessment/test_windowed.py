"""The covariance of estimates from windows, against many repetitions of noise that grows along each window."""

import numpy as np
import pytest

from stoop.assessment.covariance import MIN_WINDOWS, widened, windowed_covariance
from stoop.problem.evidence import PieceEvidence

LENGTH = 40


def gusty(rng: np.random.Generator, windows: int) -> np.ndarray:
    """White noise beside a walk that begins anew with each window (n, 1)."""
    walk = 0.3 * np.cumsum(rng.standard_normal((windows, LENGTH)), axis=1)
    return (walk + rng.standard_normal((windows, LENGTH))).reshape(-1, 1)


def repeated(slopes: np.ndarray, windows: int, times: int) -> np.ndarray:
    """Return the mean variance that is told over the variance (k,) of estimates, for slopes (n, k)."""
    rng, (n, k) = np.random.default_rng(0), slopes.shape
    pull = np.linalg.inv(slopes.T @ slopes) @ slopes.T
    none = (np.empty((windows - 1, 0)), np.empty((windows - 1, 0, k)))
    edges = tuple(range(0, n + 1, LENGTH))
    found, told = [], []
    for _ in range(times):
        noise = gusty(rng, windows)
        estimate = pull @ noise[:, 0]
        segment = PieceEvidence(noise - (slopes @ estimate)[:, None], slopes[:, None, :])
        covariance = windowed_covariance([segment], [edges], [none], np.zeros((k, k)))
        found.append(estimate)
        told.append(np.diag(covariance))
    return np.mean(told, axis=0) / np.mean(np.square(found), axis=0)


def test_standard_errors_are_those_of_repetitions():
    rng, n = np.random.default_rng(1), 60 * LENGTH
    slopes = np.stack([np.tile(np.linspace(-1, 1, LENGTH), 60), rng.standard_normal(n)], axis=1)
    assert repeated(slopes, 60, 200) == pytest.approx(1.0, rel=0.25)


def test_what_a_fit_takes_up_of_the_noise_of_few_windows_is_given_back():
    """Six slow unknowns take up a sixth of the noise of thirteen windows, or else variances are a quarter too small."""
    rng, windows = np.random.default_rng(2), MIN_WINDOWS + 1
    level = np.repeat(rng.standard_normal((windows, 3)), LENGTH, axis=0)
    slopes = np.concatenate([level, level * np.tile(np.linspace(-1, 1, LENGTH), windows)[:, None]], axis=1)
    assert np.mean(repeated(slopes, windows, 400)) == pytest.approx(1.0, rel=0.12)


def test_of_what_one_window_alone_tells_the_others_foresee_nothing():
    rng, n = np.random.default_rng(3), 20 * LENGTH
    slopes = np.zeros((n, 2))
    slopes[:, 0] = rng.standard_normal(n)
    slopes[:LENGTH, 1] = 1.0
    told = repeated(slopes, 20, 100)
    assert np.isfinite(told).all()
    assert told[0] == pytest.approx(1.0, rel=0.25)


def test_no_variance_is_negative_however_short_pieces_are():
    rng = np.random.default_rng(4)
    for _ in range(50):
        pieces = [
            PieceEvidence(rng.standard_normal((120, 1)), rng.standard_normal((120, 1, 6))) for _ in range(4)
        ]
        none = (np.empty((2, 0)), np.empty((2, 0, 6)))
        covariance = windowed_covariance(pieces, [(0, 40, 80, 120)] * 4, [none] * 4, np.zeros((6, 6)))
        assert covariance is not None
        assert np.linalg.eigvalsh(covariance).min() >= 0.0


def test_the_wider_of_two_stands():
    one, other = np.array([[1.0, 0.5], [0.5, 4.0]]), np.diag([9.0, 1.0])
    wide = widened(one, other)
    assert np.allclose(wide, [[9.0, 1.5], [1.5, 4.0]])
    assert np.array_equal(widened(one, np.diag([np.inf, np.nan])), one)
