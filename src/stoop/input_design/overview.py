"""What a flight log holds: its channels, what was found in them, and the windows worth fitting."""

from __future__ import annotations

from dataclasses import dataclass, replace

from stoop.base.notices import Notice, attempt
from stoop.errors import FlightError
from stoop.flight import Flight, FlightSummary, describe, without_faults
from stoop.input_design.windows import Found, find_windows


@dataclass(frozen=True, eq=False)
class Overview:
    """A flight with its candidate windows."""

    summary: FlightSummary
    found: Found
    why: str = ""  #: why no windows were found


def overview(flight: Flight) -> Overview:
    """Describe a flight and find the windows that are worth fitting."""
    summary, failed = describe(flight), list[Notice]()
    try:
        used = without_faults(summary.flight)
        found, why = attempt(failed, Found(()), find_windows, {used.name: used}), ""
    except FlightError as error:
        found, why = Found(()), str(error)
    return Overview(replace(summary, notices=(*summary.notices, *failed)), found, why)
