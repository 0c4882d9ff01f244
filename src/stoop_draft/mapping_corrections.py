"""A mapping corrected by what its checks advise: each change is kept where the log, read by it, confirms it."""

from __future__ import annotations

import re
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import tomlkit
import tomlkit.items

from stoop import Notice, load_flight
from stoop.extend.errors import LogError, StoopError
from stoop.extend.files import toml, write_file
from stoop.extend.flights import FlightMapping
from stoop_draft.checks.mapping import ContradictedError

MOST: Final = 32  #: changes of one mapping
_PLACE: Final = re.compile(r"(?P<tables>.+)\.(?P<key>\w+)")
_SOURCE: Final = re.compile(r"(?P<group>.+)\.sources\[(?P<index>\d+)\]")


@dataclass(frozen=True)
class Corrections:
    """A corrected mapping."""

    text: str  #: TOML
    applied: tuple[Notice, ...]  #: whose changes were made, and confirmed
    left: tuple[Notice, ...]  #: what still contradicts the mapping


def corrected_mapping(log: Path, mapping: Path) -> Corrections:
    """Apply what the checks of a mapping advise, most evident first, where a change leaves fewer contradictions and no new one.

    Raises
    ------
    LogError, FlightError
        When log or mapping cannot be read.
    """
    FlightMapping.read(mapping)  # says best what is no mapping
    text = toml.read_source(mapping, "mapping", LogError)
    applied: list[Notice] = []
    found, refused = contradictions(log, text, mapping), set[tuple[str, ...]]()
    while len(applied) < MOST:
        advised = [one for one in found if _changes(one) and _changes(one) not in refused]
        if not advised:
            break
        best = max(advised, key=lambda one: float(str(one.values["evidence"])))
        changed = with_changes(text, _changes(best))
        try:
            after = contradictions(log, changed, mapping)
        except StoopError:  # what cannot be read is no correction
            after = found
        if {(one.code, one.subject) for one in after} < {(one.code, one.subject) for one in found}:
            text, found = changed, after
            applied.append(best)
        else:
            refused.add(_changes(best))
    return Corrections(text, tuple(applied), tuple(found))


def _changes(found: Notice) -> tuple[str, ...]:
    changes = found.values.get("changes", ())
    return tuple(map(str, changes)) if isinstance(changes, tuple) else ()


def contradictions(log: Path, text: str, mapping: Path) -> list[Notice]:
    """Return what contradicts a mapping of this text, as of the file that it is to be."""
    with tempfile.TemporaryDirectory(prefix="stoop-mapping-") as folder:
        place = Path(folder) / "mapping.toml"
        write_file(place, text)
        try:
            found = [fault.notice for fault in load_flight(log, place).faults]
        except ContradictedError as error:
            found = list(error.notices)
        except StoopError as error:
            raise type(error)(str(error).replace(str(place), str(mapping))) from None

    def told(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(told(part) for part in value)
        return value.replace(str(place), str(mapping)) if isinstance(value, str) else value

    of_lines = [one for one in found if "suggestion" in one.values]
    return [replace(one, values={key: told(value) for key, value in one.values.items()}) for one in of_lines]


def with_changes(text: str, changes: Sequence[str]) -> str:
    """Return a mapping with changes such as ``variables.p.scale = -1``; comments and order stay."""
    document = tomlkit.parse(text)
    for change in changes:
        place, _, value = change.partition(" = ")
        found = _PLACE.fullmatch(place)
        if found is None:
            raise ValueError(f"no change of a mapping: {change}")
        table = _table(document, found["tables"])
        before = table.get(found["key"], "")
        table[found["key"]] = tomllib.loads(f"x = {value}")["x"]
        _without_stale(table, str(before))
    return tomlkit.dumps(document)


def _without_stale(table: Any, before: str) -> None:
    """Leave out what a draft wrote beside a line of its doubts, its sign and the unit that it had `before`."""
    comment = table.trivia.comment if isinstance(table, tomlkit.items.InlineTable) else ""
    parts = comment.removeprefix("#").strip().split("; ")
    kept = [part for part in parts if not part.startswith(("unsure:", "turned", f"{before} by "))]
    if comment and kept != parts:
        table.trivia.comment = f"# {'; '.join(kept)}" if kept else ""
        table.trivia.comment_ws = table.trivia.comment_ws if kept else ""


def _table(document: Any, tables: str) -> Any:
    """Return the table of a change."""
    kind, _, name = tables.partition(".")
    source = _SOURCE.fullmatch(name)
    if source is None and kind == "variables":
        variables = document.setdefault(kind, tomlkit.table())
        return variables.setdefault(name, tomlkit.inline_table())
    if source is None:
        return document[kind][name]
    return document[kind][source["group"]]["sources"][int(source["index"])]
