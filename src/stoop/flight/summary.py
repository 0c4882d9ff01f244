"""What `stoop info` tells of a flight, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stoop.base.variables import VARIABLES
from stoop.flight.aloft import motors_ran
from stoop.flight.faults import Fault
from stoop.flight.flight import Flight
from stoop.flight.maneuvers import Maneuver, find_maneuvers

if TYPE_CHECKING:
    from stoop.flight.reconstruction import AirData


@dataclass(frozen=True)
class ChannelRow:
    """One channel of a flight.

    Attributes
    ----------
    variable, unit, meaning : from the registry
    source : topic or file it was recorded in
    rate : Hz, as recorded
    gaps : number of holes that nothing is interpolated across
    longest_gap : s
    minimum, median, maximum : SI, on the grid
    missing : share of the grid without a value, 0 to 1
    """

    variable: str
    unit: str
    meaning: str
    source: str
    rate: float
    gaps: int
    longest_gap: float
    minimum: float
    median: float
    maximum: float
    missing: float


@dataclass(frozen=True)
class FlightSummary:
    """All that is known of a flight before a vehicle is.

    Attributes
    ----------
    name, path : of the flight
    start, stop : s, on the log's own clock
    rate : Hz, of the grid
    rows : one per channel, in the order of the registry
    faults : suspected faults of sensors
    maneuvers : windows worth fitting
    air : result of the flight-path reconstruction, where there was one
    unmapped : stream -> columns that no mapping names; no columns: the stream was not read
    notes : plain words
    """

    name: str
    path: Path | None
    start: float
    stop: float
    rate: float
    rows: tuple[ChannelRow, ...]
    faults: tuple[Fault, ...]
    maneuvers: tuple[Maneuver, ...]
    air: AirData | None
    unmapped: Mapping[str, tuple[str, ...]]
    notes: tuple[str, ...]


def describe(flight: Flight) -> FlightSummary:
    """Gather what is known of a flight."""
    return FlightSummary(
        name=flight.name,
        path=flight.path,
        start=float(flight.time[0]),
        stop=float(flight.time[-1]),
        rate=flight.rate,
        rows=tuple(_row(flight, str(name)) for name in flight.data.data_vars),
        faults=flight.faults,
        maneuvers=tuple(find_maneuvers(flight)),
        air=flight.air,
        unmapped=flight.unmapped,
        notes=(*flight.notes, *_useless(flight)),
    )


def _useless(flight: Flight) -> list[str]:
    """Say why nothing can be identified from a flight, whatever the vehicle."""
    missing = [
        name
        for name in ("p", "q", "r")
        if name not in flight.data or not np.isfinite(flight.column(name)).any()
    ]
    out = [
        f"{', '.join(missing)} not recorded: without body rates nothing tells moments or damping; log the gyros, or name "
        "their columns in the mapping ([variables] p, q, r)"
    ]
    off = (
        "the motors never ran: nothing flew in this log; give a log of a flight, or look at the columns and units of the "
        "motor channels in the mapping"
    )
    return [*(out if missing else []), *([] if motors_ran(flight) else [off])]


def _row(flight: Flight, name: str) -> ChannelRow:
    known, source, x = VARIABLES[name], flight.sources[name], flight.column(name)
    there = x[np.isfinite(x)]
    low, middle, high = np.quantile(there, [0.0, 0.5, 1.0]) if there.size else (np.nan, np.nan, np.nan)
    return ChannelRow(
        variable=name,
        unit=known.unit,
        meaning=known.meaning,
        source=source.source,
        rate=source.rate,
        gaps=source.gaps,
        longest_gap=source.longest_gap,
        minimum=float(low),
        median=float(middle),
        maximum=float(high),
        missing=1.0 - there.size / x.size,
    )
