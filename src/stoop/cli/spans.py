"""Windows of one flight on the command line: START:STOP in seconds of the log's own clock."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from itertools import pairwise

from stoop.errors import FlightError


def add_window(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --window START:STOP, which may be given several times or several at a time."""
    words = f"{what}; s of the log's clock"
    parser.add_argument("--window", metavar="START:STOP", nargs="+", action="extend", default=[], help=words)


def spans(texts: Sequence[str]) -> tuple[tuple[float, float], ...]:
    """Read windows.

    Raises
    ------
    FlightError
        Not of the form START:STOP, the wrong way round, or overlapping.
    """
    found = sorted(_span(text) for text in texts)
    for one, following in pairwise(found):
        if following[0] < one[1]:
            raise FlightError(
                f"--window {following[0]:g}:{following[1]:g}: overlaps {one[0]:g}:{one[1]:g}; give windows that lie apart"
            )
    return tuple(found)


def _span(text: str) -> tuple[float, float]:
    try:
        start, stop = (float(part) for part in text.split(":"))
    except ValueError:
        raise FlightError(f"--window {text}: write START:STOP in seconds, for example 140:145") from None
    if not (math.isfinite(start) and math.isfinite(stop) and start < stop):
        raise FlightError(f"--window {text}: the start must come before the stop")
    return start, stop
