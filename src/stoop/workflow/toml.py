"""The identified vehicle file: the user's own text with the estimates in place."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import tomlkit
from tomlkit.items import InlineTable, Table

from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.defaults import COEFFICIENTS

if TYPE_CHECKING:
    from stoop.workflow.identification import Job

DIGITS = 10


def identified_text(job: Job) -> str:
    """Return the vehicle file with every estimated number replaced; comments and order stay."""
    vehicle = job.fit.problem.layout.vehicle
    return replaced(vehicle, job.fit.estimates)


def replaced(vehicle: Vehicle, values: dict[str, float]) -> str:
    """Return the text of a vehicle file with some numbers replaced, added where the file left them out."""
    document = tomlkit.parse(vehicle.text)
    for name, value in values.items():
        _set(document, _place(vehicle, name), float(f"{value:.{DIGITS}g}"))
    if parse_vehicle(vehicle.text, vehicle.where).reduce != vehicle.reduce:
        _set(document, ["model", "reduce"], vehicle.reduce)
    return tomlkit.dumps(document)


def _place(vehicle: Vehicle, name: str) -> list[str]:
    """Return the keys that lead to a number."""
    for coefficient in COEFFICIENTS:
        if name in getattr(vehicle.file.aerodynamics, coefficient):
            return ["aerodynamics", coefficient, name]
    return name.split(".")


def _set(document: Any, keys: list[str], value: float | str) -> None:
    table = document
    for key in keys[:-1]:
        if key not in table:
            table.add(key, tomlkit.table())
        table = table[key]
    last: Any = keys[-1]
    if isinstance(table, list):
        last = "xyz".index(keys[-1])
    current = table[last] if isinstance(table, list) or last in table else None
    if isinstance(current, InlineTable | Table):
        current["value"] = value
    else:
        table[last] = value
