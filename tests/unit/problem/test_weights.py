"""Weights against the likelihood written out sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.problem import Weights


def test_a_sample_that_lacks_channels_has_the_covariance_of_those_it_has() -> None:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 4))
    covariance = root @ root.T + np.eye(4)
    weights = Weights.of(covariance)
    seen = rng.random((50, 4)) < 0.6
    error = rng.standard_normal((50, 4)) * seen
    plain = 0.0
    for e, s in zip(error, seen, strict=True):
        if s.any():
            plain += float(e[s] @ np.linalg.solve(covariance[np.ix_(s, s)], e[s]))
    assert float(np.sum(weights.whiten(error, seen) ** 2)) == pytest.approx(plain)


@pytest.mark.parametrize("covariance", [np.array([4.0, 9.0, 1.0]), np.eye(3) + 0.5])
def test_coloring_undoes_whitening(covariance: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    seen = rng.random((30, 3)) < 0.7
    error = rng.standard_normal((30, 3)) * seen
    weights = Weights.of(covariance)
    np.testing.assert_allclose(weights.colored(weights.whiten(error, seen), seen), error, atol=1e-12)
