"""Runs that differ in their stop only are one task; equal values are equal texts, and come back to the last bit."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.parallel import CampaignError, Plan, Run
from stoop.parallel.plan import from_text, tasks, to_text


def test_stops_of_one_prefix_are_one_task_the_earliest_first() -> None:
    runs = [Run(f"{i}/{stop}", "m:f", {"seed": i}, stop) for stop in (None, 2000, 500) for i in (1, 2)]
    first, second, _ = tasks([*runs, Run("other", "m:g", {"seed": 1}, 500)])
    assert (first.text, first.stops) == ('{"seed":1}', [500, 2000, None])
    assert [run.key for run in second.runs] == ["2/500", "2/2000", "2/None"]


def test_order_of_arguments_and_places_of_inputs_do_not_matter() -> None:
    a, b = Run("a", "m:f", {"x": 1, "y": 2}), Run("b", "m:f", {"y": 2, "x": 1})
    assert a.identity == b.identity
    assert a.identity != Run("a", "m:f", {"x": 1, "y": 2}, 5).identity
    assert a.identity != Run("a", "m:f", {"x": 1.0, "y": 2}).identity
    a, b = (Run("a", "m:f", {"content": 1}, places={"log": place}) for place in ("x", "y"))
    assert a.text == '{"content":1,"log":"x"}'
    assert a.identity == b.identity == Run("a", "m:f", {"content": 1}).identity


def test_keys_are_unique_and_printable() -> None:
    for name, keys, what in (
        ("p", "aba", "two runs have the key a"), ("p", ["", "b"], "cannot be"), ("p", ["a\n"], "cannot"), ("", "a", "name"),
    ):  # fmt: skip
        with pytest.raises(CampaignError, match=what):
            Plan(name, {}, tuple(Run(key, "m:f", {"i": i}) for i, key in enumerate(keys)))


leaves = st.none() | st.booleans() | st.integers() | st.floats() | st.text()
values = st.recursive(leaves, lambda v: st.lists(v) | st.dictionaries(st.text(), v), max_leaves=20)


def bits(value: Any) -> Any:
    """Return a value in which floats are their digits in hexadecimal; there is one nan."""
    if isinstance(value, list):
        return [bits(v) for v in value]
    if isinstance(value, dict):
        return {k: bits(v) for k, v in value.items()}
    return (type(value), value.hex() if isinstance(value, float) else value)


@given(values)
def test_round_trip(value: Any) -> None:
    text = to_text(value, "value")
    assert text.isascii()
    assert bits(from_text(text)) == bits(value)
    assert to_text(from_text(text), "value") == text


def test_anything_else_is_refused() -> None:
    for value in ({"b": 1, "a": [0.1, np.float64(-0.0), math.inf]}, {"a": [0.1, -0.0, math.inf], "b": 1}):
        assert to_text(value, "") == '{"a":[0.1,-0.0,Infinity],"b":1}'
    circle: list[Any] = []
    circle.append(circle)
    array = r"it\['a'\]\[1\]: a ndarray is not JSON; make it a list or number with .tolist\(\)"
    for value, where in (
        ({"a": [1, np.zeros(2)]}, array), (np.int64(3), "it: a int64 is not JSON"), (object(), "it: a object is not JSON"),
        ([(1, 2)], r"it\[0\]: a tuple is not JSON; make it a list"), (10**5000, "it: cannot be written as JSON"),
        ({1: 2}, r"it: the key 1 is no text; JSON has no other keys, use str\(key\)"), (circle, ".*flatter"),
    ):  # fmt: skip
        with pytest.raises(CampaignError, match=f"^{where}"):
            to_text(value, "it")
