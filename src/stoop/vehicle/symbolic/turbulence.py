"""Dryden gusts: velocities of the air that white noise drives through the filters of MIL-F-8785C.

One-sided spectra over the spatial frequency Omega, rad/m, with intensity sigma and scale length L:

    Phi_u = sigma^2 (2 L / pi) / (1 + (L Omega)^2)
    Phi_v, Phi_w = sigma^2 (L / pi) (1 + 3 (L Omega)^2) / (1 + (L Omega)^2)^2

Flown through at the speed V*, with a = V*/L and white noise of unit intensity, these are the outputs of

    H_u(s) = sigma sqrt(2 a) / (s + a),    H_v(s) = H_w(s) = sigma sqrt(a) (sqrt(3) s + a) / (s + a)^2

The second one has the states f' = -a f + sigma sqrt(a) n (fast) and g' = a (f - g) (slow), and the output
sqrt(3) f + (1 - sqrt(3)) g. The speed is the reference airspeed: the filters are linear, their coefficients constant.
They blow along the axes of the body, which an aircraft in flight keeps along its path. A vehicle that hovers turns on the
spot, and the air does not turn with it: there u, v, w are the air's own velocity to the north, to the east and downward.
Gusts over the span and the length (p_g, q_g, r_g) are left out: they are weak where the aircraft is small against L.

References
----------
MIL-F-8785C, Flying Qualities of Piloted Airplanes, 1980, section 3.7.1.2 (Dryden form).
MIL-HDBK-1797, 1997, Appendix A (the same form, with scale lengths L_v, L_w twice as large in the formulas).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy as sp

from stoop.vehicle.symbolic.frames import to_body
from stoop.vehicle.symbolic.symbols import Numbers, Vector, subtract
from stoop.vehicle.vehicle import GUST_STATES, noise_input

_ROOT3 = sp.sqrt(3).evalf(20)


def relative(n: Numbers, velocity: Vector, states: Mapping[str, Any]) -> Vector:
    """Return the velocity relative to the moving air, body axes: the body's, less the gusts."""
    if not n.vehicle.gusts:
        return velocity
    gust = {axis: _gust(axis, states) for axis in n.vehicle.gusts}
    zero = sp.Integer(0)
    blown: Vector = (gust.get("u", zero), gust.get("v", zero), gust.get("w", zero))
    if n.vehicle.has_rotors:
        blown = to_body((states["e0"], states["e1"], states["e2"], states["e3"]), blown)
    return subtract(velocity, blown)


def rates(n: Numbers, states: Mapping[str, Any], channels: Mapping[str, Any]) -> dict[str, Any]:
    """Return the time derivatives of the gust states, m/s2."""
    out: dict[str, Any] = {}
    for axis in n.vehicle.gusts:
        out |= _rates(n, axis, states, channels[noise_input(axis)])
    return out


def _gust(axis: str, states: Mapping[str, Any]) -> Any:
    """Return the velocity of the air along an axis, m/s."""
    own = [states[s] for s in GUST_STATES[axis]]
    return own[0] if axis == "u" else _ROOT3 * own[0] + (1 - _ROOT3) * own[1]


def _rates(n: Numbers, axis: str, states: Mapping[str, Any], noise: Any) -> dict[str, Any]:
    passing = n.get("turbulence.airspeed", n.get("reference.airspeed"))
    corner = passing / n[f"turbulence.{axis}.length"]
    drive = n[f"turbulence.{axis}.intensity"] * sp.sqrt((2 if axis == "u" else 1) * corner) * noise
    first, *second = GUST_STATES[axis]
    out = {first: drive - corner * states[first]}
    return out | {s: corner * (states[first] - states[s]) for s in second}
