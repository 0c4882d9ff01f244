from __future__ import annotations

import pytest

from stoop.errors import FlightError
from stoop.flight import Flight
from stoop.problem.windows import Window, parse_window


def test_one_flight_needs_no_name(flight: Flight) -> None:
    assert parse_window("1.5:9", {"sim": flight}) == Window("sim", 1.5, 9.0)


def test_name_and_loading(flight: Flight) -> None:
    assert parse_window("b@1:2#heavy", {"a": flight, "b": flight}) == Window("b", 1.0, 2.0, "heavy")


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("1-2", "START:STOP"),
        ("2:1", "before"),
        ("nan:1", "before"),
        ("1:2:3", "START:STOP"),
        ("c@1:2", "flights are"),
        ("", "START:STOP"),
    ],
)
def test_bad_windows_say_what_to_write(text: str, advice: str, flight: Flight) -> None:
    with pytest.raises(FlightError, match=advice) as caught:
        parse_window(text, {"sim": flight})
    assert "\n" not in str(caught.value)


def test_two_flights_need_a_name(flight: Flight) -> None:
    with pytest.raises(FlightError, match="FLIGHT@START:STOP"):
        parse_window("1:2", {"a": flight, "b": flight})


def test_words_name_the_ends_of_the_record(flight: Flight) -> None:
    known, last = {"sim": flight}, float(flight.time[-1])
    assert parse_window("20:end", known) == Window("sim", 20.0, last)
    assert parse_window("sim@start:end#light", known) == Window("sim", 0.0, last, "light")
    with pytest.raises(FlightError, match="write START:STOP"):
        parse_window("20:ende", known)
