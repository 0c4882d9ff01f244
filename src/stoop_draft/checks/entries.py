"""Lines of a mapping as the user wrote them, and what to write there instead."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

from stoop.extend.files import toml
from stoop.extend.flights import Source
from stoop.extend.text import enumerated
from stoop.extend.units import UNITS
from stoop.extend.variables import VARIABLES

TABLE: Final = "the table"  #: file of lines that are columns in memory
_SOURCE: Final = re.compile(r"group\.(?P<group>.+)\.sources\[(?P<index>\d+)\]")


class Change(NamedTuple):
    """One key of one table of a mapping, written anew."""

    table: str  #: such as "variables.p" or "group.imu.sources[0]"
    key: str
    value: Any  #: text, number, or list of these

    def __str__(self) -> str:
        """Return it as TOML would have it."""
        return f"{self.table}.{self.key} = {written(self.value)}"


@dataclass(frozen=True)
class Line:
    """One line of a mapping that the user wrote: file "M.toml", table "variables.p"; the unit is empty where none is.

    A column of a table in memory, which has no mapping, is a line of `TABLE`.
    """

    file: str
    key: str
    unit: str = ""
    entry: Mapping[str, Any] = field(default_factory=dict)  #: keys of the table
    index: int = 0  #: place among the variables of the table
    count: int = 1  #: variables of the table
    ready: bool = (
        False  #: of a mapping that comes with the package: `entry` is what a line of [variables] says instead
    )

    def value(self, key: str, default: Any) -> Any:
        """Return what a key of the table says of this variable."""
        known = self.entry.get(key, default)
        return known[self.index] if isinstance(known, list) else known

    @property
    def plain(self) -> bool:
        """Whether scale and offset act on one column of one name for each variable, along the axes of stoop."""
        columns = self.entry.get("column", self.entry.get("columns", ()))
        every = columns if isinstance(columns, list) else [columns]
        texts = [*every, self.entry.get("stream", "")]
        written_out = len(every) == self.count and all(isinstance(x, str) and "{" not in x for x in texts)
        return written_out and not self.entry.get("frame")

    def same_stream(self, other: Line) -> bool:
        """Whether another line differs in column, unit, scale and offset alone."""
        own = ("column", "columns", "variables", "unit", "scale", "offset")
        entries = ({key: x for key, x in line.entry.items() if key not in own} for line in (self, other))
        return (
            self.count == other.count
            and (self.count == 1 or self.key == other.key)
            and next(entries) == next(entries)
        )

    def whole(self, changes: Sequence[Change]) -> str:
        """Return the line of [variables] with changes."""
        entry = {**self.entry, **{change.key: change.value for change in changes}}
        body = ", ".join(f"{key} = {written(value)}" for key, value in entry.items())
        return f"{self.key.partition('.')[2]} = {{{body}}}"

    def changed(self, key: str, value: Any, default: Any) -> Change:
        """Return the change that gives a key another value for this variable alone."""
        if self.count == 1 and not isinstance(self.entry.get(key), list):
            return Change(self.key, key, value)
        known = self.entry.get(key, default)
        every = list(known) if isinstance(known, list) else [known] * self.count
        every[self.index] = value
        return Change(self.key, key, every)


Lines: TypeAlias = Mapping[str, Line]  #: variable -> its line; variables of ready mappings have none


def read_lines(places: Mapping[str, str]) -> dict[str, Line]:
    """Return the lines of mappings that the user wrote.

    Parameters
    ----------
    places : variable -> place of its line, "FILE: KEY"; ready mappings are no files
    """
    lines: dict[str, Line] = {}
    content: dict[str, dict[str, Any] | None] = {}  # by file; None where there is no such file
    for name, place in places.items():
        file, _, key = place.rpartition(": ")
        if file not in content:
            content[file] = None
            if file and Path(file).is_file():
                with suppress(OSError, ValueError):  # no mapping: it has no lines
                    content[file] = tomllib.loads(Path(file).read_text("utf-8-sig"))
        table = content[file]
        if table is not None:
            lines[name] = _line(file, key, name, table)
    return lines


def _line(file: str, key: str, name: str, content: Mapping[str, Any]) -> Line:
    """Return the line of a variable: its own table, or its place in the source of a group."""
    found, entry, names = _SOURCE.fullmatch(key), content.get("variables", {}).get(name, {}), [name]
    if found is not None:
        group = content["group"][found["group"]]
        source = group["sources"][int(found["index"])] if "sources" in group else {}
        key = key if "sources" in group else f"group.{found['group']}"
        entry = {**group, **source}
        names = entry["variables"] if isinstance(entry["variables"], list) else [entry["variables"]]
    if name not in names:  # written out by braces
        return Line(file, key)
    line = Line(file, key, "", entry, names.index(name), len(names))
    return replace(line, unit=str(line.value("unit", "")))


def ready_line(source: Source, stream: str, name: str) -> Line:
    """Return the line of [variables] that takes a variable as a source of a ready mapping does."""
    i, unit = source.variables.index(name), VARIABLES[name].unit
    column, *others = source.columns[i]
    entry: dict[str, Any] = {"stream": stream, "column": column, "unit": source.units[i] or unit}
    scale = source.factors[i] / VARIABLES[name].units.get(entry["unit"], 1.0)
    offset = source.offsets[i] - UNITS[entry["unit"]].zero
    entry |= {"scale": scale} if scale != 1.0 else {}
    entry |= {"offset": offset} if offset != 0.0 else {}
    entry |= {"valid": source.valid[i]} if source.valid[i] else {}
    entry |= {"stamp": source.stamp} if source.stamp else {}
    if (
        others
        or source.columns[i][column] != 1.0
        or source.frame
        or source.stamp_factor != UNITS["us"].factor
    ):
        entry["column"] = dict(source.columns[i])  # advice that is no line
    place = f'a mapping that says extends = "{source.place.partition(":")[0]}"'
    return Line(place, f"variables.{name}", entry["unit"], entry, ready=True)


def written(value: Any) -> str:
    """Return a value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(written, value))}]"
    return f"{value:.12g}" if isinstance(value, int | float) else toml.quoted(value)


def told(changes: Sequence[Change], lines: Lines) -> str:
    """Return changes as a sentence: those of one key and value said together, else whole lines."""
    by_table = {change.table: [one for one in changes if one.table == change.table] for change in changes}
    known = {line.key: line for line in lines.values()}
    file = known[changes[0].table].file
    if (
        len({(change.key, written(change.value)) for change in changes}) == 1
        and not known[changes[0].table].ready
    ):
        first = changes[0]
        return f"write {first.key} = {written(first.value)} for {enumerated([*by_table])} in {file}"
    whole = [known[table].whole(own) for table, own in by_table.items() if table.startswith("variables.")]
    parts = [f"{enumerated(whole)} under [variables]"] if whole else []
    for table, own in by_table.items():
        if not table.startswith("variables."):
            keys = enumerated([f"{change.key} = {written(change.value)}" for change in own])
            parts.append(f"{keys} for {table}")
    return f"write {' and '.join(parts)} in {file}"


def where(names: Iterable[str], lines: Lines) -> str:
    """Return where to write what corrects variables: their lines, or a mapping that extends the ready one."""
    names = tuple(names)
    own = [lines[name] for name in names if name in lines and not lines[name].ready]
    if len(own) < len(names) or not own:
        return f"{enumerated(names)} in a mapping (see stoop map)"
    return f"{enumerated([line.key for line in own])} in {own[0].file}"
