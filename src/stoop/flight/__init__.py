"""Recorded channels -> Flight: SI, body axes, one uniform grid, maneuvers, air data."""

from stoop.flight.channels import SourceRate
from stoop.flight.flight import Flight
from stoop.flight.load import load
from stoop.flight.segments import Segment, segments
from stoop.flight.variables import OUTPUTS, VARIABLES, Variable

__all__ = ["OUTPUTS", "VARIABLES", "Flight", "Segment", "SourceRate", "Variable", "load", "segments"]
