"""Motors and surfaces as an autopilot's outputs move them, whatever simulator the vehicle flies in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

from stoop import Vehicle
from stoop.extend.errors import VehicleError
from stoop.extend.motion import Trim
from stoop.extend.units import SEA_LEVEL_DENSITY
from stoop.extend.vehicles import full_command

Spin = Literal["ccw", "cw"]
FULL_DEFLECTION: Final = math.radians(25.0)  #: of a surface whose recorded channel is its deflection

MIXED_SURFACE_SHARE: Final = 0.5  #: of the largest moments about two axes, beyond which a surface serves both
SLOWEST: Final = 0.75  #: of V*, the least airspeed that an autopilot commands
FASTEST: Final = 1.5  #: of V*, the largest


def full_deflection(channel: str, gain: float, neutral: float) -> float | None:
    """Return the deflection, rad, that a channel makes from its neutral value to full command; None without a known end.

    Its sign is that of the gain, rad per unit of the channel.
    """
    full = full_command(channel)
    return None if full is None else gain * (full - neutral)


@dataclass(frozen=True)
class MotorOutput:
    """A motor: a rotor, or a propeller that pushes forward.

    Attributes
    ----------
    position, axis : (3,)
        From the center of gravity, m, forward, right, down; direction of the thrust.
    torque_ratio : m, torque over thrust, without a sign
    spin : seen against the thrust
    lifts : whether it is a rotor of the vehicle file
    """

    position: tuple[float, float, float]
    axis: tuple[float, float, float]
    torque_ratio: float
    spin: Spin
    lifts: bool


@dataclass(frozen=True)
class SurfaceOutput:
    """A surface.

    Attributes
    ----------
    role : its name in :mod:`stoop.base.autopilots`
    moments : (3,), roll, pitch and yaw of a positive output, each over the largest of all surfaces
    trim : output in steady flight, from -1 to 1
    sign : of the output that turns the nose up, or else right
    """

    role: str
    moments: tuple[float, float, float]
    trim: float
    sign: float = 1.0


@dataclass(frozen=True)
class ThrustCurve:
    """Thrust of a rotor above that at zero output, linear u + square u^2, and its output u in hover."""

    linear: float
    square: float
    hover: float


def equivalent_airspeed(vehicle: Vehicle, point: Trim, airspeed: float | None = None) -> float:
    """Return an airspeed (V* if None), m/s, as the equivalent one in the air of a steady flight, which autopilots measure."""
    speed = vehicle.value("reference.airspeed") if airspeed is None else airspeed
    return speed * math.sqrt(point.density(vehicle) / SEA_LEVEL_DENSITY)


def surface_role(roll: float, pitch: float, yaw: float) -> tuple[str, float]:
    """Return what a surface is to an autopilot, and the sign of the deflection that turns the nose up, or else right.

    Parameters
    ----------
    roll, pitch, yaw : float
        Moments of the surface, each over the largest of all surfaces about that axis.
    """
    shared = {"elevon": min(abs(roll), abs(pitch)), "V-tail": min(abs(yaw), abs(pitch))}
    for name, share in shared.items():
        if share > MIXED_SURFACE_SHARE:
            # A left elevon with its edge down rolls right, a left V-tail yaws left; both pitch down.
            left = roll * pitch < 0.0 if name == "elevon" else yaw * pitch > 0.0
            return f"{'left' if left else 'right'} {name}", math.copysign(1.0, pitch)
    moments = {"aileron": roll, "elevator": pitch, "rudder": yaw}
    name = max(moments, key=lambda n: abs(moments[n]))
    return name, math.copysign(1.0, moments[name])


def check_rotor_channels(vehicle: Vehicle) -> None:
    """Refuse a vehicle whose rotors share a channel: an autopilot has an output for each, and their commands would add up.

    Raises
    ------
    VehicleError
        Two rotors have one channel.
    """
    channels = [rotor.channel for rotor in vehicle.file.rotor.values()]
    if len(set(channels)) < len(channels):
        raise VehicleError(
            f"{vehicle.where}: rotors share a channel; give each its own, as an autopilot has an output for each"
        )
