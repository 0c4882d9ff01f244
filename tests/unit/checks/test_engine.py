"""The largest residuals are those that a stable sort puts first, and an edit that is taken back was none."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stoop.checks.engine import Edit, Range, _largest, search


@given(st.lists(st.integers(0, 4), min_size=1, max_size=40), st.data())
def test_the_largest_and_of_equal_ones_the_first(numbers: list[int], data: st.DataObject) -> None:
    x = np.array(numbers, dtype=np.float64)
    count = data.draw(st.integers(1, x.size))
    expected = np.argsort(-x, kind="stable")[:count]
    np.testing.assert_array_equal(_largest(x, count), np.sort(expected))


def test_a_sign_that_is_turned_back_is_no_finding() -> None:
    """Beside a wrong attitude a rate explains more with the other sign, and with the attitude right it does not."""
    rate = Edit("sign", ("q",), "write scale = -1", lambda signs: (-signs[0], signs[1]))
    angle = Edit("sign", ("theta",), "write scale = -1", lambda signs: (signs[0], -signs[1]))

    # no channel convinces of the angle by itself while the rate stands as it is
    odds = {(1, -1): (30, 30, 30), (-1, -1): (10, 30, 30), (-1, 1): (10, 10, 32), (1, 1): (25, 25, 23)}

    def model(signs: tuple[int, int], changed: object) -> dict[tuple[str, ...], Range]:
        of_rate, of_angle, other = odds[signs]
        several = {("size", f"{i}"): Range(1.0, 0.0, 0.0, other) for i in range(6)}
        return {
            ("turn", "q"): Range(1.0, 0.0, 0.0, of_rate),
            ("turn", "p"): Range(1.0, 0.0, 0.0, of_angle),
            **several,
        }

    found, state = search((1, -1), lambda state: (rate, angle), model)
    assert [one.best for one in found] == [angle]
    assert state == (1, 1)
