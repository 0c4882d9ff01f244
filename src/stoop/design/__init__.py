"""Experiment design: inputs that make the error bars small within limits, and windows of flights worth fitting."""

from stoop.design.information import Forecast, Knowledge, Setup
from stoop.design.inputs import SHAPES
from stoop.design.limits import Limits
from stoop.design.optimization import Design, design

__all__ = ["SHAPES", "Design", "Forecast", "Knowledge", "Limits", "Setup", "design"]
