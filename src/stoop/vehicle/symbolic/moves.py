"""How a small error moves the state: a rotation turns the attitude, anything else is added.

A filter corrects by numbers that are free of each other. The quaternion has four with a fixed length, so its
correction is a rotation by three small angles about the body axes (e + e x delta / 2, then back to unit length), and
does not depend on the heading. Altitude is not corrected: next to nothing that is measured depends on it. What a
reduced model holds is not corrected either.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy as sp

from stoop.vehicle.symbolic.frames import quaternion_rate
from stoop.vehicle.vehicle import Vehicle

_AXES = ("phi", "theta", "psi")


def moved(vehicle: Vehicle, states: Mapping[str, Any], moves: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return every state of the vehicle after a move."""
    zero = sp.Integer(0)
    e = tuple(states.get(f"e{i}", zero) for i in range(4))
    turn = [moves.get(f"turn {axis}", zero) for axis in _AXES]
    turned = [a + b for a, b in zip(e, quaternion_rate(e, (turn[0], turn[1], turn[2])), strict=True)]
    length2 = sum((a * a for a in turned), zero)
    after = {f"e{i}": a * (sp.Rational(3, 2) - length2 / 2) for i, a in enumerate(turned)}
    after |= {name: states[name] + moves[name] for name in moves if name in states}
    return tuple(after.get(name, states[name]) for name in vehicle.states)
