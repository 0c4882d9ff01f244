"""Vehicle + inputs -> trajectories, trim and linear models; maneuvers are flown by `stoop.simulation.fly`."""

from stoop.simulation.linearize import LinearModel, Mode, linearize
from stoop.simulation.steady_flight import trim
from stoop.simulation.trim import Trim
from stoop.vehicle.channels import START_NAMES

__all__ = [
    "START_NAMES", "LinearModel", "Mode", "Trim", "linearize", "trim",
]  # fmt: skip
