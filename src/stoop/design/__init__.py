"""What to fly next: inputs that make the error bars small, within limits, from the model as it is known now."""

from stoop.design.knowledge import Knowledge
from stoop.design.limits import Limits
from stoop.design.search import Design, design
from stoop.design.setup import Forecast, Setup
from stoop.design.shapes import SHAPES

__all__ = ["SHAPES", "Design", "Forecast", "Knowledge", "Limits", "Setup", "design"]
