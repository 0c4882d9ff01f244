"""How a user names a maneuver: ``[FLIGHT@]START:STOP[#LOADING]``, seconds of the log's own clock."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from stoop.errors import FlightError
from stoop.flight import Flight


@dataclass(frozen=True)
class Window:
    """One stretch of one flight.

    Attributes
    ----------
    flight : str
        Name of the flight.
    start, stop : float, s
        On the log's own clock.
    loading : str or None
        Name of the vehicle file's loading (mass, centre of gravity, inertia) that was flown.
    """

    flight: str
    start: float
    stop: float
    loading: str | None = None

    def __str__(self) -> str:
        return f"{self.flight}@{self.start:g}:{self.stop:g}"


OneWindow: TypeAlias = str | tuple[float, float] | slice | Window
Windows: TypeAlias = (
    OneWindow | Sequence[OneWindow]
)  #: "140:145", (140, 145), slice(140, 145); one or several


def as_windows(given: Windows, flights: Mapping[str, Flight]) -> tuple[Window, ...]:
    """Return windows, however they were written.

    Raises
    ------
    FlightError
        Of none of these forms, see :func:`parse_window`.
    """
    if isinstance(given, str | slice | Window) or (
        isinstance(given, tuple) and len(given) == 2 and all(isinstance(edge, int | float) for edge in given)
    ):
        given = [cast("OneWindow", given)]
    return tuple(one if isinstance(one, Window) else parse_window(_text(one), flights) for one in given)


def _text(given: object) -> str:
    """Return a window as START:STOP."""
    edges = (given.start, given.stop) if isinstance(given, slice) else given
    if isinstance(edges, Sequence) and not isinstance(edges, str) and len(edges) == 2:
        return f"{edges[0]}:{edges[1]}"
    return str(edges)


def whole(flights: Mapping[str, Flight]) -> list[Window]:
    """Return one window for each flight, all of it."""
    return [Window(f.name, float(f.time[0]), float(f.time[-1])) for f in flights.values()]


def within(flight: Flight, windows: Sequence[Window]) -> NDArray[np.bool_]:
    """Return which samples (n,) of a flight lie in some of its windows."""
    out = np.zeros(flight.time.size, dtype=bool)
    for w in windows:
        out |= (flight.time >= w.start) & (flight.time <= w.stop)
    return out


def parse_window(text: str, flights: Mapping[str, Flight]) -> Window:
    """Read a window; the flight's name may be left out when there is one flight.

    Raises
    ------
    FlightError
        Not of this form, an unknown flight, or a window that ends before it begins.
    """
    text = text.strip()
    span, _, loading = text.partition("#")
    name, at, times = span.rpartition("@")
    if not at:
        if len(flights) != 1:
            raise FlightError(
                f"maneuver '{text}': several flights are given; write FLIGHT@START:STOP with one of {', '.join(flights)}"
            )
        name = next(iter(flights))
    if name not in flights:
        raise FlightError(
            f"maneuver '{text}': no flight is called '{name}'; flights are {', '.join(flights)}"
        )
    try:
        start, stop = (float(part) for part in times.split(":"))
    except ValueError:
        raise FlightError(f"maneuver '{text}': write START:STOP in seconds, for example 140:145") from None
    if not (math.isfinite(start) and math.isfinite(stop) and start < stop):
        raise FlightError(f"maneuver '{text}': the start must come before the stop")
    return Window(name, start, stop, loading or None)
