from __future__ import annotations

import numpy as np
import pytest

from stoop.estimate.noise import correlation_times


def test_white_residuals_count_in_full() -> None:
    x = np.random.default_rng(0).standard_normal((4000, 3))
    assert correlation_times([x[:2000], x[2000:]], 0.01) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("a", [0.5, 0.9])
def test_ar1_has_its_known_correlation_time(a: float) -> None:
    """1 + 2 sum a^k = (1 + a) / (1 - a)."""
    rng = np.random.default_rng(1)
    x = np.zeros((60_000, 1))
    for k in range(1, len(x)):
        x[k] = a * x[k - 1] + rng.standard_normal()
    assert correlation_times([x], 0.01)[0] == pytest.approx((1 + a) / (1 - a), rel=0.2)


def test_holes_do_not_count() -> None:
    x = np.random.default_rng(2).standard_normal((3000, 1))
    x[::7] = np.nan
    assert correlation_times([x], 0.01)[0] < 1.3


def test_long_records_take_no_time() -> None:
    x = np.random.default_rng(3).standard_normal((100_000, 2))
    assert correlation_times([x], 0.01) == pytest.approx(1.0, abs=0.1)
