"""Experiment design: inputs that make the error bars small within limits, and windows of flights worth fitting."""

from stoop.input_design.information import Forecast, Knowledge, Limits, Setup
from stoop.input_design.inputs import SHAPES
from stoop.input_design.optimization import Design, design

__all__ = ["SHAPES", "Design", "Forecast", "Knowledge", "Limits", "Setup", "design"]
