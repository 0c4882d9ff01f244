"""What we believe the vehicle is: mass, aerodynamics, propulsion, controls, instruments."""

from stoop.vehicle.load import load_vehicle, parse_vehicle
from stoop.vehicle.quantity import Parameter
from stoop.vehicle.vehicle import Vehicle

__all__ = ["Parameter", "Vehicle", "load_vehicle", "parse_vehicle"]
