"""Windows of flights, as a user names them.

A window is ``[FLIGHT@]START:STOP[#LOADING]``, seconds of the log's own clock, or the words ``start`` and ``end``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from numbers import Real
from typing import Any, TypeAlias

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.errors import FlightError
from stoop.flight import Flight


@dataclass(frozen=True)
class Window:
    """One stretch of one flight, s on the log's own clock, with the name of the vehicle file's loading that was flown."""

    flight: str
    start: float
    stop: float
    loading: str | None = None

    def __str__(self) -> str:
        return f"{self.flight}@{self.start:g}:{self.stop:g}"

    @staticmethod
    def parse(text: str, flights: Mapping[str, Flight]) -> Window:
        """Read a window; the flight's name may be left out when there is one flight; ``start`` and ``end`` are the record's.

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
        ends = {"start": 0, "end": -1}
        try:
            time = flights[name].time
            start, stop = (float(time[ends[part]] if part in ends else part) for part in times.split(":"))
        except ValueError:
            said = f"maneuver '{text}': write START:STOP in seconds, for example 140:145"
            raise FlightError(said) from None
        if not (math.isfinite(start) and math.isfinite(stop) and start < stop):
            raise FlightError(f"maneuver '{text}': the start must come before the stop")
        return Window(name, start, stop, loading or None)

    @staticmethod
    def several(given: Windows, flights: Mapping[str, Flight]) -> tuple[Window, ...]:
        """Return windows, however they were written.

        Raises
        ------
        FlightError
            Of none of these forms, see :meth:`parse`.
        """
        several: Any = given.tolist() if isinstance(given, np.ndarray) else given
        pair = isinstance(several, tuple | list) and len(several) == 2
        if (pair and all(isinstance(x, Real) for x in several)) or isinstance(several, str | slice | Window):
            several = [several]
        if not isinstance(several, Iterable):
            kind = type(given).__name__
            raise FlightError(
                f"windows: a {kind} is none; give '140:145', (140, 145), or a list or array of pairs, s"
            )
        out = []
        for one in several:
            one = one.tolist() if isinstance(one, np.ndarray) else one
            edges = (one.start, one.stop) if isinstance(one, slice) else one
            text = ":".join(map(str, edges)) if isinstance(edges, tuple | list) else str(edges)
            out.append(one if isinstance(one, Window) else Window.parse(text, flights))
        return tuple(out)

    @staticmethod
    def whole(flights: Mapping[str, Flight]) -> list[Window]:
        """Return one window for each flight, all of it."""
        return [Window(f.name, float(f.time[0]), float(f.time[-1])) for f in flights.values()]

    @staticmethod
    def within(flight: Flight, windows: Sequence[Window]) -> BoolArray:
        """Return which samples (n,) of a flight lie in some of its windows."""
        out = np.zeros(flight.time.size, dtype=np.bool_)
        for w in windows:
            out |= (flight.time >= w.start) & (flight.time <= w.stop)
        return out


OneWindow: TypeAlias = str | tuple[float, float] | slice | Window
#: "140:145", (140, 145), slice(140, 145); one or several; an array (2,) or (n, 2)
Windows: TypeAlias = OneWindow | Sequence[OneWindow] | FloatArray


def spans(given: Windows, flight: Flight) -> tuple[tuple[float, float], ...]:
    """Return windows of one flight as (start, stop), s, in order; raises `FlightError`: of no such form, or two overlap."""
    found = sorted((w.start, w.stop) for w in Window.several(given, {flight.name: flight}))
    for one, following in pairwise(found):
        if following[0] < one[1]:
            raise FlightError(f"windows: {one} and {following} overlap; give windows that lie apart")
    return tuple(found)
