"""Numbers and windows on the command line, refused in one line where they are none."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from itertools import pairwise

from stoop.errors import FlightError


def count(text: str) -> int:
    """Read a whole number, zero or above."""
    if not text.isascii() or not text.isdigit():
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number, zero or above")
    return int(text)


def at_least_one(text: str) -> int:
    """Read a whole number, one or above."""
    if not text.isascii() or not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number, one or above")
    return int(text)


def positive(text: str) -> float:
    """Read a finite number above zero."""
    value = _number(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is not a positive number")
    return value


def finite(text: str) -> float:
    """Read a number that is neither infinite nor nan."""
    value = _number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number")
    return value


def within(low: float, high: float, unit: str, factor: float = 1.0) -> Callable[[str], float]:
    """Return what reads a number between two limits, in a unit, and returns it times a factor."""

    def read(text: str) -> float:
        value = finite(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not between {low:g} and {high:g} {unit}")
        return value * factor

    return read


def windows(texts: Sequence[str]) -> tuple[tuple[float, float], ...]:
    """Read windows START:STOP of one flight, s on the log's own clock.

    Raises
    ------
    FlightError
        Not of the form START:STOP, the wrong way round, or overlapping.
    """
    found = sorted(_window(text) for text in texts)
    for one, following in pairwise(found):
        if following[0] < one[1]:
            raise FlightError(
                f"--window {following[0]:g}:{following[1]:g}: overlaps {one[0]:g}:{one[1]:g}; give windows that lie apart"
            )
    return tuple(found)


def _window(text: str) -> tuple[float, float]:
    try:
        start, stop = (float(part) for part in text.split(":"))
    except ValueError:
        raise FlightError(f"--window {text}: write START:STOP in seconds, for example 140:145") from None
    if not (math.isfinite(start) and math.isfinite(stop) and start < stop):
        raise FlightError(f"--window {text}: the start must come before the stop")
    return start, stop


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
