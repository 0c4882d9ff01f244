"""Symbols for the numbers of a vehicle file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import sympy as sp

from stoop.vehicle.vehicle import Vehicle

Vector = tuple[Any, Any, Any]
ZERO = sp.Integer(0)


@dataclass(frozen=True)
class Numbers:
    """Looks up the symbol of a number by its name; absent numbers are structural zeros."""

    vehicle: Vehicle
    symbols: tuple[Any, ...]

    @classmethod
    def of(cls, vehicle: Vehicle) -> Numbers:
        """Make one symbol per kernel row."""
        return cls(vehicle, tuple(sp.Symbol(p.name, real=True) for p in vehicle.parameters))

    def __contains__(self, name: str) -> bool:
        return name in self.vehicle.rows

    def __getitem__(self, name: str) -> Any:
        return self.symbols[self.vehicle.rows[name]]

    def get(self, name: str, default: Any = ZERO) -> Any:
        """Return the symbol, or a default where the file has no such number."""
        row = self.vehicle.rows.get(name)
        return default if row is None else self.symbols[row]

    def point(self, name: str) -> Vector:
        """Return a point of the file's own coordinates."""
        return self.get(f"{name}.x"), self.get(f"{name}.y"), self.get(f"{name}.z")

    def arm(self, name: str) -> Vector:
        """Return a point relative to the centre of gravity; an absent point lies on it."""
        if f"{name}.x" not in self:
            return ZERO, ZERO, ZERO
        return subtract(self.point(name), self.point("mass.center_of_gravity"))


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def scale(factor: Any, a: Vector) -> Vector:
    """Return factor * a."""
    return factor * a[0], factor * a[1], factor * a[2]
