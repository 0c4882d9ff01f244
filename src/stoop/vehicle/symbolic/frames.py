"""Kinematics: where the air comes from and how attitude turns.

Body axes forward-right-down, Earth axes north-east-down, quaternion (e0 scalar) from body to Earth.
Stevens, Lewis and Johnson, Aircraft Control and Simulation, 3rd ed., section 1.8.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import sympy as sp

from stoop.vehicle.symbolic.symbols import Vector


@dataclass(frozen=True)
class Air:
    """Air-relative motion at one point of the body."""

    V: Any
    V2: Any
    alpha: Any
    beta: Any
    cos_alpha: Any
    sin_alpha: Any
    cos_beta: Any
    sin_beta: Any
    attached: Any = 1  #: share of the aerodynamic model that holds for this direction of the air


def air(velocity: Vector) -> Air:
    """Return airspeed, angle of attack and sideslip of a body-axes velocity, free of trigonometry."""
    u, v, w = velocity
    plane2 = u * u + w * w
    V2 = plane2 + v * v
    plane, V = sp.sqrt(plane2), sp.sqrt(V2)
    return Air(V, V2, sp.atan2(w, u), sp.atan2(v, plane), u / plane, w / plane, plane / V, v / V)


SLOW = sp.Rational(
    1, 10
)  #: m/s: below it the direction of the air fades out, where a vehicle may stand still


def slow_air(velocity: Vector) -> Air:
    """Return the same for a vehicle that may stand still, rise, or fly backward.

    V, and its part in the plane of symmetry, are at least :data:`SLOW` where they divide or are differentiated; the
    dynamic pressure is exact, so forces vanish with the speed. At 10 m/s the angles are within 1e-4 rad of atan2. The
    half-angle form of alpha has a derivative at zero, which atan2(w, u) has not.

    Coefficients linear in the angles hold for air from ahead. They fade out with the angle eps between the air and the
    nose as 1/(1 + tan(eps)^8): 0.03 % at 20 degrees, half at 45 degrees, all from the side, below, above and behind.
    """
    u, v, w = velocity
    cross = v * v + w * w
    V2 = u * u + cross
    plane, V = sp.sqrt(u * u + w * w + SLOW**2), sp.sqrt(V2 + SLOW**2)
    alpha = 2 * sp.atan2(w, plane + u)
    ahead = ((u + sp.Abs(u)) / 2) ** 8
    attached = ahead / (ahead + cross**4 + SLOW**8)
    return Air(V, V2, alpha, sp.atan2(v, plane), u / plane, w / plane, plane / V, v / V, attached)


@dataclass(frozen=True)
class Attitude:
    """Rows of the rotation from Earth to body that are needed, and Euler angles."""

    down: Vector  #: Earth's down axis in body axes
    north: tuple[Any, Any]  #: R11, R21: where the nose points, north and east

    @property
    def phi(self) -> Any:
        """Bank angle."""
        return sp.atan2(self.down[1], self.down[2])

    @property
    def theta(self) -> Any:
        """Pitch angle."""
        return sp.atan2(-self.down[0], sp.sqrt(self.down[1] ** 2 + self.down[2] ** 2))

    @property
    def psi(self) -> Any:
        """Heading."""
        return sp.atan2(self.north[1], self.north[0])


def attitude(e: tuple[Any, Any, Any, Any]) -> Attitude:
    """Return what the quaternion says; no normalization is needed for the angles."""
    e0, e1, e2, e3 = e
    down = (2 * (e1 * e3 - e0 * e2), 2 * (e2 * e3 + e0 * e1), e0**2 - e1**2 - e2**2 + e3**2)
    return Attitude(down, (e0**2 + e1**2 - e2**2 - e3**2, 2 * (e1 * e2 + e0 * e3)))


def quaternion_rate(e: tuple[Any, Any, Any, Any], omega: Vector) -> tuple[Any, Any, Any, Any]:
    """Return the quaternion's time derivative for body rates omega, rad/s."""
    e0, e1, e2, e3 = e
    p, q, r = omega
    half = sp.Rational(1, 2)
    return (
        -half * (e1 * p + e2 * q + e3 * r),
        half * (e0 * p + e2 * r - e3 * q),
        half * (e0 * q + e3 * p - e1 * r),
        half * (e0 * r + e1 * q - e2 * p),
    )


def over_ground(e: tuple[Any, Any, Any, Any], velocity: Vector) -> Vector:
    """Return a body-axes velocity in Earth axes, north, east, down, for a quaternion of unit length."""
    e0, e1, e2, e3 = e
    u, v, w = velocity
    squares = e0**2, e1**2, e2**2, e3**2
    return (
        (squares[0] + squares[1] - squares[2] - squares[3]) * u
        + 2 * (e1 * e2 - e0 * e3) * v
        + 2 * (e1 * e3 + e0 * e2) * w,
        2 * (e1 * e2 + e0 * e3) * u
        + (squares[0] - squares[1] + squares[2] - squares[3]) * v
        + 2 * (e2 * e3 - e0 * e1) * w,
        2 * (e1 * e3 - e0 * e2) * u
        + 2 * (e2 * e3 + e0 * e1) * v
        + (squares[0] - squares[1] - squares[2] + squares[3]) * w,
    )


def to_body(e: tuple[Any, Any, Any, Any], earth: Vector) -> Vector:
    """Return a vector in Earth axes in those of the body, for a quaternion of unit length."""
    return over_ground((e[0], -e[1], -e[2], -e[3]), earth)
