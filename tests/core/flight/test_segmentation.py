"""Segments: cut exactly where an input is missing, as a naive twin cuts them."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import FlightError
from stoop.flight import Flight, SourceRate, from_columns, segments

INPUTS = ("elevator", "throttle")
OUTPUTS = ("q", "theta", "alpha")


def flight(missing: FloatArray | None = None, size: int = 600, rate: float = 100.0) -> Flight:
    time = 10.0 + np.arange(size) / rate
    elevator, q = np.sin(time), np.cos(time)
    q[5] = np.nan
    if missing is not None:
        elevator[missing] = np.nan
    columns = {"elevator": elevator, "throttle": np.ones(size), "q": q, "theta": 0.1 * time, "vn": time}
    return from_columns("f", time, columns)


def naive(present: list[bool], least: int) -> list[list[int]]:
    pieces: list[list[int]] = [[]]
    for i, here in enumerate(present):
        if here:
            pieces[-1].append(i)
        elif pieces[-1]:
            pieces.append([])
    return [piece for piece in pieces if len(piece) >= least]


@given(st.lists(st.tuples(st.integers(0, 299), st.integers(1, 80)), max_size=5))
def test_as_a_naive_twin(holes: list[tuple[int, int]]) -> None:
    gone = np.zeros(300, dtype=bool)
    for start, length in holes:
        gone[start : start + length] = True
    flown = flight(np.flatnonzero(gone), size=300)
    expected = naive(list(~gone), 50)
    if not expected:
        with pytest.raises(FlightError, match="without a hole"):
            segments(flown, 10.0, 13.0, INPUTS, OUTPUTS)
        return
    found, notices = segments(flown, 10.0, 13.0, INPUTS, OUTPUTS)
    assert len(found) == len(expected)
    for segment, rows in zip(found, expected, strict=True):
        np.testing.assert_array_equal(segment.t, flown.time[rows])
        np.testing.assert_array_equal(segment.u[:, 0], flown.column("elevator")[rows])
        np.testing.assert_array_equal(segment.z[:, 0], flown.column("q")[rows])
        assert np.isfinite(segment.u).all()
    told = any(len(run) > 1 or 0 < run[0] < 299 for run in naive(list(gone), 1))
    assert any(found.code.startswith("inputs-missing") for found in notices) == told


def test_columns_come_in_the_order_asked_and_outputs_may_be_missing() -> None:
    found, notices = segments(flight(), 11.0, 12.0, INPUTS, OUTPUTS, extras=("vn",))
    assert notices == []
    (segment,) = found
    assert segment.t[[0, -1]].tolist() == [11.0, 12.0]
    assert segment.u.shape == (101, 2)
    assert segment.z.shape == (101, 3)
    assert np.isnan(segment.z[:, 2]).all()  # no alpha in this flight
    np.testing.assert_array_equal(segment.extras["vn"], segment.t)
    (segment,), _ = segments(flight(), 10.0, 12.0, (), OUTPUTS)
    assert np.flatnonzero(np.isnan(segment.z[:, 0])).tolist() == [5], "which splits nothing"
    assert segment.u.shape == (201, 0)
    (segment,), (found,) = segments(flight(), 9.8, 15.0, INPUTS, OUTPUTS)
    assert segment.t[[0, -1]].tolist() == [10.0, 15.0]
    assert (found.code, found.values["start"]) == ("window-trimmed", 10.0)
    holed = flight(np.concatenate([np.arange(k, k + 9) for k in range(60, 500, 70)]))
    _, (found,) = segments(holed, 10.0, 16.0, INPUTS, OUTPUTS)
    assert (found.code, found.values["count"]) == ("inputs-missing-often", 7)
    slow = {**flight().sources, "elevator": SourceRate("x", 9.0, 0.2, 0, 10.0, 16.0)}
    _, notices = segments(dataclasses.replace(flight(), sources=slow), 11.0, 12.0, INPUTS, OUTPUTS)
    assert notices == [notice("slow-input", "f", variable="elevator", rate=9.0)]


def test_impossible_windows() -> None:
    for start, stop, inputs, outputs, words in (
        (1.0, 5.0, INPUTS, OUTPUTS, r"f 1:5: outside the record, which runs from 10.00 to 15.99 s"),
        (16.0, 18.0, INPUTS, OUTPUTS, "outside the record"),
        (5.0, 11.0, INPUTS, OUTPUTS, r"5.00 s of it lie beyond the record, .* write 10:11 for what there is"),
        (12.0, 17.0, INPUTS, OUTPUTS, r"1.01 s of it lie beyond the record, .* write 12:15.99 for"),
        (12.0, 11.0, INPUTS, OUTPUTS, "ends before it begins"),
        (float("nan"), 11.0, INPUTS, OUTPUTS, "ends before it begins"),
        (12.0, 12.3, INPUTS, OUTPUTS, "without a hole"),
        (11.0, 12.0, ("rudder",), OUTPUTS, r"input 'rudder' is not in this flight; it has q, theta, vn, throttle"),
        (11.0, 12.0, ("elevatr",), OUTPUTS, "no variable 'elevatr'; did you mean elevator"),
        (11.0, 12.0, INPUTS, ("elevatr",), "no variable 'elevatr'; did you mean elevator"),
    ):  # fmt: skip
        with pytest.raises(FlightError, match=words) as caught:
            segments(flight(), start, stop, inputs, outputs)
        assert "\n" not in str(caught.value)
