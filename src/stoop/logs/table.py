"""CSV logs of any origin, read by a mapping: columns become SI variables on the clock of their file."""

from __future__ import annotations

import re
from collections.abc import Mapping as TextMapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import FACTORS
from stoop.errors import LogError, listed
from stoop.logs.mapping import Column, Mapping, is_first_edition, mapping_of, read_toml
from stoop.logs.recording import Defect, Recording, Stream, clean_stream
from stoop.logs.text import read_header, read_table

FOLDER_MAPPING: Final = "mapping.toml"
GROWS: Final = 0.9  #: share of steps that go forward, in a clock
MOST_FILES: Final = 200  #: of a folder; logs have fewer
_ENDING: Final = re.compile(r"\.csv(\.gz)?$", re.IGNORECASE)


def beside(path: Path) -> Path:
    """Return where the mapping of a log is looked for when none is named."""
    return path / FOLDER_MAPPING if path.is_dir() else path.with_name(path.name + ".toml")


def read_csv(path: Path, mapping: Path | None) -> Recording:
    """Read one CSV file, or a folder of them, by a mapping.

    Parameters
    ----------
    path : the file or folder
    mapping : TOML file; None looks beside the log

    Raises
    ------
    LogError
        When there is no mapping (the text holds one to start from), a column is missing, or nothing is left.
    """
    if mapping is None and not beside(path).is_file():
        raise LogError(_without_mapping(path))
    place = mapping or beside(path)
    content = read_toml(place)
    if not is_first_edition(content):
        return _second_edition(path, content)
    known = mapping_of(place, content)
    unread: dict[str, tuple[str, ...]] = {}
    streams: dict[str, Stream] = {}
    defects: list[Defect] = []
    for file, columns in _by_file(path, known).items():
        stream, found, rest = _read(file, columns, known)
        streams[file.name] = stream
        defects.extend(found)
        unread |= {file.name: rest} if rest else {}
    return Recording(path, "table", streams, tuple(defects), unread=unread)


def _second_edition(path: Path, content: TextMapping[str, Any]) -> Recording:
    """Read whole tables: a mapping of the second edition is applied by those who know the variables."""
    if path.is_dir() and "extends" in content and "time" not in content:
        from stoop.logs.px4csv import read_px4_folder

        return read_px4_folder(path)
    tables = {name: clock for name, clock in {"": content.get("time"), **_clocks(content)}.items() if clock}
    columns = {name: x["column"] for name, x in tables.items() if isinstance(x, dict) and "column" in x}
    return read_raw_csv(path, {name: str(column) for name, column in columns.items()})


def _clocks(content: TextMapping[str, Any]) -> dict[str, Any]:
    clocks = content.get("clock", {})
    return clocks if isinstance(clocks, dict) else {}


def read_raw_csv(path: Path, clocks: TextMapping[str, str] | None = None) -> Recording:
    """Read one CSV file, or a folder of them, without any mapping.

    Parameters
    ----------
    path : the file or folder
    clocks : file -> column of its time, "" for all others; where there is none, the likeliest column is
        taken, and its unit from its name

    Returns
    -------
    Recording : one stream per file, all columns as they stand there, the clock among them; `info` names it

    Raises
    ------
    LogError
        When there is no CSV file, or no two samples with a time are left.
    """
    files = sorted(file for file in path.iterdir() if _ENDING.search(file.name)) if path.is_dir() else [path]
    if not files:
        raise LogError(f"{path}: no CSV file in this folder; name the folder of the log")
    streams: dict[str, Stream] = {}
    defects: list[Defect] = []
    info: dict[str, str] = {}
    for file in files[:MOST_FILES]:
        table, found = read_table(file)
        column, factor = _clock_of(file, table, clocks or {})
        stream, order = clean_stream(file.name, table[column] * factor, table)
        defects += [*found, *order]
        if stream.time.size > 1:
            streams[file.name] = stream
            info[f"clock of {file.name}"] = column
    if not streams:
        raise LogError(f"{path}: fewer than two samples with a time are left; name the column of the time")
    return Recording(path, "table", streams, tuple(defects), info=info)


def _clock_of(
    file: Path, table: TextMapping[str, FloatArray], clocks: TextMapping[str, str]
) -> tuple[str, float]:
    """Return the column of the time and seconds per unit, by the mapping or by names."""
    named = clocks.get(file.name, clocks.get("", ""))
    if named in table:
        return named, 1.0
    column, unit = guess_clock(list(table))
    if not _CLOCK.fullmatch(column):
        column = next((name for name, x in table.items() if _grows(x)), column)
    return column, FACTORS[unit]


def _grows(x: FloatArray) -> bool:
    """Tell whether a column can be a clock: it hardly ever stands or runs back."""
    return x.size > 2 and bool(np.mean(np.diff(x) > 0.0) > GROWS)


def guess_clock(header: list[str]) -> tuple[str, str]:
    """Return the likeliest column of the time and its unit, by names alone."""
    clock = next((name for name in header if _CLOCK.fullmatch(name)), header[0])
    suffix = _CLOCK.fullmatch(clock)
    return clock, (suffix and suffix["unit"]) or "s"


def _by_file(path: Path, mapping: Mapping) -> dict[Path, list[Column]]:
    files: dict[Path, list[Column]] = {}
    for column in mapping.columns:
        files.setdefault(_file_of(path, mapping, column), []).append(column)
    return files


def _file_of(path: Path, mapping: Mapping, column: Column) -> Path:
    where = f"{mapping.path}: variables.{column.variable}"
    if not path.is_dir():
        if column.file and column.file != path.name:
            raise LogError(
                f"{where}.file = '{column.file}', but the log is the one file {path.name}; drop 'file'"
            )
        return path
    if not column.file:
        raise LogError(f'{where} names no file, but the log is the folder {path}; write file = "..."')
    file = path / column.file
    if Path(column.file).name != column.file or not file.is_file():
        raise LogError(f"{where}.file = '{column.file}' is not in {path}; name a file of that folder")
    return file


def _read(
    file: Path, columns: list[Column], mapping: Mapping
) -> tuple[Stream, list[Defect], tuple[str, ...]]:
    """Read one file; return its stream, what was wrong, and the columns that the mapping does not name."""
    table, defects = read_table(file)
    with np.errstate(over="ignore", invalid="ignore"):  # what is beyond any size is dropped and told later
        time = _pick(file, table, mapping.time_column, f"{mapping.path}: time") * mapping.time_factor
        values = {
            c.variable: _pick(file, table, c.column, f"{mapping.path}: variables.{c.variable}") * c.factor
            + c.offset
            for c in columns
        }
    stream, order = clean_stream(file.name, time, values)
    if stream.time.size < 2:
        raise LogError(
            f"{file}: fewer than two samples with a time are left; check time.column in {mapping.path}"
        )
    used = {f"{file.name} {c.column}" for c in columns} | {file.name, f"{file.name} {mapping.time_column}"}
    known = {mapping.time_column, *(c.column for c in columns)}
    rest = tuple(name for name in table if name not in known)
    return stream, [d for d in (*defects, *order) if d.place in used], rest


def _pick(file: Path, table: dict[str, FloatArray], column: str, where: str) -> FloatArray:
    if column not in table:
        raise LogError(f"{where}.column = '{column}' is not in {file}; its columns are {listed(table)}")
    return table[column]


def _without_mapping(path: Path) -> str:
    if path.is_dir():
        return (
            f"{path}: a folder of CSV files needs a mapping; write one and put it there as {FOLDER_MAPPING}"
        )
    head = f"{path}: a CSV log needs a mapping of its columns; save the lines below as {beside(path).name}"
    return f"{head} beside it, keep and correct what applies (or let stoop map draft one)\n{template(read_header(path))}"


def template(header: list[str]) -> str:
    """Return a mapping to start from: each column under its own name, the likeliest one as the time."""
    clock, unit = guess_clock(header)
    lines = ["[time]", f"column = {quoted(clock)}", f'unit = "{unit}"', "", "[variables]"]
    lines += [_template_line(name) for name in header if name != clock]
    return "\n".join(lines)


def _template_line(name: str) -> str:
    return f'{key_of(name)} = {{column = {quoted(name)}, unit = "{_UNITS.get(name, "1")}"}}'


_CLOCK: Final = re.compile(r"(t|[Tt]ime|[Tt]imestamp|[Ss]ystime)([ _]?[(\[]?(?P<unit>s|ms|us|ns)[)\]]?)?")
_UNITS: Final = {
    "V": "m/s", "vt": "m/s", "alpha": "rad", "beta": "rad", "phi": "rad", "theta": "rad", "psi": "rad",
    "p": "rad/s", "q": "rad/s", "r": "rad/s", "ax": "m/s2", "ay": "m/s2", "az": "m/s2",
    "vn": "m/s", "ve": "m/s", "vd": "m/s", "pn": "m", "pe": "m", "pd": "m", "altitude": "m",
    "elevator": "rad", "aileron": "rad", "rudder": "rad", "thrust": "N", "density": "kg/m3",
}  # fmt: skip


def quoted(text: str) -> str:
    """Return a text as TOML writes it."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in escaped) + '"'


def key_of(text: str) -> str:
    """Return a key as TOML writes it, bare where it can be."""
    plain = text.replace("_", "").replace("-", "")
    return text if plain.isascii() and plain.isalnum() else quoted(text)
