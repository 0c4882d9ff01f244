"""Vehicle files as documents: entries are written into the text, comments and order stay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import tomlkit
from tomlkit.items import InlineTable, Table

from stoop.vehicle.load import parse_vehicle
from stoop.vehicle.vehicle import Vehicle


def write_entry(document: Any, keys: Sequence[str], value: Any) -> None:
    """Write a number, a tie or a table of fields into a document; a number keeps the other fields that stand there."""
    table = document
    for key in keys[:-1]:
        if key not in table:
            table.add(key, tomlkit.inline_table() if isinstance(table, InlineTable) else tomlkit.table())
        table = table[key]
    last: Any = keys[-1]
    if isinstance(table, list):
        last = "xyz".index(keys[-1])
    current = table[last] if isinstance(table, list) or last in table else None
    if isinstance(value, Mapping):
        value = inline(value)
    if isinstance(current, InlineTable | Table) and isinstance(value, float):
        current["value"] = value
    else:
        table[last] = value


def write_fields(document: Any, keys: Sequence[str], fields: Mapping[str, Any]) -> None:
    """Write fields of a number that stands in a document, as itself or as a table; its other fields stay."""
    table = document
    for key in keys[:-1]:
        table = table[key]
    last: Any = "xyz".index(keys[-1]) if isinstance(table, list) else keys[-1]
    if not isinstance(table[last], InlineTable | Table):
        comment = getattr(getattr(table[last], "trivia", None), "comment", "")
        table[last] = inline({"value": table[last]})
        if comment:
            table[last].comment(comment)
    for name, field in fields.items():
        table[last][name] = field


def inline(fields: Mapping[str, Any]) -> InlineTable:
    """Return fields as a table in one line."""
    table = tomlkit.inline_table()
    table.update(fields)
    return table


def with_entries(vehicle: Vehicle, entries: Mapping[tuple[str, ...], Any]) -> Vehicle:
    """Return a vehicle whose file has further entries; numbers and tables that were set since it was read are kept.

    Raises
    ------
    VehicleError
        The entries do not go with the rest of the file.
    """
    document = tomlkit.parse(vehicle.text)
    if vehicle.file.controls and "controls" not in document:  # the standard ones, which a file need not name
        for name in vehicle.file.controls:
            write_entry(document, ("controls", name), tomlkit.table())
    for keys, value in entries.items():
        write_entry(document, keys, value)
    extended = parse_vehicle(tomlkit.dumps(document), vehicle.where)
    absent = [n for n in type(vehicle.file).model_fields if getattr(extended.file, n) is None]
    tables = {n: getattr(vehicle.file, n) for n in absent}
    # such as the gusts of a method
    extended = replace(extended, file=extended.file.model_copy(update=tables))
    if extended.reduce != vehicle.reduce:
        extended = extended.reduced(vehicle.reduce)
    extended = extended.coupled_to(vehicle.measured)
    written = {".".join(keys) for keys in entries} | {keys[-1] for keys in entries}
    tables_written = tuple(f"{'.'.join(keys)}." for keys in entries)
    known = extended.quantities
    kept = {
        name: {"value": q.value, "bounds": q.bounds, "free": q.free, "prior": q.prior, "mean": q.mean}
        for name, q in vehicle.quantities.items()
        if q.tie is None
        and name in known
        and known[name].tie is None
        and name not in written
        and not name.startswith(tables_written)
    }
    return extended.with_numbers(kept)
