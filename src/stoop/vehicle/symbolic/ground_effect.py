"""Lift and thrust near the ground, by the height above it that a sensor records.

References
----------
Cheeseman and Bennett (1955), ARC R&M 3021, eq. (5): T / T_free = 1 / (1 - (R/4z)^2) at constant power in hover.
McCormick, Aerodynamics, Aeronautics and Flight Mechanics, 2nd ed., eq. (7.7): influence (16 z/b)^2 / (1 + (16 z/b)^2)
of the ground on what trailing vortices induce.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy as sp

from stoop.vehicle.symbolic.symbols import Numbers


def thrust_gain(n: Numbers, channels: Mapping[str, Any]) -> Any:
    """Return thrust over that in free air, bounded as the height goes to zero."""
    table = n.vehicle.file.ground_effect
    if table is None or table.rotor is None:
        return sp.Integer(1)
    radius = n["ground_effect.radius" if table.radius is not None else "rotors.radius"]
    quarter2 = (radius / 4) ** 2
    return 1 + n["ground_effect.rotor"] * quarter2 / (channels[table.channel] ** 2 + quarter2)


def lift_gain(n: Numbers, channels: Mapping[str, Any]) -> Any:
    """Return CL over that in free air."""
    table = n.vehicle.file.ground_effect
    if table is None or table.lift is None:
        return sp.Integer(1)
    return 1 + n["ground_effect.lift"] / (1 + (16 * channels[table.channel] / n["reference.span"]) ** 2)
