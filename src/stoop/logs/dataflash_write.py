"""DataFlash logs written: for simulated flights in ArduPilot's form, and for tests of the reader."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.logs.dataflash_format import BODY, DIVISORS, TEXTS, TYPES, Layout, make_layout

Bytes = npt.NDArray[np.uint8]

FMT: Final = 128
FIRST_KIND: Final = 1  #: id of the first table; those above 128 come after FMT
UNITS: Final = {
    "-": "", "?": "UNKNOWN", "A": "A", "d": "deg", "k": "deg/s", "D": "deglatitude", "U": "deglongitude",
    "e": "deg/s/s", "E": "rad/s", "G": "Gauss", "h": "degheading", "L": "rad/s/s", "m": "m", "n": "m/s", "N": "N",
    "o": "m/s/s", "O": "degC", "%": "%", "s": "s", "t": "N.m", "q": "rpm", "r": "rad", "v": "V", "P": "Pa", "W": "Watt",
    "Y": "us", "z": "Hz", "#": "instance",
}  #: mark of a unit -> the unit, as ArduPilot has them (LogStructure.h)  # fmt: skip
MULTIPLIERS: Final = {
    "-": 0.0, "?": 1.0, "2": 1e2, "1": 1e1, "0": 1.0, "A": 1e-1, "B": 1e-2, "C": 1e-3, "D": 1e-4, "E": 1e-5,
    "F": 1e-6, "G": 1e-7, "I": 1e-9,
}  # fmt: skip


@dataclass(frozen=True)
class Table:
    """All messages of one kind that a log is to hold.

    Attributes
    ----------
    name : up to 4 letters, such as "IMU"
    columns : names with commas, such as "TimeUS,I,GyrX"; the first should be TimeUS
    letters : how each is stored, such as "QBf"
    units, multipliers : a mark of `UNITS` and of `MULTIPLIERS` for each column, such as "s#E" and "F-0"
    values : name of column -> (n,) numbers as a reader gives them (scaled), or texts
    """

    name: str
    columns: str
    letters: str
    units: str
    multipliers: str
    values: Mapping[str, Sequence[Any] | npt.NDArray[Any]]


def dataflash_bytes(
    tables: Sequence[Table], parameters: Mapping[str, float] | None = None, messages: Sequence[str] = ()
) -> bytes:
    """Write a log.

    Parameters
    ----------
    tables : up to 120, rows in the order of their time; rows of different tables are put in the order of TimeUS
    parameters : name of up to 16 letters -> value
    messages : lines of text, at the beginning

    Raises
    ------
    ValueError
        When a table says something impossible.
    """
    count = len(parameters or {})
    about = [
        Table("PARM", "TimeUS,Name,Value", "QNf", "s--", "F--",
              {"TimeUS": np.zeros(count), "Name": [*(parameters or {})], "Value": [*(parameters or {}).values()]}),
        Table("MSG", "TimeUS,Message", "QZ", "s-", "F-",
              {"TimeUS": np.zeros(len(messages)), "Message": list(messages)}),
    ]  # fmt: skip
    about = [_fmtu([_FMTU, _UNIT, _MULT, *about, *tables]), _UNIT, _MULT, *about]
    layouts = _layouts([*about, *tables])
    formats = [_format(FMT, "FMT", 89, "BBnNZ", "Type,Length,Name,Format,Columns")]
    formats += [_format(k.kind, k.name, k.row.itemsize + 3, k.letters, ",".join(k.columns)) for k in layouts]
    told = [_rows(layout, table).tobytes() for layout, table in zip(layouts, about, strict=False)]
    head = b"".join(formats + told)
    return head + _merged(layouts[len(about) :], tables)


def _kinds(tables: Sequence[Table]) -> dict[str, int]:
    """Return the id of each table: as small as can be, but not that of FMT."""
    numbers = [n for n in range(FIRST_KIND, 256) if n != FMT]
    return dict(zip((table.name for table in tables), numbers, strict=False))


def _fmtu(tables: Sequence[Table]) -> Table:
    numbers = [*_kinds(tables).values()]
    values: dict[str, Sequence[Any] | npt.NDArray[Any]] = {
        "TimeUS": np.zeros(len(tables)),
        "FmtType": numbers,
        "UnitIds": [table.units for table in tables],
        "MultIds": [table.multipliers for table in tables],
    }
    return Table(_FMTU.name, _FMTU.columns, _FMTU.letters, _FMTU.units, _FMTU.multipliers, values)


def _layouts(tables: Sequence[Table]) -> list[Layout]:
    kinds = _kinds(tables)
    if len(kinds) != len(tables):
        raise ValueError("tables need names of their own, and ids go to 255")
    return [_layout(kinds[table.name], table) for table in tables]


def _layout(kind: int, table: Table) -> Layout:
    layout = make_layout(kind, table.name, table.letters, table.columns)
    fits = len(table.name) <= 4 and len(table.letters) <= 16 and len(table.columns) <= 64
    if layout is None or not fits or layout.row.itemsize > 252:
        raise ValueError(
            f"table {table.name} of columns {table.columns} cannot be written as {table.letters}"
        )
    return layout


def _format(kind: int, name: str, length: int, letters: str, columns: str) -> bytes:
    body = np.array([(kind, length, name.encode(), letters.encode(), columns.encode())], BODY)
    return b"\xa3\x95\x80" + body.tobytes()


def _rows(layout: Layout, table: Table) -> Bytes:
    """Return the messages of a table, (n, length) bytes."""
    counts = {len(values) for values in table.values.values()}
    if len(counts) != 1 or set(layout.columns) != table.values.keys():
        raise ValueError(f"table {table.name}: every column needs as many values as the others")
    rows = np.zeros(counts.pop(), np.dtype([("head", "u1", 3), ("body", layout.row)]))
    rows["head"] = (0xA3, 0x95, layout.kind)
    for i, (name, letter) in enumerate(zip(layout.columns, layout.letters, strict=True)):
        rows["body"][str(i)] = _stored(table.values[name], letter)
    return rows.view(np.uint8).reshape(len(rows), rows.itemsize)


def _stored(values: Sequence[Any] | npt.NDArray[Any], letter: str) -> npt.NDArray[Any]:
    """Return a column as its letter keeps it: divided, rounded, and held at the ends of its range."""
    if letter in TEXTS:
        return np.array([str(value).encode() for value in values], dtype="S64")
    numbers = np.asarray(values)
    if letter in "gfd":
        return numbers
    kind = np.dtype(TYPES[letter]).base
    least, most = np.iinfo(kind).min, np.iinfo(kind).max
    if numbers.dtype.kind not in "iu":
        numbers = np.rint(np.nan_to_num(numbers) * DIVISORS.get(letter, 1.0))
        most = int(np.nextafter(float(most), 0.0)) if kind.itemsize == 8 else most  # 2**63 is no int64
    stored: npt.NDArray[Any] = np.clip(numbers, least, most).astype(kind)
    return stored


def _merged(layouts: Sequence[Layout], tables: Sequence[Table]) -> bytes:
    """Return the messages of several tables in the order of their time."""
    blocks = [_rows(layout, table) for layout, table in zip(layouts, tables, strict=True)]
    if not blocks:
        return b""
    clocks = [
        np.asarray(table.values.get("TimeUS", np.zeros(len(b))))
        for table, b in zip(tables, blocks, strict=True)
    ]
    times = np.concatenate(clocks)
    lengths = np.concatenate([np.full(len(b), b.shape[1]) for b in blocks])
    order = np.argsort(times, kind="stable")
    place = np.empty(times.size, np.int64)
    place[order] = np.cumsum(lengths[order]) - lengths[order]
    out = np.empty(int(lengths.sum()), np.uint8)
    begin = 0
    for block in blocks:
        starts = place[begin : begin + len(block)]
        for byte in range(block.shape[1]):
            out[starts + byte] = block[:, byte]
        begin += len(block)
    return out.tobytes()


_FMTU: Final = Table("FMTU", "TimeUS,FmtType,UnitIds,MultIds", "QBNN", "s---", "F---", {})
_UNIT: Final = Table(
    "UNIT", "TimeUS,Id,Label", "QbZ", "s--", "F--",
    {"TimeUS": np.zeros(len(UNITS)), "Id": [ord(k) for k in UNITS], "Label": [*UNITS.values()]},
)  # fmt: skip
_MULT: Final = Table(
    "MULT", "TimeUS,Id,Mult", "Qbd", "s--", "F--",
    {"TimeUS": np.zeros(len(MULTIPLIERS)), "Id": [ord(k) for k in MULTIPLIERS], "Mult": [*MULTIPLIERS.values()]},
)  # fmt: skip
