"""Scale and rate: what controls give, against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from stoop_studies.optimizers.mutation import ByCost, Signed


def test_signed_scales_are_uniform_in_size_and_of_either_sign() -> None:
    scales, rate = Signed(0.4, 1.0, rate=0.5).sample(None, np.ones(20_000), np.random.default_rng(1))
    assert rate == 0.5
    assert scales.shape == (20_000, 1)
    assert ((np.abs(scales) >= 0.4) & (np.abs(scales) <= 1.0)).all()
    assert (scales > 0.0).mean() == pytest.approx(0.5, abs=0.02)
    shares = np.histogram(np.abs(scales), bins=6, range=(0.4, 1.0))[0] / 20_000
    assert shares == pytest.approx(np.full(6, 1 / 6), abs=0.015)


def test_rates_by_cost_equal_their_naive_twin() -> None:
    F = np.array([3.0, 1.0, 9.0, 5.0, np.inf])
    scale, rates = ByCost(0.9, 0.1, 0.6).sample(None, F, np.random.default_rng(0))
    finite, expected = [3.0, 1.0, 9.0, 5.0], []
    for f in F:
        place = 1.0 if f == np.inf else (f - min(finite)) / (max(finite) - min(finite))
        expected.append(0.1 + 0.5 * place if f > sum(finite) / 4 else 0.1)
    assert scale == 0.9
    assert rates[:, 0].tolist() == pytest.approx(expected)
