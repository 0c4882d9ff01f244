"""The tensor of inertia of a vehicle, and the density of the air in a steady flight."""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import standard_density
from stoop.simulation.trim import Trim
from stoop.vehicle import Vehicle

_PRODUCTS: Final = (("xx", "xy", "xz"), ("xy", "yy", "yz"), ("xz", "yz", "zz"))


def inertia_tensor(vehicle: Vehicle) -> FloatArray:
    """Return the tensor (3, 3) about the center of gravity, kg m2, axes forward, right, down."""
    products = np.array([[vehicle.value(f"mass.inertia.{n}", 0.0) for n in row] for row in _PRODUCTS])
    return np.asarray(products * (2.0 * np.eye(3) - 1.0))


def air_density(vehicle: Vehicle, point: Trim) -> float:
    """Return the density of a steady flight, kg/m3: that of its channel, of the standard atmosphere, or the vehicle's."""
    choice = vehicle.file.environment.density
    if choice == "log":
        return float(point.inputs[vehicle.inputs.index("density")])
    if choice == "standard":
        return float(standard_density(np.array(point.start.get("h", 0.0))))
    return vehicle.value("environment.density")
