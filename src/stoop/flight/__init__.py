"""Recorded channels -> Flight: SI, body axes, one uniform grid, maneuvers, air data."""

from stoop.base.variables import OUTPUTS, VARIABLES, Variable
from stoop.flight.air_data import without
from stoop.flight.faults import Fault
from stoop.flight.flight import Flight, Segment, from_columns, segments
from stoop.flight.gridding import SourceRate
from stoop.flight.load import flight_bytes, load_flight, save_flight
from stoop.flight.maneuvers import ChannelRow, FlightSummary, FlownManeuver, describe, find_maneuvers

__all__ = [
    "OUTPUTS", "VARIABLES", "ChannelRow", "Fault", "Flight", "FlightSummary", "FlownManeuver", "Segment", "SourceRate",
    "Variable", "describe", "find_maneuvers", "flight_bytes", "from_columns", "load_flight", "save_flight", "segments",
    "without",
]  # fmt: skip
