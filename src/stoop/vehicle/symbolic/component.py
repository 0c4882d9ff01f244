"""What a component sees, and what it gives: a force and a moment about the centre of gravity, body axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import sympy as sp

from stoop.vehicle.symbolic.frames import Air
from stoop.vehicle.symbolic.symbols import Numbers, Vector, add

ZERO: Vector = (sp.Integer(0), sp.Integer(0), sp.Integer(0))


@dataclass(frozen=True)
class Surroundings:
    """What a component sees."""

    numbers: Numbers
    air: Air
    density: Any
    omega: Vector
    deflections: Mapping[str, Any]  #: rad per control
    channels: Mapping[str, Any]  #: recorded channels
    velocity: Vector = ZERO  #: of the body through the air, m/s
    spins: Mapping[str, Any] = field(default_factory=dict)  #: x per rotor: its command, or rad/s
    spin_rates: Mapping[str, Any] = field(
        default_factory=dict
    )  #: of rotors, per s; absent where inertia does not ask for them


@dataclass(frozen=True)
class Load:
    """A force, N, and its moment about the centre of gravity, N m."""

    force: Vector
    moment: Vector

    def __add__(self, other: Load) -> Load:
        return Load(add(self.force, other.force), add(self.moment, other.moment))
