"""Newton and Euler for a rigid body of constant mass with full inertia tensor, flat Earth."""

from __future__ import annotations

from typing import Any

import sympy as sp

from stoop.vehicle.symbolic.symbols import Numbers, Vector


def acceleration(
    specific_force: Vector, gravity: Any, down: Vector, velocity: Vector, omega: Vector
) -> Vector:
    """Return the rate of the body-axes velocity, m/s2."""
    (u, v, w), (p, q, r) = velocity, omega
    return (
        specific_force[0] + gravity * down[0] - q * w + r * v,
        specific_force[1] + gravity * down[1] - r * u + p * w,
        specific_force[2] + gravity * down[2] - p * v + q * u,
    )


def _inertia(n: Numbers) -> Any:
    xx, yy, zz = (n[f"mass.inertia.{a}"] for a in ("xx", "yy", "zz"))
    xz, xy, yz = (n.get(f"mass.inertia.{a}") for a in ("xz", "xy", "yz"))
    return sp.Matrix([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])


def angular_acceleration(n: Numbers, moment: Vector, omega: Vector) -> Vector:
    """Return I^-1 (M - omega x I omega), rad/s2, as a quadratic form in the rates.

    The coefficients of the quadratic form depend on the inertia alone, so the compiler takes them out of
    the time loop.
    """
    inertia = _inertia(n)
    inverse = inertia.adjugate() / inertia.det()
    rates = sp.Matrix(omega)
    gyroscopic = sp.Matrix(omega).cross(inertia * rates)
    turned = [sp.Poly(sp.expand(row), *omega) for row in inertia.adjugate() * gyroscopic]
    quadratic = [_monomials(row, omega, inertia.det()) for row in turned]
    driven = inverse * sp.Matrix(moment)
    return driven[0] - quadratic[0], driven[1] - quadratic[1], driven[2] - quadratic[2]


def _monomials(polynomial: Any, omega: Vector, denominator: Any) -> Any:
    total = sp.Integer(0)
    for powers, coefficient in polynomial.terms():
        product = sp.Mul(*(w**k for w, k in zip(omega, powers, strict=True)))
        total += (coefficient / denominator) * product
    return total
