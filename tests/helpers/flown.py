"""Maneuvers and vehicles with few free numbers, for tests."""

from collections.abc import Collection
from typing import Any

from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle

#: control, shape, start, s, step, s, and amplitude of an input
Input = tuple[str, str, float, float, float]


def maneuver(duration: float, *inputs: Input, rate: float = 50.0, **more: Any) -> Maneuver:
    """Return a maneuver of inputs at a rate, Hz."""
    keys = ("control", "shape", "start", "step", "amplitude")
    tables = [dict(zip(keys, one, strict=True)) for one in inputs]
    return Maneuver.model_validate({"duration": duration, "rate": rate, "input": tables, **more})


def with_few_free(vehicle: Vehicle, free: Collection[str]) -> Vehicle:
    """Return the vehicle with the other free numbers held."""
    held = {p.name: {"free": False} for p in vehicle.parameters if p.free and p.name not in free}
    return vehicle.with_numbers(held)
