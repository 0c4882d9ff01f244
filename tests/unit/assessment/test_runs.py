"""Stretches are filtered each for itself, without phase shift, however short."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from stoop.assessment.goodness_of_fit import join, low_pass

RATE = 100.0


@pytest.mark.parametrize(("hertz", "gain"), [(1.0, 1.0), (10.0, 0.5), (40.0, 0.0)])
def test_gain_without_phase(hertz: float, gain: float) -> None:
    t = np.arange(1000) / RATE
    wave = np.sin(2 * np.pi * hertz * t)
    middle = slice(200, 800)
    assert_allclose(low_pass(wave, RATE)[middle], gain * wave[middle], atol=2e-3)


@given(st.lists(st.integers(1, 60), min_size=1, max_size=5))
def test_each_stretch_for_itself(sizes: list[int]) -> None:
    random = np.random.default_rng(1)
    pieces = [random.normal(size=size) for size in sizes]
    assert_allclose(low_pass(join(pieces), RATE), join([low_pass(piece, RATE) for piece in pieces]))


@given(st.integers(1, 200), st.floats(-1e3, 1e3))
def test_a_constant_stays(size: int, level: float) -> None:
    assert_allclose(low_pass(np.full(size, level), RATE), level, atol=1e-9 * max(1.0, abs(level)))
