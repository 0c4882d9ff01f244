"""Vehicle files: mass, aerodynamics, propulsion, controls, instruments, and the equations that follow."""

from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop.vehicle.vehicle import Parameter, Vehicle

__all__ = ["Parameter", "Vehicle", "load_vehicle", "parse_vehicle"]
