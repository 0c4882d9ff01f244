"""Derivatives of NumPy's functions against differences in many digits, and the second ones of nested duals."""

from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.base.dual import Dual

NUMBER = st.floats(0.1, 10.0) | st.floats(-10.0, -0.1)


def function(x: Any, y: Any, lib: Any) -> Any:
    absolute, arctan2 = (lib.fabs, lib.atan2) if lib is mpmath else (np.absolute, np.arctan2)
    root = lib.sqrt(x * x + 3.0 * y * y)
    return absolute(x) * arctan2(y, root + x) - (-y) / (5.0 + root) + 1.0 / (4.0 + absolute(y))


@settings(max_examples=40)
@given(NUMBER, NUMBER)
def test_first_derivatives(x: float, y: float) -> None:
    found = function(Dual(x, np.array([1.0, 0.0])), Dual(y, np.array([0.0, 1.0])), np)
    with mpmath.workdps(40):
        parts = [mpmath.diff(lambda a, b: function(a, b, mpmath), (x, y), n) for n in ((1, 0), (0, 1))]
    expected = [float(part) for part in parts]
    assert (found.value, found.slope) == (function(x, y, np), pytest.approx(expected, rel=1e-12, abs=1e-12))


@given(NUMBER, NUMBER, NUMBER)
def test_derivative_of_a_rate(x: float, y: float, rate: float) -> None:
    """With x' = rate * y and y' = x, the rate of a function is a function, too, and has derivatives."""

    def plain(a: Any, b: Any) -> Any:
        return np.arctan2(a, np.sqrt(a * a + b * b)) * b

    a, b = Dual(x, np.array([1.0, 0.0])), Dual(y, np.array([0.0, 1.0]))
    found = plain(Dual(a, rate * b), Dual(b, a)).slope

    def rate_of(u: float, v: float) -> float:
        return float(plain(Dual(u, rate * v), Dual(v, u)).slope)

    steps = ((1e-5, 0.0), (0.0, 1e-5))
    expected = [(rate_of(x + h, y + k) - rate_of(x - h, y - k)) / 2e-5 for h, k in steps]
    assert found.value == pytest.approx(rate_of(x, y), rel=1e-14, abs=1e-14)
    assert found.slope == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_arrays_and_directions_broadcast_and_what_has_no_derivative_is_refused() -> None:
    x = Dual(np.array([[1.0], [4.0]]), np.eye(3)[1])
    np.testing.assert_array_equal(np.sqrt(x).slope, [[0.0, 0.5, 0.0], [0.0, 0.25, 0.0]])
    with pytest.raises(TypeError, match="exp"):
        np.exp(Dual(1.0, 1.0))
