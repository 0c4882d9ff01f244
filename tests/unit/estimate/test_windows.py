from __future__ import annotations

import pytest

from stoop.errors import FlightError
from stoop.flight import Flight
from stoop.problem.windows import Window, parse_window


def test_windows_are_read_or_say_what_to_write(flight: Flight) -> None:
    one, two, last = {"sim": flight}, {"a": flight, "b": flight}, float(flight.time[-1])
    assert parse_window("1.5:9", one) == Window("sim", 1.5, 9.0)
    assert parse_window("b@1:2#heavy", two) == Window("b", 1.0, 2.0, "heavy")
    assert parse_window("20:end", one) == Window("sim", 20.0, last)
    assert parse_window("sim@start:end#light", one) == Window("sim", 0.0, last, "light")
    for text, known, advice in (
        ("1-2", one, "START:STOP"), ("1:2:3", one, "START:STOP"), ("", one, "START:STOP"), ("2:1", one, "before"),
        ("nan:1", one, "before"), ("c@1:2", one, "flights are"), ("1:2", two, "FLIGHT@START:STOP"),
        ("20:ende", one, "write START:STOP"),
    ):  # fmt: skip
        with pytest.raises(FlightError, match=advice) as caught:
            parse_window(text, known)
        assert "\n" not in str(caught.value), text
