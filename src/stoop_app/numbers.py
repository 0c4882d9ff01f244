"""The numbers of a vehicle file as rows of a form, and edits of rows as edits of the file; comments and order stay."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import tomlkit
from pydantic import BaseModel

from stoop import Vehicle
from stoop.extend import vehicles
from stoop.extend.errors import VehicleError
from stoop.extend.files import with_values

WHERE: Final = "vehicle.toml"
FIELDS: Final = ("value", "free", "prior", "low", "high")  #: of a row that can be edited
_COMMENT: Final = re.compile(r"^    (?P<name>\w+):.*?#: (?P<text>.*)$", re.MULTILINE)


@dataclass(frozen=True)
class Row:
    """One number: SI and radians; prior is a standard deviation, None where there is none; bounds may be infinite."""

    name: str
    group: str
    value: float
    unit: str
    free: bool
    prior: float | None
    low: float
    high: float
    help: str


def rows_of(vehicle: Vehicle) -> list[Row]:
    """Return the rows of all numbers of a vehicle that are not tied to others."""
    quantities, out = vehicle.quantities, []
    for p in vehicle.parameters:
        keys = vehicle.keys_of(p.name)
        group = ".".join(keys[:-1]) if keys[0] in ("aerodynamics", "controls", "rotor") else keys[0]
        text = _help(vehicle, p.name, keys, quantities.get(p.name))
        unit = "" if p.unit == "1" else p.unit
        out.append(Row(p.name, group, p.value, unit, p.free, p.prior, p.lower, p.upper, text))
    return out


def _help(vehicle: Vehicle, name: str, keys: Sequence[str], quantity: vehicles.schema.Quantity | None) -> str:
    """Return what a number is: the term it multiplies, or what the schema says beside its field."""
    if keys[0] == "aerodynamics":
        term = (
            quantity.term
            if isinstance(quantity, vehicles.schema.Term)
            else vehicle.terms.get(keys[1], {}).get(name, "")
        )
        return f"{keys[1]} per {term}" if term and term != "1" else f"{keys[1]}, constant part"
    node: Any = vehicle.file
    for i, key in enumerate(keys):
        if isinstance(node, BaseModel):
            words = " ".join(keys[i:]).replace("_", " ")
            text = comments(type(node).__name__).get(key, "")
            summary = (type(node).__doc__ or "").partition("\n")[0].rstrip(".")
            node = getattr(node, key, None)
            if i == len(keys) - 1 or (text and not isinstance(node, BaseModel)):
                return f"{words}, {text}" if text else f"{words}: {summary}"
        elif isinstance(node, Mapping):
            node = node.get(key)
    return name


@cache
def comments(model: str) -> dict[str, str]:
    """Return field -> the comment beside it in the schema, which says what it is; empty where the source is not there."""
    try:
        source = inspect.getsource(getattr(vehicles.schema, model))
    except (OSError, AttributeError):
        return {}
    return {found["name"]: found["text"] for found in _COMMENT.finditer(source)}


def edited(text: str, edits: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the text of a vehicle file with fields of some numbers changed: name -> field of `FIELDS` -> new value.

    Raises
    ------
    VehicleError
        A value is impossible: which, and why.
    """
    vehicle, document = vehicles.parse_vehicle(text, WHERE), tomlkit.parse(text)
    known = {row.name: row for row in rows_of(vehicle)}
    quantities = vehicle.quantities
    for name, fields in edits.items():
        if name not in known:
            raise VehicleError(f"{WHERE}: {name} is no longer in the file")
        row, keys = known[name], vehicle.keys_of(name)
        if "value" in fields or not _stands(document, keys):
            vehicles.write_entry(document, keys, _number(name, fields.get("value", row.value)))
        written: dict[str, Any] = {}
        if "free" in fields:
            written["free"] = bool(fields["free"])
        if fields.get("prior") is not None:
            written["prior"] = _number(name, fields["prior"])
        if "low" in fields or "high" in fields:
            ends = zip(("low", "high"), (-1e30, 1e30), strict=True)
            given = [(fields.get(key, getattr(row, key)), limit) for key, limit in ends]
            bounds = [limit if value is None else _number(name, value) for value, limit in given]
            written["bounds"] = [max(bounds[0], -1e30), min(bounds[1], 1e30)]
        if written:
            vehicles.write_fields(document, keys, written)
        if "prior" in fields and fields["prior"] is None:
            _remove(document, keys, ("prior", "mean"))
        elif "prior" in written and quantities[name].mean is None and row.prior is None:
            _remove(document, keys, ("mean",))
    out = tomlkit.dumps(document)
    vehicles.parse_vehicle(out, WHERE)  # what is kept can be read
    return out


def freed(text: str, name: str) -> str:
    """Return the text with a number free, one of the catalogue of extensions added if the file lacks it."""
    vehicle = vehicles.parse_vehicle(text, WHERE)
    if name in vehicle.rows:
        return edited(text, {name: {"free": True}})
    found = vehicles.with_free_number(vehicle, name)
    if found is None:
        raise VehicleError(f"{WHERE}: there is no number '{name}' that could be freed")
    return with_values(found[0], {})


def _stands(document: Any, keys: Sequence[str]) -> bool:
    node = document
    for key in keys:
        if isinstance(node, list):
            return len(node) == 3
        if not isinstance(node, Mapping) or key not in node:
            return False
        node = node[key]
    return True


def _remove(document: Any, keys: Sequence[str], fields: Sequence[str]) -> None:
    node = document
    for key in keys:
        node = node["xyz".index(key)] if isinstance(node, list) else node[key]
    for field in fields:
        if isinstance(node, Mapping) and field in node:
            del node[field]  # type: ignore[attr-defined]


def _number(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if math.isnan(number):
        raise VehicleError(f"{name}: '{value}' is no number")
    return number
