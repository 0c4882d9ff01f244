"""What no aircraft can be: zero mass, an inertia that no body has, angles in degrees."""

from __future__ import annotations

import math

import numpy as np

from stoop.errors import VehicleError
from stoop.vehicle.rotor_checks import check_rotors
from stoop.vehicle.vehicle import Vehicle, leaves

_POSITIVE = (
    "mass.mass", "mass.inertia.xx", "mass.inertia.yy", "mass.inertia.zz", "reference.area", "reference.chord",
    "reference.span", "reference.airspeed", "environment.gravity", "environment.density",
    "propulsion.diameter", "propulsion.speed_gain", "ground_effect.radius",
    *(f"turbulence.{axis}.{number}" for axis in "uvw" for number in ("intensity", "length")),
)  # fmt: skip
_AXES = ("xx", "yy", "zz", "xz", "xy", "yz")


def check(vehicle: Vehicle) -> None:
    """Raise :class:`VehicleError` for the first impossible number, also of a loading."""
    _check_numbers(vehicle, "")
    check_rotors(vehicle)
    _check_angles(vehicle)
    _check_bounds(vehicle)
    _check_delays(vehicle)
    known = {name for name, _ in leaves(vehicle.file)}
    for loading, numbers in vehicle.file.loadings.items():
        for name in numbers:
            if name not in known:
                raise VehicleError(
                    f"{vehicle.where}: loadings.{loading}.{name}: no number has this name; "
                    'write e.g. "mass.mass" = 9.1'
                )
        own = {vehicle.parameters[vehicle.rows[name]].name: value for name, value in numbers.items()}
        loaded = vehicle.with_numbers({name: {"value": value} for name, value in own.items()})
        _check_numbers(loaded, f"loadings.{loading}: ")
        check_rotors(loaded, f"loadings.{loading}: ")


def _check_numbers(vehicle: Vehicle, place: str) -> None:
    lags = tuple(f"controls.{c}.lag" for c in vehicle.file.controls)
    for name in (*_POSITIVE, *lags):
        if name in vehicle.rows and not vehicle.value(name) > 0.0:
            raise VehicleError(
                f"{vehicle.where}: {place}{name}: {vehicle.value(name):g} is not positive; "
                + ("remove it for no lag" if name in lags else "write its true value in SI units")
            )
    _check_inertia(vehicle, place)


def inertia_tensor(vehicle: Vehicle) -> np.ndarray:
    """Return the (3, 3) inertia tensor about the centre of gravity, kg m2, body axes."""

    def get(axis: str) -> float:
        name = f"mass.inertia.{axis}"
        return vehicle.value(name) if name in vehicle.rows else 0.0

    xx, yy, zz, xz, xy, yz = (get(a) for a in _AXES)
    return np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])


def _check_inertia(vehicle: Vehicle, place: str) -> None:
    """Hold the principal moments to the triangle inequality, which every body of mass obeys."""
    where = f"{vehicle.where}: {place}mass.inertia"
    small, middle, large = np.linalg.eigvalsh(inertia_tensor(vehicle))
    if not small > 0.0:
        raise VehicleError(
            f"{where}: a principal moment is {small:.3g} kg m2; "
            "products of inertia are too large, check xz, xy, yz"
        )
    if large > (small + middle) * (1.0 + 1e-9):
        raise VehicleError(
            f"{where}: the largest principal moment {large:.4g} exceeds the sum of the others "
            f"{small + middle:.4g} kg m2, which no body can have; measure xx, yy, zz again"
        )


def _check_angles(vehicle: Vehicle) -> None:
    offsets = tuple(f"controls.{c}.offset" for c in vehicle.file.controls)
    for name in ("reference.alpha", "propulsion.pitch", *offsets):
        if name in vehicle.rows and abs(vehicle.value(name)) > math.pi / 2.0:
            value = vehicle.value(name)
            raise VehicleError(
                f"{vehicle.where}: {name}: {value:g} looks like degrees; "
                f"write radians ({math.radians(value):.4g})"
            )


def _check_bounds(vehicle: Vehicle) -> None:
    for p in vehicle.parameters:
        if p.free and not 0.0 < p.upper - p.lower < math.inf:
            raise VehicleError(
                f"{vehicle.where}: {p.name}: free, but its bounds are [{p.lower:g}, {p.upper:g}]; "
                "add bounds = [low, high]"
            )


def _check_delays(vehicle: Vehicle) -> None:
    """Refuse a channel that would have to be late for one control and not for another."""
    rows: dict[str, tuple[str, str]] = {}
    driven = [
        (f"controls.{c}.delay", c, channel) for c in vehicle.controls for channel in vehicle.channels_of(c)
    ]
    driven += [("rotors.delay", name, rotor.channel) for name, rotor in vehicle.file.rotor.items()]
    for delay, moved, channel in driven:
        first, other = rows.setdefault(channel, (delay, moved))
        if vehicle.rows.get(first) != vehicle.rows.get(delay):
            raise VehicleError(
                f"{vehicle.where}: {delay}: channel {channel} also moves {other}, whose delay "
                f'is another; tie them, e.g. delay = "={first}"'
            )
