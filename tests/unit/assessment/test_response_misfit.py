"""What a model misses of frequency responses, against systems whose responses are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from stoop.assessment.response_misfit import response_misfits
from stoop.assessment.verdict import LIMITS
from stoop.flight.frequency import Stretch
from stoop.results.response_misfit import ResponseMisfit

RATE = 50.0
COUNT = 3000


def flown(seed: int, noise: float, modeled: float) -> tuple[ResponseMisfit, ...]:
    """Return the misfits of a model with a share of the true gain, of a first-order system with two inputs that move together."""
    rng = np.random.default_rng(seed)
    u = lfilter([0.3], [1.0, -0.7], rng.standard_normal((2, COUNT)))
    u[1] += 0.5 * u[0]
    clean = lfilter([0.1], [1.0, -0.9], u[0]) - 0.3 * lfilter([0.1], [1.0, -0.9], u[1])
    measured = clean + noise * rng.standard_normal(COUNT)
    left = measured - clean * modeled
    return response_misfits([Stretch(RATE, u.T, np.column_stack([measured, left]))], ("a", "b"), ("p",))


@pytest.mark.parametrize("modeled", [0.0, 0.5, 0.7, 0.9, 1.3])
def test_a_gain_that_is_wrong_by_a_share_leaves_that_share(modeled: float) -> None:
    first, second = flown(1, 1e-3, modeled)
    for one in (first, second):
        assert one.share == pytest.approx(abs(1.0 - modeled), rel=0.02)
        assert one.least <= one.share
    assert first.input == "a"
    assert 0.0 < first.low < first.high <= 2.0 * np.pi * 10.0


@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_of_a_right_model_little_more_than_noise_is_left(noise: float) -> None:
    found = [one.least for seed in range(100) for one in flown(seed, noise, 1.0)]
    assert np.mean(np.array(found) > 0.0) < 0.06
    assert max(found) < LIMITS.error


def test_a_response_that_the_flights_do_not_show_is_not_judged() -> None:
    assert flown(1, 30.0, 0.5) == ()
