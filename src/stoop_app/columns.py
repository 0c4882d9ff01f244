"""The columns of a log as rows of a form, and edits of rows as edits of its mapping; comments and order stay."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Final

import tomlkit

from stoop.extend.errors import LogError, StoopError
from stoop.extend.files import toml
from stoop.extend.flights import FlightMapping, Source
from stoop.extend.text import number
from stoop.extend.variables import VARIABLES

WHERE: Final = "mapping.toml"
FIELDS: Final = ("variable", "unit", "scale", "offset")  #: of a row that can be edited
USUAL: Final = {"scale": 1.0, "offset": 0.0}  #: of a line that does not name them
CLOCK: Final = "the clock"
UNKNOWN: Final = "not recognized: choose a variable and a unit, or leave it out"
ABSENT: Final = "not in this log"
_OFFER: Final = re.compile(r"# ?(?P<name>\w+) = (?P<place>\{.*?\})\s*(?:#\s*(?P<remark>.*))?")


@dataclass(frozen=True)
class Row:
    """A column, and what a mapping makes of it; a column that supplies several variables has a row for each."""

    column: str
    stream: str
    values: str  #: samples and range, as the log has them
    variable: str = ""  #: empty where it supplies none
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    doubt: str = ""
    line: str = ""  #: variable under which [variables] has it; empty where another table, or none, names it
    place: Mapping[str, Any] = field(default_factory=dict)  #: keys with which a line names the column


@cache
def units_of() -> dict[str, list[str]]:
    """Return the units that each variable may be recorded in."""
    return {name: [*one.units] for name, one in VARIABLES.items()}


def meaning(variable: str) -> str:
    """Return what a variable is, in a line."""
    one = VARIABLES[variable]
    unit = "" if one.unit == "1" else one.unit
    return f"{variable}: {', '.join(filter(None, (one.meaning, one.sign, unit)))}"


def parsed(text: str) -> FlightMapping:
    """Return the mapping of a text.

    Raises
    ------
    LogError, FlightError
        It is none.
    """
    return FlightMapping.parse(WHERE, toml.parse_source(text, WHERE, LogError))


def rows_of(text: str, columns: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Return the lines of a mapping, columns that its other tables name, and all other columns of the log.

    Parameters
    ----------
    text : str
        The mapping, TOML.
    columns : sequence
        What ``stoop map --json`` prints of each column.

    Raises
    ------
    LogError, FlightError
        The text is no mapping.
    """
    mapping = parsed(text)
    document = tomlkit.parse(text)
    lines: dict[str, Any] = dict(document.get("variables", {}))
    several = len({one["stream"] for one in columns}) > 1
    rows: list[Row] = []
    for one in columns:
        name, stream = one["column"], one["stream"]
        place = {"stream": stream, "column": name} if several else {"column": name}
        row = Row(name, stream, _values(one), place=place)
        own = [v for v, line in lines.items() if _reads(line, stream, name)]
        rows += [_of_line(row, v, lines[v]) for v in own] or [_other(row, mapping, text)]
    found = {row.line for row in rows}
    rows += [_of_line(Row("", "", ABSENT), v, line) for v, line in lines.items() if v not in found]
    order = [*lines]
    return sorted(rows, key=lambda r: order.index(r.line) if r.line else len(order) + (not r.variable))


def edited(text: str, changes: Sequence[tuple[Row, Mapping[str, Any]]]) -> str:
    """Return the mapping with the edits of rows, each a row as it was and its new fields.

    Raises
    ------
    StoopError
        A unit is missing, or two columns supply one variable.
    LogError, FlightError
        The text would be no mapping.
    """
    document = tomlkit.parse(text)
    table: Any = document.setdefault("variables", tomlkit.table())
    pairs = [(old, replace(old, **fields)) for old, fields in changes]
    moved = {old.line: table.pop(old.line) for old, now in pairs if old.line not in ("", now.variable)}
    for old, now in pairs:
        if now.variable:
            table[now.variable] = _entry(old, now, table, moved)
        elif old.variable and not old.line:
            raise StoopError(f"{old.column}: {old.doubt} names it; change that in the text below")
    changed = tomlkit.dumps(document)
    parsed(changed)
    return changed


def _entry(old: Row, now: Row, table: Any, moved: Mapping[str, Any]) -> Any:
    """Return the line of a row that was edited; its doubt, of which somebody has now decided, is gone."""
    if now.variable in table and now.variable != old.line:
        raise StoopError(f"{now.variable} is read from two columns, {old.column} is one; choose one of them")
    if not now.unit:
        units = ", ".join(units_of().get(now.variable, ()))
        raise StoopError(f"{old.column}: choose the unit in which it was recorded, one of {units}")
    entry = table[old.line] if old.line == now.variable else moved.get(old.line)
    if entry is None:
        entry = tomlkit.inline_table()
        entry.update(old.place)
    entry["unit"] = now.unit
    for key, usual in USUAL.items():
        if getattr(now, key) != usual:
            entry[key] = getattr(now, key)
        else:
            entry.pop(key, None)
    if isinstance(entry, tomlkit.items.InlineTable):
        entry.trivia.comment_ws = entry.trivia.comment = ""
    return entry


def _values(one: Mapping[str, Any]) -> str:
    """Return samples of a column and its range."""
    if one["low"] is None:
        return "no number"
    *samples, low, high = (number(x, 3) for x in (*one["samples"], one["low"], one["high"]))
    return f"{', '.join(samples)} ({low} to {high}{one['unit'] and ' '}{one['unit']})"


def _reads(line: Mapping[str, Any], stream: str, column: str) -> bool:
    named = line["column"]
    return column in (named if isinstance(named, dict) else (named,)) and _of_stream(
        line.get("stream", line.get("file", "")), stream
    )


def _of_stream(named: str, stream: str) -> bool:
    return named in ("", stream, stream.partition("/")[0])


def _of_line(row: Row, variable: str, line: Any) -> Row:
    """Return the row of a column that a line of [variables] names."""
    comment = getattr(getattr(line, "trivia", None), "comment", "")
    scale, offset = (line.get(key, usual) for key, usual in USUAL.items())
    named = line["column"]
    return replace(
        row,
        column=row.column or (" + ".join(named) if isinstance(named, dict) else str(named)),
        variable=variable,
        unit=str(line["unit"]),
        scale=float(scale[0] if isinstance(scale, list) else scale),
        offset=float(offset[0] if isinstance(offset, list) else offset),
        doubt=str(comment).lstrip("# "),
        line=variable,
    )


def _other(row: Row, mapping: FlightMapping, text: str) -> Row:
    """Return the row of a column that no line of [variables] names."""
    clocks = {"": mapping.clock, **mapping.clocks}
    if any(c is not None and c.column == row.column and _of_stream(s, row.stream) for s, c in clocks.items()):
        return replace(row, doubt=CLOCK)
    for source in mapping.sources:
        if _of_stream(source.stream, row.stream):
            for variable, columns, unit in zip(source.variables, source.columns, _units(source), strict=True):
                if row.column in columns:
                    place = source.place.removeprefix(f"{WHERE}: ").partition(".sources")[0]
                    return replace(row, variable=variable, unit=unit or VARIABLES[variable].unit, doubt=place)
    for name, line, remark in _offers(text):
        if line.get("column") == row.column and _of_stream(line.get("stream", ""), row.stream):
            said = f"may be {name}, {line['unit']}" if name in VARIABLES else UNKNOWN
            return replace(row, doubt=f"{said}; {remark}" if remark and name in VARIABLES else said)
    return replace(row, doubt=UNKNOWN)


def _units(source: Source) -> Sequence[str]:
    return source.units or ("",) * len(source.variables)


def _offers(text: str) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield the lines that a draft offers as comments: variable, what the line says, remark."""
    for line in text.splitlines():
        found = _OFFER.fullmatch(line)
        if found is not None:
            try:
                yield found["name"], tomllib.loads(f"x = {found['place']}")["x"], found["remark"] or ""
            except tomllib.TOMLDecodeError:
                continue
