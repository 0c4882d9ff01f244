"""What no aircraft can be: zero mass, an inertia that no body has, angles in degrees."""

from __future__ import annotations

import math

import numpy as np

from stoop.errors import VehicleError
from stoop.vehicle.vehicle import Vehicle, leaves

_POSITIVE = (
    "mass.mass", "mass.inertia.xx", "mass.inertia.yy", "mass.inertia.zz", "reference.area", "reference.chord",
    "reference.span", "reference.airspeed", "environment.gravity", "environment.density", "propulsion.diameter",
)  # fmt: skip


def check(vehicle: Vehicle) -> None:
    """Raise :class:`VehicleError` for the first impossible number."""
    rows = vehicle.rows
    for name in _POSITIVE:
        if name in rows and not vehicle.value(name) > 0.0:
            raise VehicleError(
                f"{vehicle.where}: {name}: {vehicle.value(name):g} is not positive; write its true value in SI units"
            )
    _check_inertia(vehicle)
    _check_angles(vehicle)
    _check_bounds(vehicle)
    _check_loadings(vehicle)


def inertia_tensor(vehicle: Vehicle) -> np.ndarray:
    """Return the (3, 3) inertia tensor about the centre of gravity, kg m2, body axes."""

    def get(axis: str) -> float:
        name = f"mass.inertia.{axis}"
        return vehicle.value(name) if name in vehicle.rows else 0.0

    xx, yy, zz, xz, xy, yz = (get(a) for a in ("xx", "yy", "zz", "xz", "xy", "yz"))
    return np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])


def _check_inertia(vehicle: Vehicle) -> None:
    """Hold the principal moments to the triangle inequality, which every body of mass obeys."""
    small, middle, large = np.linalg.eigvalsh(inertia_tensor(vehicle))
    if small <= 0.0:
        raise VehicleError(
            f"{vehicle.where}: mass.inertia: a principal moment is {small:.3g} kg m2; products of inertia are too large, check xz, xy, yz"
        )
    if large > (small + middle) * (1.0 + 1e-9):
        raise VehicleError(
            f"{vehicle.where}: mass.inertia: the largest principal moment {large:.4g} exceeds the sum of the others "
            f"{small + middle:.4g} kg m2, which no body can have; measure xx, yy, zz again"
        )


def _check_angles(vehicle: Vehicle) -> None:
    angles = ("reference.alpha", "propulsion.pitch")
    for name in angles:
        if name in vehicle.rows and abs(vehicle.value(name)) > math.pi / 2.0:
            raise VehicleError(
                f"{vehicle.where}: {name}: {vehicle.value(name):g} looks like degrees; write radians ({math.radians(vehicle.value(name)):.4g})"
            )
    for control in vehicle.file.controls:
        name = f"controls.{control}.offset"
        if name in vehicle.rows and abs(vehicle.value(name)) > math.pi / 2.0:
            raise VehicleError(
                f"{vehicle.where}: {name}: {vehicle.value(name):g} looks like degrees; write radians ({math.radians(vehicle.value(name)):.4g})"
            )


def _check_bounds(vehicle: Vehicle) -> None:
    for p in vehicle.parameters:
        if p.free and not p.lower < p.upper:
            raise VehicleError(
                f"{vehicle.where}: {p.name}: free, but its bounds are [{p.lower:g}, {p.upper:g}]; add bounds = [low, high]"
            )


def _check_loadings(vehicle: Vehicle) -> None:
    known = {name for name, _ in leaves(vehicle.file)}
    for loading, numbers in vehicle.file.loadings.items():
        for name in numbers:
            if name not in known:
                raise VehicleError(
                    f'{vehicle.where}: loadings.{loading}.{name}: no number has this name; write e.g. "mass.mass" = 9.1'
                )
