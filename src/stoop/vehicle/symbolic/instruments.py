"""What the instruments read: eq. (2) with position errors, scale and bias."""

from __future__ import annotations

from typing import Any

from stoop.vehicle.symbolic.frames import Attitude, air
from stoop.vehicle.symbolic.symbols import Numbers, Vector, add, cross


def vane(n: Numbers, velocity: Vector, omega: Vector) -> Any:
    """Return the air-relative motion at the vanes."""
    return air(add(velocity, cross(omega, n.arm("sensors.vane_position"))))


def accelerometer(n: Numbers, specific_force: Vector, omega: Vector, omega_rate: Vector) -> Vector:
    """Return the specific force where the accelerometer sits, m/s2."""
    arm = n.arm("sensors.accelerometer_position")
    if arm == (0, 0, 0):
        return specific_force
    return add(specific_force, add(cross(omega_rate, arm), cross(omega, cross(omega, arm))))


def readings(n: Numbers, truth: dict[str, Any]) -> dict[str, Any]:
    """Apply scale and bias of each channel."""
    return {c: n.get(f"sensors.{c}.scale", 1) * t + n[f"sensors.{c}.bias"] for c, t in truth.items()}


def truth(V: Any, vanes: Any, omega: Vector, a: Attitude, acceleration: Vector) -> dict[str, Any]:
    """Name the twelve quantities of eq. (2)."""
    p, q, r = omega
    ax, ay, az = acceleration
    return {
        "V": V, "alpha": vanes.alpha, "beta": vanes.beta, "p": p, "q": q, "r": r,
        "phi": a.phi, "theta": a.theta, "psi": a.psi, "ax": ax, "ay": ay, "az": az,
    }  # fmt: skip


def ground_truth(velocity: Vector, omega: Vector, a: Attitude, acceleration: Vector) -> dict[str, Any]:
    """Name what a vehicle with rotors is observed by; the velocity is over ground less the steady wind."""
    vn, ve, vd = velocity
    p, q, r = omega
    ax, ay, az = acceleration
    return {
        "vn": vn, "ve": ve, "vd": vd, "p": p, "q": q, "r": r,
        "phi": a.phi, "theta": a.theta, "psi": a.psi, "ax": ax, "ay": ay, "az": az,
    }  # fmt: skip
