"""What no vehicle with rotors can be: no lift, an axis of no length, rotors that all turn one way."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stoop.errors import VehicleError
from stoop.vehicle.rotor_numbers import full_command, share_of_weight, thrust_at
from stoop.vehicle.vehicle import Vehicle, leaves

_POSITIVE = (
    "rotors.gain",
    "rotors.nominal_voltage",
    "rotors.lag",
    "rotors.inertia",
    "rotors.radius",
    "turbulence.airspeed",
)
_FARTHEST = 20.0  #: m
_HALF = 0.5


def check_rotors(vehicle: Vehicle, place: str = "") -> None:
    """Raise :class:`VehicleError` for the first thing that cannot be."""
    where = f"{vehicle.where}: {place}"
    _check_tables(vehicle, where)
    _check_signs(vehicle, where)
    if not vehicle.rotors:
        return
    axes = {name: _check_axis(vehicle, name, where) for name in vehicle.rotors}
    _check_places(vehicle, where)
    _check_spins(vehicle, axes, where)
    _check_thrust(vehicle, axes, where)


def _check_tables(vehicle: Vehicle, where: str) -> None:
    """Refuse tables that do not go together."""
    file = vehicle.file
    for channel in ("vn", "ve", "vd"):
        if not vehicle.rotors and getattr(file.sensors, channel) is not None:
            raise VehicleError(
                f"{where}sensors.{channel}: only a vehicle with rotors is observed by it; remove it"
            )
    if file.turbulence is not None and file.reference is None and file.turbulence.airspeed is None:
        raise VehicleError(
            f"{where}turbulence.airspeed: missing, and there is no [reference] to take it from; "
            "write the speed at which the gusts pass (flight or wind), m/s"
        )
    if not vehicle.rotors:
        return
    if vehicle.reduce != "full":
        raise VehicleError(
            f'{where}model.reduce: a vehicle with rotors takes all equations; write reduce = "full"'
        )
    if file.reference is None and any(vehicle.terms.values()):
        raise VehicleError(
            f"{where}reference: missing, and aerodynamics needs it; add area, chord, span and airspeed"
        )
    clash = set(file.controls) & set(file.rotor)
    if clash:
        raise VehicleError(f"{where}rotor.{min(clash)}: the name is taken by a control; choose another")


def _check_signs(vehicle: Vehicle, where: str) -> None:
    for name in _POSITIVE:
        if name in vehicle.rows and not vehicle.value(name) > 0.0:
            advice = "remove it for no lag" if name.endswith("lag") else "write its true value in SI units"
            raise VehicleError(f"{where}{name}: {vehicle.value(name):g} is not positive; {advice}")
    measured = vehicle.file.rotors is not None and vehicle.file.rotors.drive == "speed"
    sized = ("factor", "torque_ratio") if measured else ("factor", "rotors.delay", "torque_ratio")
    for name in (n for n in vehicle.rows if n.endswith(sized)):  # a measured speed may be told late
        if vehicle.value(name) < 0.0:
            raise VehicleError(
                f"{where}{name}: {vehicle.value(name):g} is negative; write its size, spin says the sign"
            )


def _point(vehicle: Vehicle, name: str) -> NDArray[np.float64]:
    return np.array([vehicle.value(f"{name}.{axis}") for axis in "xyz"])


def _check_axis(vehicle: Vehicle, rotor: str, where: str) -> NDArray[np.float64]:
    """Return the unit vector along the thrust of a rotor."""
    name = f"rotor.{rotor}.axis"
    if f"{name}.x" not in vehicle.rows:
        return np.array([0.0, 0.0, -1.0])
    axis = _point(vehicle, name)
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise VehicleError(
            f"{where}{name}: has no length; write the direction of the thrust, up is [0, 0, -1]"
        )
    return axis / length


def _check_places(vehicle: Vehicle, where: str) -> None:
    places = {name: _point(vehicle, f"rotor.{name}.position") for name in vehicle.rotors}
    for name, place in places.items():
        if np.max(np.abs(place)) > _FARTHEST:
            raise VehicleError(
                f"{where}rotor.{name}.position: {np.max(np.abs(place)):g} m looks like millimeters; write meters"
            )
    if len(places) > 2 and np.max(np.ptp(list(places.values()), axis=0)) < 1e-3:
        raise VehicleError(
            f"{where}rotor: all {len(places)} rotors are on one spot, so none of them can roll or pitch; "
            "write position = [forward, right, down] of each, m"
        )


def _check_spins(vehicle: Vehicle, axes: dict[str, NDArray[np.float64]], where: str) -> None:
    directions = np.array(list(axes.values()))
    spins = {rotor.spin for rotor in vehicle.file.rotor.values()}
    if len(axes) > 3 and len(spins) == 1 and np.max(np.ptp(directions, axis=0)) < 1e-3:
        raise VehicleError(
            f'{where}rotor: all {len(axes)} rotors turn {min(spins)}, so nothing holds the yaw; write spin = "ccw" or "cw" '
            "of each, as seen from above"
        )


def _check_thrust(vehicle: Vehicle, axes: dict[str, NDArray[np.float64]], where: str) -> None:
    """Hold the thrust to rise with the command, and to carry a vehicle that has no wing."""
    numbers = dict(leaves(vehicle.file))
    full = [_full(vehicle, name) for name in vehicle.rotors]
    if None in full or not full:
        return
    top = max(x for x in full if x is not None)
    half, most = thrust_at(numbers, _HALF * top), thrust_at(numbers, top)
    if not most > max(half, thrust_at(numbers, 0.0)):
        raise VehicleError(
            f"{where}rotors.T2: thrust does not rise with the command ({half:.3g} N at half, {most:.3g} N at full); "
            f"write a first guess, e.g. T2 = {4.0 * share_of_weight(numbers) / top**2:.2g}"
        )
    upward = sum(max(-float(axis[2]), 0.0) * _factor(vehicle, name) for name, axis in axes.items())
    weight = vehicle.value("mass.mass") * vehicle.value("environment.gravity")
    if vehicle.file.reference is None and upward * most < weight:
        raise VehicleError(
            f"{where}rotors.T2: at full command the rotors lift {upward * most:.3g} N, and the vehicle weighs {weight:.3g} N; "
            "correct T0, T1, T2, gain, idle or mass (thrust in N per rotor, x as drive says)"
        )


def _factor(vehicle: Vehicle, rotor: str) -> float:
    name = f"rotor.{rotor}.factor"
    return vehicle.value(name) if name in vehicle.rows else 1.0


def _full(vehicle: Vehicle, rotor: str) -> float | None:
    """Return x at full command; None where the channel does not say what full is."""
    channel = vehicle.file.rotor[rotor].channel
    full = full_command(channel)
    if full is None:
        return None
    x = vehicle.value("rotors.gain") * (full - vehicle.value("rotors.idle"))
    if not (x > 0.0 and math.isfinite(x)):
        raise VehicleError(
            f"{vehicle.where}: rotors.idle: {vehicle.value('rotors.idle'):g} is not below full command of {channel} "
            f"({full:g}); write the value at which the motor stands still"
        )
    return x
