"""Equal values are equal texts, and come back to the last bit."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.errors import CampaignError
from stoop.parallel.plan import from_text, to_text

leaves = st.none() | st.booleans() | st.integers() | st.floats() | st.text()
values = st.recursive(leaves, lambda v: st.lists(v) | st.dictionaries(st.text(), v), max_leaves=20)


def bits(value: Any) -> Any:
    """Return a value in which floats are their bytes; there is one nan."""
    if isinstance(value, float):
        return "nan" if math.isnan(value) else struct.pack(">d", value)
    if isinstance(value, list):
        return [bits(v) for v in value]
    if isinstance(value, dict):
        return {k: bits(v) for k, v in value.items()}
    return (type(value), value)


@given(values)
def test_round_trip(value: Any) -> None:
    text = to_text(value, "value")
    assert text.isascii()
    assert bits(from_text(text)) == bits(value)
    assert to_text(from_text(text), "value") == text


def test_order_of_keys_does_not_matter() -> None:
    assert to_text({"b": 1, "a": [0.1, -0.0, math.inf]}, "") == '{"a":[0.1,-0.0,Infinity],"b":1}'
    assert to_text({"a": [0.1, -0.0, math.inf], "b": 1}, "") == '{"a":[0.1,-0.0,Infinity],"b":1}'


def test_a_numpy_float_is_a_float() -> None:
    assert to_text([np.float64(0.1)], "") == "[0.1]"


@pytest.mark.parametrize(
    ("value", "where"),
    [
        (
            {"a": [1, np.zeros(2)]},
            r"it\['a'\]\[1\]: a ndarray is not JSON; make it a list or number with .tolist\(\)",
        ),
        (np.int64(3), "it: a int64 is not JSON"),
        ([(1, 2)], r"it\[0\]: a tuple is not JSON; make it a list"),
        ({1: 2}, r"it: the key 1 is no text; JSON has no other keys, use str\(key\)"),
        (object(), "it: a object is not JSON"),
    ],
)
def test_anything_else_is_refused(value: Any, where: str) -> None:
    with pytest.raises(CampaignError, match=f"^{where}"):
        to_text(value, "it")


def test_a_number_beyond_what_python_writes_is_refused() -> None:
    with pytest.raises(CampaignError, match=r"^it: cannot be written as JSON"):
        to_text(10**5000, "it")


def test_a_circle_is_refused() -> None:
    circle: list[Any] = []
    circle.append(circle)
    with pytest.raises(CampaignError, match="flatter"):
        to_text(circle, "it")
