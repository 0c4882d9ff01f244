"""Force and moment of a vehicle without gravity, by its equations of motion, and what these need of the vehicle and the air."""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import standard_density
from stoop.base.rotations import to_body
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


def motion_loads(vehicle: Vehicle, states: FloatArray, rates: FloatArray) -> FloatArray:
    """Return force, N, and moment, N m, (6, B), that give states (n_x, B) their derivatives (n_x, B)."""
    at = {name: i for i, name in enumerate(vehicle.states)}
    velocity, omega, dot, turning = (
        array[[at[a] for a in axes]] for array in (states, rates) for axes in ("uvw", "pqr")
    )
    q = states[[at[f"e{i}"] for i in range(4)]].T
    down = to_body(q, np.array([0.0, 0.0, vehicle.value("environment.gravity")])).T
    force = vehicle.value("mass.mass") * (dot + np.cross(omega, velocity, axis=0) - down)
    return rigid_loads(vehicle, force, omega, turning)


def rigid_loads(vehicle: Vehicle, force: FloatArray, omega: FloatArray, turning: FloatArray) -> FloatArray:
    """Return force, N, and moment, N m, (6, B) from a force, rates, rad/s, and angular accelerations, rad/s2, (3, B) each."""
    inertia = inertia_tensor(vehicle)
    return np.vstack([force, inertia @ turning + np.cross(omega, inertia @ omega, axis=0)])
