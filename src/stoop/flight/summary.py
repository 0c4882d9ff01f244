"""Summary of a flight, as `stoop info` shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stoop.base.notices import Notice, notice
from stoop.base.variables import RATES, VARIABLES
from stoop.flight.airborne import motors_ran
from stoop.flight.flight import Flight
from stoop.flight.maneuvers import Maneuver, find_maneuvers


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
    """A flight as it is known before a vehicle is.

    Attributes
    ----------
    flight : what is described
    rows : one per channel, in the order of the registry
    maneuvers : windows worth fitting
    notices : those of the flight, and what makes it useless whatever the vehicle
    """

    flight: Flight
    rows: tuple[ChannelRow, ...]
    maneuvers: tuple[Maneuver, ...]
    notices: tuple[Notice, ...]


def describe(flight: Flight) -> FlightSummary:
    """Summarize a flight."""
    rows = tuple(_row(flight, str(name)) for name in flight.data.data_vars)
    useless = []
    missing = tuple(n for n in RATES if n not in flight.data or not np.isfinite(flight.column(n)).any())
    if missing:
        useless.append(notice("no-body-rates", variables=missing))
    if not motors_ran(flight):
        useless.append(notice("motors-never-ran"))
    return FlightSummary(flight, rows, tuple(find_maneuvers(flight)), (*flight.notices, *useless))


def _row(flight: Flight, name: str) -> ChannelRow:
    known, source, x = VARIABLES[name], flight.sources[name], flight.column(name)
    finite = x[np.isfinite(x)]
    low, middle, high = np.quantile(finite, [0.0, 0.5, 1.0]) if finite.size else (np.nan, np.nan, np.nan)
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
        missing=1.0 - finite.size / x.size,
    )
