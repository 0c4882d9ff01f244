"""Plausibility of a vehicle: positive masses, a possible inertia, radians, rotors that can carry and hold it."""

from __future__ import annotations

import math

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import VehicleError
from stoop.vehicle.defaults import POSITIVE, full_command, share_of_weight, thrust_at
from stoop.vehicle.schema import WIND
from stoop.vehicle.vehicle import Vehicle

#: of the sum of the smaller principal moments, by which the largest may exceed it: published values are rounded and come from
#: swing tests of 1 to 3 %; :func:`stoop.checks.vehicle.inertia_notices` tells of it
TRIANGLE_TOLERANCE = 0.02


def check(vehicle: Vehicle) -> None:
    """Raise :class:`VehicleError` for the first impossible number, also of a loading."""
    _check_numbers(vehicle, f"{vehicle.where}: ")
    angles = tuple(f"controls.{c}.{n}" for c in vehicle.file.controls for n in ("offset", "dead_zone"))
    angles += tuple(f"sensors.imu_alignment.{axis}" for axis in "xyz")
    for name in ("reference.alpha", "propulsion.pitch", *angles):
        value = vehicle.value(name, 0.0)
        if abs(value) > math.pi / 2.0:
            advice = f"looks like degrees; write radians ({math.radians(value):.4g})"
            raise VehicleError(f"{vehicle.where}: {name}: {value:g} {advice}")
    for p in vehicle.parameters:
        if p.free and not 0.0 < p.upper - p.lower < math.inf:
            raise VehicleError(
                f"{vehicle.where}: {p.name}: free, but its bounds are [{p.lower:g}, {p.upper:g}]; "
                "add bounds = [low, high]"
            )
    # all controls and rotors of a channel have one delay
    pairs = [(c, channel) for c in vehicle.controls for channel in vehicle.channels_of(c)]
    driven = [(f"controls.{c}.delay", c, channel) for c, channel in pairs]
    driven += [("rotors.delay", name, rotor.channel) for name, rotor in vehicle.file.rotor.items()]
    first: dict[str, tuple[str, str]] = {}
    for delay, name, channel in driven:
        other_delay, other = first.setdefault(channel, (delay, name))
        if vehicle.rows.get(other_delay) != vehicle.rows.get(delay):
            raise VehicleError(
                f"{vehicle.where}: {delay}: channel {channel} also moves {other}, whose delay "
                f'is another; tie them, e.g. delay = "={other_delay}"'
            )
    known = set(vehicle.quantities)
    for loading, numbers in vehicle.file.loadings.items():
        for name in numbers:
            if name not in known:
                raise VehicleError(
                    f"{vehicle.where}: loadings.{loading}.{name}: no number has this name; "
                    'write e.g. "mass.mass" = 9.1'
                )
        own = {vehicle.parameters[vehicle.rows[name]].name: {"value": v} for name, v in numbers.items()}
        _check_numbers(vehicle.with_numbers(own), f"{vehicle.where}: loadings.{loading}: ")


def _check_numbers(vehicle: Vehicle, where: str) -> None:
    """Check what a loading can change."""
    servos = (f"controls.{c}.rate_limit" for c in vehicle.file.controls)
    for name in (*POSITIVE, *servos):
        if not vehicle.value(name, 1.0) > 0.0:
            kind = name.rpartition(".")[2].replace("_", " ")
            removable = kind == "rate limit"
            advice = f"remove it for no {kind}" if removable else "write its true value in SI units"
            raise VehicleError(f"{where}{name}: {vehicle.value(name):g} is not positive; {advice}")
    small, middle, large = principal_moments(vehicle)
    if not small > 0.0:
        raise VehicleError(
            f"{where}mass.inertia: a principal moment is {small:.3g} kg m2; "
            "products of inertia are too large, check xz, xy, yz"
        )
    if not is_body(vehicle):
        raise VehicleError(
            f"{where}mass.inertia: the largest principal moment {large:.4g} exceeds the sum of the others "
            f"{small + middle:.4g} kg m2, which no body can have; measure xx, yy, zz again"
        )
    _check_tables(vehicle, where)
    for name in vehicle.rows:  # a delay may be negative: what moves the vehicle may be recorded late
        sized = name.endswith(("factor", "torque_ratio", "dead_zone", ".lag"))
        if sized and vehicle.value(name) < 0.0:
            whys = {"dead_zone": "a width has no sign", "lag": "nothing moves before its command"}
            why = whys.get(name.rpartition(".")[2], "spin gives the sign")
            raise VehicleError(f"{where}{name}: {vehicle.value(name):g} is negative; write its size, {why}")
    if vehicle.rotors:
        _check_rotors(vehicle, where)


def principal_moments(vehicle: Vehicle) -> tuple[float, float, float]:
    """Return the principal moments of inertia, ascending, kg m2; of a body the largest is at most the sum of the others."""
    axes = ("xx", "yy", "zz", "xz", "xy", "yz")
    xx, yy, zz, xz, xy, yz = (vehicle.value(f"mass.inertia.{a}", 0.0) for a in axes)
    small, middle, large = np.linalg.eigvalsh(np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]]))
    return float(small), float(middle), float(large)


def is_body(vehicle: Vehicle) -> bool:
    """Return whether some distribution of mass has the moments of inertia, but for what rounding and swing tests leave."""
    small, middle, large = principal_moments(vehicle)
    return small > 0.0 and large <= (small + middle) * (1.0 + TRIANGLE_TOLERANCE)


def _check_tables(vehicle: Vehicle, where: str) -> None:
    """Check that the tables of the file go together."""
    file = vehicle.file
    if file.turbulence is not None and file.reference is None and file.turbulence.airspeed is None:
        raise VehicleError(
            f"{where}turbulence.airspeed: missing, and there is no [reference] to take it from; "
            "write the speed at which the gusts pass (flight or wind), m/s"
        )
    for channel in (c for c in WIND if c not in vehicle.frame.outputs):
        if getattr(file.sensors, channel) is not None:
            raise VehicleError(
                f"{where}sensors.{channel}: only a vehicle with rotors is observed by it; remove it"
            )
    placed = vehicle.positions
    if placed and vehicle.reduce != "full":
        raise VehicleError(
            f'{where}model.reduce: position follows from all equations; write reduce = "full", or remove sensors.pn, pe and pd'
        )
    biases = {c: f"sensors.{c}.bias" for c in WIND if placed}
    blowing = [c for c, p in biases.items() if p in vehicle.rows and vehicle.parameters[p].free]
    if blowing:
        raise VehicleError(
            f"{where}sensors.{blowing[0]}.bias: a free wind, but the air is still where motion capture measures sensors.pn; "
            f"write bias = {{ value = 0.0, free = false }}"
        )
    if placed and file.turbulence is not None:
        raise VehicleError(
            f"{where}turbulence: the air is still where motion capture measures sensors.pn; remove it"
        )
    if vehicle.reduce not in vehicle.frame.reductions:
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


def _check_rotors(vehicle: Vehicle, where: str) -> None:
    """Check positions, axes and spins of the rotors, and their thrust."""

    def point(name: str, default: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> FloatArray:
        return np.array([vehicle.value(f"{name}.{axis}", d) for axis, d in zip("xyz", default, strict=True)])

    axes = np.array([point(f"rotor.{name}.axis", (0.0, 0.0, -1.0)) for name in vehicle.rotors])
    lengths = np.linalg.norm(axes, axis=1)
    positions = np.array([point(f"rotor.{name}.position") for name in vehicle.rotors])
    for name, length, position in zip(vehicle.rotors, lengths, positions, strict=True):
        if length < 1e-6:
            raise VehicleError(
                f"{where}rotor.{name}.axis: has no length; write the direction of the thrust, up is [0, 0, -1]"
            )
        if np.max(np.abs(position)) > 20.0:
            raise VehicleError(
                f"{where}rotor.{name}.position: {np.max(np.abs(position)):g} m looks like millimeters; write meters"
            )
    axes = axes / lengths[:, None]
    if len(positions) > 2 and np.max(np.ptp(positions, axis=0)) < 1e-3:
        raise VehicleError(
            f"{where}rotor: all {len(positions)} rotors are on one spot, so none of them can roll or pitch; "
            "write position = [forward, right, down] of each, m"
        )
    spins = {rotor.spin for rotor in vehicle.file.rotor.values()}
    if len(axes) > 3 and len(spins) == 1 and np.max(np.ptp(axes, axis=0)) < 1e-3:
        raise VehicleError(
            f'{where}rotor: all {len(axes)} rotors turn {min(spins)}, so nothing holds the yaw; write spin = "ccw" or "cw" '
            "of each, as seen from above"
        )
    _check_thrust(vehicle, axes, where)


def _check_thrust(vehicle: Vehicle, axes: FloatArray, where: str) -> None:
    """Check that thrust rises with the command, and carries a vehicle without wings; `axes` are (n, 3)."""
    full = []  # x at full command
    for channel in (rotor.channel for rotor in vehicle.file.rotor.values()):
        command = full_command(channel)
        if command is None:
            return
        full.append(vehicle.value("rotors.gain") * (command - vehicle.value("rotors.idle")))
        if not (full[-1] > 0.0 and math.isfinite(full[-1])):
            raise VehicleError(
                f"{vehicle.where}: rotors.idle: {vehicle.value('rotors.idle'):g} is not below full command of {channel} "
                f"({command:g}); write the value at which the motor stands still"
            )
    numbers, top = vehicle.quantities, max(full)
    half, most = thrust_at(numbers, 0.5 * top), thrust_at(numbers, top)
    if not most > max(half, thrust_at(numbers, 0.0)):
        raise VehicleError(
            f"{where}rotors.T2: thrust does not rise with the command ({half:.3g} N at half, {most:.3g} N at full); "
            f"write a first guess, e.g. T2 = {4.0 * share_of_weight(numbers) / top**2:.2g}"
        )
    factors = [vehicle.value(f"rotor.{name}.factor", 1.0) for name in vehicle.rotors]
    upward = sum(max(-float(axis[2]), 0.0) * factor for axis, factor in zip(axes, factors, strict=True))
    weight = vehicle.value("mass.mass") * vehicle.value("environment.gravity")
    if vehicle.file.reference is None and upward * most < weight:
        raise VehicleError(
            f"{where}rotors.T2: at full command the rotors lift {upward * most:.3g} N, and the vehicle weighs {weight:.3g} N; "
            "correct T0, T1, T2, gain, idle or mass (thrust in N per rotor, x as drive defines it)"
        )
