"""Vehicle + inputs -> trajectories, trim and linear models; maneuvers are flown by `stoop.simulation.fly`."""

from stoop.simulation.initial import START_NAMES, initial_states, parameter_rows
from stoop.simulation.linearize import LinearModel, Mode, linearize
from stoop.simulation.steady_flight import trim
from stoop.simulation.trim import Trim

__all__ = [
    "START_NAMES", "LinearModel", "Mode", "Trim", "initial_states", "linearize", "parameter_rows", "trim",
]  # fmt: skip
