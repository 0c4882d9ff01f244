"""Kinematics in symbols: vectors, flow angles, attitude, and gusts of the air.

Body axes forward-right-down, Earth axes north-east-down, quaternion (e0 scalar) from body to Earth.
Stevens, Lewis and Johnson, Aircraft Control and Simulation, 3rd ed., section 1.8.

Gusts are Dryden's: velocities of the air driven by white noise through the filters of MIL-F-8785C. One-sided spectra
over the spatial frequency Omega, rad/m, with intensity sigma and scale length L:

    Phi_u = sigma^2 (2 L / pi) / (1 + (L Omega)^2)
    Phi_v, Phi_w = sigma^2 (L / pi) (1 + 3 (L Omega)^2) / (1 + (L Omega)^2)^2

At the speed V*, with a = V*/L and white noise of unit intensity, these are the outputs of

    H_u(s) = sigma sqrt(2 a) / (s + a),    H_v(s) = H_w(s) = sigma sqrt(a) (sqrt(3) s + a) / (s + a)^2

The second one has the states f' = -a f + sigma sqrt(a) n (fast) and g' = a (f - g) (slow), and the output
sqrt(3) f + (1 - sqrt(3)) g. The speed is the reference airspeed: the filters are linear, their coefficients constant.
The axes of the gusts are those of the body, which an aircraft in flight keeps along its path; a rotorcraft turns on the
spot, and its gusts are the velocity of the air to the north, to the east and downward. Gusts over the span and the
length (p_g, q_g, r_g) are omitted: they are weak where the aircraft is small against L.

References
----------
MIL-F-8785C, Flying Qualities of Piloted Airplanes, 1980, section 3.7.1.2 (Dryden form).
MIL-HDBK-1797, 1997, Appendix A (the same form, with scale lengths L_v, L_w twice as large in the formulas).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from stoop.vehicle.channels import GUST_STATES, noise_input
from stoop.vehicle.vehicle import Vehicle

Vector = tuple[Any, Any, Any]
Quaternion = tuple[Any, Any, Any, Any]
NULL = sp.Integer(0)
ZERO: Vector = (NULL, NULL, NULL)
#: m/s; below it the direction of the air fades out, where a vehicle may stand still
SLOW = sp.Rational(1, 10)
_ROOT3 = sp.sqrt(3).evalf(20)


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Vector, b: Vector) -> Any:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def scale(factor: Any, a: Vector) -> Vector:
    """Return factor * a."""
    return factor * a[0], factor * a[1], factor * a[2]


class Numbers:
    """Symbols of the numbers of a vehicle file, one per kernel row, by name; absent numbers are structural zeros."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.symbols = tuple(sp.Symbol(p.name, real=True) for p in vehicle.parameters)

    def __contains__(self, name: str) -> bool:
        return name in self.vehicle.rows

    def __getitem__(self, name: str) -> Any:
        return self.symbols[self.vehicle.rows[name]]

    def get(self, name: str, default: Any = NULL) -> Any:
        """Return the symbol, or a default where the file has no such number."""
        row = self.vehicle.rows.get(name)
        return default if row is None else self.symbols[row]

    def point(self, name: str) -> Vector:
        """Return a point of the file's own coordinates."""
        return self.get(f"{name}.x"), self.get(f"{name}.y"), self.get(f"{name}.z")

    def arm(self, name: str) -> Vector:
        """Return a point relative to the center of gravity; an absent point lies on it."""
        if f"{name}.x" not in self:
            return ZERO
        return subtract(self.point(name), self.point("mass.center_of_gravity"))


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


def slow_air(velocity: Vector) -> Air:
    """Return the same for a vehicle that may stand still, rise, or fly backward.

    V, and its part in the plane of symmetry, are at least :data:`SLOW` where they divide or are differentiated; the
    dynamic pressure is exact, so forces vanish with the speed. At 10 m/s the angles are within 1e-4 rad of atan2. The
    half-angle form of alpha has a derivative at zero, unlike atan2(w, u).

    Coefficients linear in the angles hold for air from ahead. They fade out with the angle eps between the air and the
    nose as 1/(1 + tan(eps)^8): 0.03 % at 20 degrees, half at 45 degrees, all from the side, below, above and behind.
    """
    u, v, w = velocity
    across = v * v + w * w
    V2 = u * u + across
    plane, V = sp.sqrt(u * u + w * w + SLOW**2), sp.sqrt(V2 + SLOW**2)
    alpha = 2 * sp.atan2(w, plane + u)
    ahead = ((u + sp.Abs(u)) / 2) ** 8
    attached = ahead / (ahead + across**4 + SLOW**8)
    return Air(V, V2, alpha, sp.atan2(v, plane), u / plane, w / plane, plane / V, v / V, attached)


def air_data(n: Numbers, e: Quaternion, velocity: Vector, omega: Vector, V: Any) -> dict[str, Any]:
    """Return airspeed and flow angles as they are read, for a velocity of the center of gravity through the air.

    What was reconstructed of the velocity over ground is that through air of the wind that was taken; a pitot, whose airspeed
    is V, does not know of it.
    """
    if "sensors.wind_error.x" in n and n.vehicle.reduce == "full":  # else nothing tells where north is
        velocity = add(velocity, to_body(e, n.point("sensors.wind_error")))
        V = V if "sensors.V.scale" in n else air(velocity).V
    flow = air(add(velocity, cross(omega, n.arm("sensors.vane_position"))))
    return {"V": V, "alpha": flow.alpha, "beta": flow.beta}


def cosine_and_sine(angle: Any) -> tuple[Any, Any]:
    """Return the Taylor polynomials of an angle that is a number of the file, 1e-12 below 0.5 rad, 1e-9 below 1.6 rad."""
    even, odd = (
        sum(((-1) ** k * angle ** (2 * k + first) / sp.factorial(2 * k + first) for k in range(7)), NULL)
        for first in (0, 1)
    )
    return even, odd


def along_imu(n: Numbers, body: Vector) -> Vector:
    """Return a body-axes vector along the axes of the inertial unit: those of the body, turned in yaw, pitch, roll."""
    if "sensors.imu_alignment.x" not in n:
        return body
    (c1, s1), (c2, s2), (c3, s3) = map(cosine_and_sine, n.point("sensors.imu_alignment"))
    return (
        dot((c2 * c3, c2 * s3, -s2), body),
        dot((s1 * s2 * c3 - c1 * s3, s1 * s2 * s3 + c1 * c3, s1 * c2), body),
        dot((c1 * s2 * c3 + s1 * s3, c1 * s2 * s3 - s1 * c3, c1 * c2), body),
    )


@dataclass(frozen=True)
class Attitude:
    """Earth's down axis in body axes, and Euler angles."""

    down: Vector
    phi: Any
    theta: Any
    psi: Any


def attitude(e: Quaternion) -> Attitude:
    """Return the attitude of a quaternion; the angles need no normalization."""
    e0, e1, e2, e3 = e
    down = (2 * (e1 * e3 - e0 * e2), 2 * (e2 * e3 + e0 * e1), e0**2 - e1**2 - e2**2 + e3**2)
    theta = sp.atan2(-down[0], sp.sqrt(down[1] ** 2 + down[2] ** 2))
    psi = sp.atan2(2 * (e1 * e2 + e0 * e3), e0**2 + e1**2 - e2**2 - e3**2)
    return Attitude(down, sp.atan2(down[1], down[2]), theta, psi)


def quaternion_rate(e: Quaternion, omega: Vector) -> Quaternion:
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


def euler_rates(omega: Vector, phi: tuple[Any, Any], theta: tuple[Any, Any]) -> Vector:
    """Return the rates of phi, theta, psi for body rates, rad/s; `phi` and `theta` are sine and cosine."""
    (sin_phi, cos_phi), (sin_theta, cos_theta) = phi, theta
    psi_rate = (omega[1] * sin_phi + omega[2] * cos_phi) / cos_theta
    return omega[0] + sin_theta * psi_rate, omega[1] * cos_phi - omega[2] * sin_phi, psi_rate


def body_rates(rates: Sequence[Any], phi: tuple[Any, Any], theta: tuple[Any, Any]) -> Vector:
    """Return the body rates, rad/s, for rates of phi, theta, psi: the inverse of :func:`euler_rates`."""
    (sin_phi, cos_phi), (sin_theta, cos_theta) = phi, theta
    across = cos_theta * rates[2]
    q, r = cos_phi * rates[1] + sin_phi * across, cos_phi * across - sin_phi * rates[1]
    return rates[0] - sin_theta * rates[2], q, r


def body_acceleration(
    specific: Vector, gravity: Any, down: Vector, velocity: Vector, omega: Vector
) -> Vector:
    """Return the rate of the body-axes velocity, m/s2 (Newton, flat Earth), for a specific force."""
    (u, v, w), (p, q, r) = velocity, omega
    return (
        specific[0] + gravity * down[0] - q * w + r * v,
        specific[1] + gravity * down[1] - r * u + p * w,
        specific[2] + gravity * down[2] - p * v + q * u,
    )


def over_ground(e: Quaternion, velocity: Vector) -> Vector:
    """Return a body-axes velocity in Earth axes, north, east, down, for a quaternion of unit length."""
    e0, e1, e2, e3 = e
    s0, s1, s2, s3 = e0**2, e1**2, e2**2, e3**2
    return (
        dot((s0 + s1 - s2 - s3, 2 * (e1 * e2 - e0 * e3), 2 * (e1 * e3 + e0 * e2)), velocity),
        dot((2 * (e1 * e2 + e0 * e3), s0 - s1 + s2 - s3, 2 * (e2 * e3 - e0 * e1)), velocity),
        dot((2 * (e1 * e3 - e0 * e2), 2 * (e2 * e3 + e0 * e1), s0 - s1 - s2 + s3), velocity),
    )


def to_body(e: Quaternion, earth: Vector) -> Vector:
    """Return a vector in Earth axes in those of the body, for a quaternion of unit length."""
    return over_ground((e[0], -e[1], -e[2], -e[3]), earth)


def gust(n: Numbers, states: Mapping[str, Any]) -> Vector:
    """Return the velocity of the gusts along their axes, m/s."""
    out = dict.fromkeys("uvw", NULL)
    for axis in n.vehicle.gusts:
        first, *second = (states[s] for s in GUST_STATES[axis])
        out[axis] = _ROOT3 * first + (1 - _ROOT3) * second[0] if second else first
    return out["u"], out["v"], out["w"]


def gust_rates(n: Numbers, states: Mapping[str, Any], channels: Mapping[str, Any]) -> dict[str, Any]:
    """Return the time derivatives of the gust states, m/s2."""
    out: dict[str, Any] = {}
    speed = n.get("turbulence.airspeed", n.get("reference.airspeed"))
    for axis in n.vehicle.gusts:
        corner = speed / n[f"turbulence.{axis}.length"]
        root = sp.sqrt((2 if axis == "u" else 1) * corner)
        drive = n[f"turbulence.{axis}.intensity"] * root * channels[noise_input(axis)]
        first, *second = GUST_STATES[axis]
        out[first] = drive - corner * states[first]
        out |= {s: corner * (states[first] - states[s]) for s in second}
    return out
