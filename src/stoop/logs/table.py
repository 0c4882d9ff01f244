"""CSV logs of any origin, read by a mapping: columns become SI variables on the clock of their file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from stoop.errors import LogError
from stoop.logs.mapping import Column, Mapping, read_mapping
from stoop.logs.recording import Defect, FloatArray, Recording, Stream, clean_stream
from stoop.logs.text import read_header, read_table

FOLDER_MAPPING: Final = "mapping.toml"


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
    known = read_mapping(mapping or beside(path))
    streams: dict[str, Stream] = {}
    defects: list[Defect] = []
    for file, columns in _by_file(path, known).items():
        stream, found = _read(file, columns, known)
        streams[file.name] = stream
        defects.extend(found)
    return Recording(path, "table", streams, tuple(defects))


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


def _read(file: Path, columns: list[Column], mapping: Mapping) -> tuple[Stream, list[Defect]]:
    table, defects = read_table(file)
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
    return stream, [d for d in (*defects, *order) if d.place in used]


def _pick(file: Path, table: dict[str, FloatArray], column: str, where: str) -> FloatArray:
    if column not in table:
        raise LogError(f"{where}.column = '{column}' is not in {file}; its columns are {_listed(table)}")
    return table[column]


def _listed(names: object, most: int = 40) -> str:
    known = list(names)  # type: ignore[call-overload]
    return ", ".join(known[:most]) + (f" and {len(known) - most} more" if len(known) > most else "")


def _without_mapping(path: Path) -> str:
    if path.is_dir():
        return (
            f"{path}: a folder of CSV files needs a mapping; write one and put it there as {FOLDER_MAPPING}"
        )
    head = f"{path}: a CSV log needs a mapping of its columns; save the lines below as {beside(path).name}"
    return f"{head} beside it, keep and correct what applies\n{template(read_header(path))}"


def template(header: list[str]) -> str:
    """Return a mapping to start from: each column under its own name, the likeliest one as the time."""
    clock = next((name for name in header if _CLOCK.fullmatch(name)), header[0])
    suffix = _CLOCK.fullmatch(clock)
    unit = (suffix and suffix["unit"]) or "s"
    lines = ["[time]", f"column = {_quoted(clock)}", f'unit = "{unit}"', "", "[variables]"]
    lines += [_template_line(name) for name in header if name != clock]
    return "\n".join(lines)


def _template_line(name: str) -> str:
    return f'{_key(name)} = {{column = {_quoted(name)}, unit = "{_UNITS.get(name, "1")}"}}'


_CLOCK: Final = re.compile(r"(t|[Tt]ime|[Tt]imestamp|[Ss]ystime)([ _]?[(\[]?(?P<unit>s|ms|us|ns)[)\]]?)?")
_UNITS: Final = {
    "V": "m/s", "vt": "m/s", "alpha": "rad", "beta": "rad", "phi": "rad", "theta": "rad", "psi": "rad",
    "p": "rad/s", "q": "rad/s", "r": "rad/s", "ax": "m/s2", "ay": "m/s2", "az": "m/s2",
    "vn": "m/s", "ve": "m/s", "vd": "m/s", "pn": "m", "pe": "m", "pd": "m", "altitude": "m",
    "elevator": "rad", "aileron": "rad", "rudder": "rad", "thrust": "N", "density": "kg/m3",
}  # fmt: skip


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in escaped) + '"'


def _key(text: str) -> str:
    plain = text.replace("_", "").replace("-", "")
    return text if plain.isascii() and plain.isalnum() else _quoted(text)
