from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from stoop.estimate.noise import correlation_times


def test_correlation_times() -> None:
    """Of white noise 1, holes or not; of an autoregression 1 + 2 sum a^k = (1 + a) / (1 - a)."""
    white = np.random.default_rng(0).standard_normal((4000, 3))
    white[::7, 2] = np.nan
    assert correlation_times([white[:2000], white[2000:]], 0.01) == pytest.approx(1.0, abs=0.15)
    for a in (0.5, 0.9):
        x = lfilter([1.0], [1.0, -a], np.random.default_rng(1).standard_normal((60_000, 1)), axis=0)
        assert correlation_times([x], 0.01)[0] == pytest.approx((1 + a) / (1 - a), rel=0.2)
