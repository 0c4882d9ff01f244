"""The result of every kind of trim."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from stoop.base.arrays import FloatArray
from stoop.vehicle import Vehicle

TOLERANCE: Final = 1e-7  #: of accelerations left over, m/s2 and rad/s2


@dataclass(frozen=True)
class Trim:
    """A steady straight flight.

    Attributes
    ----------
    start : dict
        Initial state, SI and rad: V and angles of the air where wings carry, u, v and w where rotors do.
    deflections : dict
        Control deflections, rad.
    thrust : dict
        The thrust number or channel that holds the speed (N, or the channel's unit); of rotors, all channels.
    inputs : (n_u,) array
        Recorded channels that hold the flight, in the vehicle's order.
    changes : dict
        Numbers of the vehicle that the trim sets (a constant thrust, the wind).
    residual : float
        Largest acceleration left over, m/s2 or rad/s2.
    velocity : (3,), m/s
        Over ground, north-east-down; of vehicles that hover.
    wind : (3,), m/s
        Blowing north, east, down; of vehicles that hover.
    """

    start: dict[str, float]
    deflections: dict[str, float]
    thrust: dict[str, float]
    inputs: FloatArray
    changes: dict[str, float]
    residual: float
    velocity: tuple[float, ...] = (0.0, 0.0, 0.0)
    wind: tuple[float, ...] = (0.0, 0.0, 0.0)


def flies_on_rotors(vehicle: Vehicle, airspeed: float | None) -> bool:
    """Whether rotors carry the vehicle: without an airspeed, and never one without rotors."""
    return vehicle.has_rotors and airspeed is None
