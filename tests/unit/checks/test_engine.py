"""The largest residuals are those that a stable sort puts first."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stoop.checks.engine import _largest


@given(st.lists(st.integers(0, 4), min_size=1, max_size=40), st.data())
def test_the_largest_and_of_equal_ones_the_first(numbers: list[int], data: st.DataObject) -> None:
    x = np.array(numbers, dtype=np.float64)
    count = data.draw(st.integers(1, x.size))
    expected = np.argsort(-x, kind="stable")[:count]
    np.testing.assert_array_equal(_largest(x, count), np.sort(expected))
