"""Vehicle + inputs -> trajectories, trim, linear models and simulated flights."""

from stoop.simulation.fly import numbers_set, simulate, simulate_flight
from stoop.simulation.initial import START_NAMES, initial_states, parameter_rows
from stoop.simulation.linearize import LinearModel, Mode, linearize
from stoop.simulation.maneuver import Maneuver, load_maneuver, parse_maneuver
from stoop.simulation.trim import Trim, trim

__all__ = [
    "START_NAMES",
    "LinearModel",
    "Maneuver",
    "Mode",
    "Trim",
    "initial_states",
    "linearize",
    "load_maneuver",
    "numbers_set",
    "parameter_rows",
    "parse_maneuver",
    "simulate",
    "simulate_flight",
    "trim",
]
