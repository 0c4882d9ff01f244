"""Recorded channels -> Flight: SI, body axes, one uniform grid, maneuvers, air data."""

from stoop.flight.channels import SourceRate
from stoop.flight.faults import Fault
from stoop.flight.flight import Flight
from stoop.flight.load import load
from stoop.flight.make import from_columns
from stoop.flight.segments import Segment, segments
from stoop.flight.store import save
from stoop.flight.variables import OUTPUTS, VARIABLES, Variable

__all__ = [
    "OUTPUTS",
    "VARIABLES",
    "Fault",
    "Flight",
    "Segment",
    "SourceRate",
    "Variable",
    "from_columns",
    "load",
    "save",
    "segments",
]
