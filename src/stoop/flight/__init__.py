"""Recorded channels -> Flight: SI, body axes, one uniform grid, maneuvers, air data."""

from stoop.base.variables import OUTPUTS, VARIABLES, Variable
from stoop.flight.air_data_reconstruction import without
from stoop.flight.channels import SourceRate
from stoop.flight.faults import Fault
from stoop.flight.flight import Flight, from_columns
from stoop.flight.load import load, without_faults
from stoop.flight.maneuvers import Maneuver, find_maneuvers
from stoop.flight.segmentation import Segment, segments
from stoop.flight.store import save
from stoop.flight.summary import ChannelRow, FlightSummary, describe

__all__ = [
    "OUTPUTS",
    "VARIABLES",
    "ChannelRow",
    "Fault",
    "Flight",
    "FlightSummary",
    "Maneuver",
    "Segment",
    "SourceRate",
    "Variable",
    "describe",
    "find_maneuvers",
    "from_columns",
    "load",
    "save",
    "segments",
    "without",
    "without_faults",
]
