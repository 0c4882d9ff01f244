"""Vehicle + inputs -> trajectories, trim, linear models and simulated flights."""

from stoop.simulate.arrays import simulate
from stoop.simulate.fly import numbers_set, simulate_flight
from stoop.simulate.initial import START_NAMES, initial_states, parameter_rows
from stoop.simulate.linearize import LinearModel, Mode, linearize
from stoop.simulate.maneuver import Maneuver, load_maneuver, parse_maneuver
from stoop.simulate.steady import Trim
from stoop.simulate.trim import trim

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
