"""Binary logs written: PX4's ULog, ArduPilot's DataFlash, micro-SD logs of a Crazyflie; for simulated flights and for tests.

References
----------
.. [1] PX4 ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
.. [2] ArduPilot, libraries/AP_Logger/LogStructure.h
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from stoop.extend.arrays import IntArray
from stoop.extend.recordings import crazyflie, dataflash

Bytes: TypeAlias = npt.NDArray[np.uint8]
Values: TypeAlias = Sequence[Any] | npt.NDArray[Any]


def _interleaved(tables: Sequence[Bytes], times: Sequence[npt.NDArray[Any]]) -> tuple[bytearray, IntArray]:
    """Return the rows (n, width) of all tables in the order of their times, and where each of them begins."""
    content = bytearray(sum(table.size for table in tables))
    if not tables:
        return content, np.zeros(0, dtype=np.intp)
    widths = np.repeat([table.shape[1] for table in tables], [table.shape[0] for table in tables])
    order = np.argsort(np.concatenate(times), kind="stable")
    begins = np.empty(order.size, dtype=np.intp)
    begins[order] = np.cumsum(widths[order]) - widths[order]
    out, first, block = np.frombuffer(content, dtype=np.uint8), 0, 2**16  # rows at a time: places are large
    for table in tables:
        own = begins[first : first + table.shape[0]]
        for k in range(0, table.shape[0], block):
            out[own[k : k + block, None] + np.arange(table.shape[1])] = table[k : k + block]
        first += table.shape[0]
    return content, np.sort(begins)


@dataclass(frozen=True)
class Topic:
    """Rows of one instance of a topic of PX4.

    Attributes
    ----------
    name : as PX4 calls it
    time : (n,) s, increasing, not negative
    columns : name -> (n,) numbers of any type that ULog has; "xyz[0]", "xyz[1]", ... that follow each other are an array
    instance : 0 for the first
    """

    name: str
    time: npt.NDArray[np.float64]
    columns: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)
    instance: int = 0


MICROSECOND: Final = 1e-6  #: s
#: severities of a ULog's texts, 0 to 7
LEVELS: Final = ("EMERGENCY", "ALERT", "CRITICAL", "ERROR", "WARNING", "NOTICE", "INFO", "DEBUG")
_TYPES: Final = {
    **{np.dtype(f"{name[0]}{size}"): f"{name}{8 * size}_t" for name in ("int", "uint") for size in (1, 2, 4, 8)},
    np.dtype("f4"): "float", np.dtype("f8"): "double", np.dtype(bool): "bool",
}  #: types of a ULog  # fmt: skip


def ulog(
    topics: Sequence[Topic],
    parameters: Mapping[str, float] | None = None,
    info: Mapping[str, str | int] | None = None,
    texts: Iterable[tuple[float, str, str]] = (),
) -> bytes:
    """Return a ULog.

    Parameters
    ----------
    topics : numbered in this order; rows stand in the order of their times, as a logger writes them
    parameters : whole numbers of Python's type int are written as such
    info : texts and whole numbers, such as ``ver_sw`` and ``ver_hw``
    texts : time [s], one of `LEVELS`, text; they stand before the rows
    """
    messages = b"".join(ulog_text(*each) for each in texts)
    return ulog_definitions(topics, parameters, info) + messages + ulog_rows(topics)[0]


def ulog_message(kind: str, body: bytes) -> bytes:
    """Return a message of a ULog: size, kind, body."""
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulog_definitions(
    topics: Sequence[Topic],
    parameters: Mapping[str, float] | None = None,
    info: Mapping[str, str | int] | None = None,
) -> bytes:
    """Return what stands before the first row: flags, information, formats, parameters, and the list of topics."""

    def keyed(key: str, value: str | float) -> bytes:
        if isinstance(value, str):
            content = value.encode()
            kind = f"char[{len(content)}]"
        else:
            whole = isinstance(value, int)
            with np.errstate(over="ignore"):  # beyond 32 bits a float is infinite
                content = struct.pack("<i", value) if whole else np.float32(value).tobytes()
            kind = "int32_t" if whole else "float"
        name = f"{kind} {key}".encode()[:255]
        return bytes([len(name)]) + name + content

    start = min((round(t.time[0] / MICROSECOND) for t in topics if t.time.size), default=0)
    out = [b"ULog\x01\x12\x35\x01", struct.pack("<Q", start), ulog_message("B", bytes(40))]
    out += [ulog_message("I", keyed(key, value)) for key, value in (info or {}).items()]
    formats = {topic.name: _format(topic) for topic in topics}
    out += [ulog_message("F", body) for body in formats.values()]
    out += [ulog_message("P", keyed(key, value)) for key, value in (parameters or {}).items()]
    for i, topic in enumerate(topics):
        out.append(ulog_message("A", struct.pack("<BH", topic.instance, i) + topic.name.encode()))
    return b"".join(out)


def ulog_text(time: float, level: str, text: str) -> bytes:
    """Return a message for the pilot."""
    head = struct.pack("<BQ", ord("0") + LEVELS.index(level), round(time / MICROSECOND))
    return ulog_message("L", head + text.encode())


def ulog_dropout(milliseconds: int) -> bytes:
    """Return the message that the logger could not write for a while."""
    return ulog_message("O", struct.pack("<H", milliseconds))


def _format(topic: Topic) -> bytes:
    """Return the layout of a row; elements of an array that follow each other become one field."""
    fields = ["uint64_t timestamp;"]
    columns = []
    for column, x in topic.columns.items():
        match = re.fullmatch(r"(.+)\[(\d{1,9})\]", column)
        name, index = (match[1], int(match[2])) if match else (column, -1)
        columns.append((name, index, _TYPES[np.asarray(x).dtype]))
    for (name, is_array, kind), group in groupby(columns, key=lambda x: (x[0], x[1] >= 0, x[2])):
        indices = [index for _, index, _ in group]
        if is_array and indices == list(range(len(indices))):
            fields.append(f"{kind}[{len(indices)}] {name};")
        else:
            fields += [f"{kind} {name}[{i}];" if i >= 0 else f"{kind} {name};" for i in indices]
    return f"{topic.name}:{''.join(fields)}".encode()


def ulog_rows(topics: Sequence[Topic]) -> tuple[bytearray, IntArray]:
    """Return the rows of all topics in the order of their times, and where each of them begins."""
    tables = []
    for number, topic in enumerate(topics):
        columns = {name: np.asarray(x) for name, x in topic.columns.items()}
        names = ["_size", "_kind", "_number", "timestamp", *columns]
        kinds = ["<u2", "u1", "<u2", "<u8", *(x.dtype.newbyteorder("<") for x in columns.values())]
        packed = np.zeros(topic.time.size, dtype=np.dtype({"names": names, "formats": kinds}))
        width = packed.dtype.itemsize
        packed["_size"], packed["_kind"], packed["_number"] = width - 3, ord("D"), number
        packed["timestamp"] = np.rint(topic.time / MICROSECOND)
        for name, x in columns.items():
            packed[name] = x
        tables.append(packed.view(np.uint8).reshape(-1, width))
    return _interleaved(tables, [topic.time for topic in topics])


FMT, FMT_LENGTH = 128, 89  #: id and size of the message that defines messages, also of itself
UNITS: Final = {
    "-": "", "?": "UNKNOWN", "A": "A", "d": "deg", "k": "deg/s", "D": "deglatitude", "U": "deglongitude",
    "e": "deg/s/s", "E": "rad/s", "G": "Gauss", "h": "degheading", "L": "rad/s/s", "m": "m", "n": "m/s", "N": "N",
    "o": "m/s/s", "O": "degC", "%": "%", "s": "s", "t": "N.m", "q": "rpm", "r": "rad", "v": "V", "P": "Pa", "W": "Watt",
    "Y": "us", "z": "Hz", "#": "instance",
}  #: mark of a unit -> the unit, as ArduPilot has them [2]  # fmt: skip
MULTIPLIERS: Final = {
    "-": 0.0, "?": 1.0, "2": 1e2, "1": 1e1, "0": 1.0, "A": 1e-1, "B": 1e-2, "C": 1e-3, "D": 1e-4, "E": 1e-5,
    "F": 1e-6, "G": 1e-7, "I": 1e-9,
}  # fmt: skip


@dataclass(frozen=True)
class Table:
    """All messages of one kind of a DataFlash log.

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
    values: Mapping[str, Values]


def _described(name: str, letters: str, **columns: Values) -> Table:
    """Return a table that describes a log, at time zero."""
    values = {"TimeUS": np.zeros(len(next(iter(columns.values())))), **columns}
    units, multipliers = (mark.ljust(len(values), "-") for mark in "sF")
    return Table(name, ",".join(values), f"Q{letters}", units, multipliers, values)


def dataflash_bytes(
    tables: Sequence[Table], parameters: Mapping[str, float] | None = None, messages: Sequence[str] = ()
) -> bytes:
    """Return a DataFlash log.

    Parameters
    ----------
    tables : up to 120, rows in the order of their time; rows of different tables are put in the order of TimeUS
    parameters : name of up to 16 letters -> value
    messages : lines of text, at the beginning

    Raises
    ------
    ValueError
        When a table cannot be written.
    """
    known = parameters or {}
    units = _described("UNIT", "bZ", Id=[ord(k) for k in UNITS], Label=[*UNITS.values()])
    multipliers = _described("MULT", "bd", Id=[ord(k) for k in MULTIPLIERS], Mult=[*MULTIPLIERS.values()])
    stored = _described("PARM", "Nf", Name=[*known], Value=[*known.values()])
    texts = _described("MSG", "Z", Message=list(messages))
    formats = _described("FMTU", "BNN", FmtType=[], UnitIds=[], MultIds=[])
    every = [formats, units, multipliers, stored, texts, *tables]
    # ids as small as can be, but not that of FMT
    kinds = dict(zip((t.name for t in every), (n for n in range(1, 256) if n != FMT), strict=False))
    if len(kinds) != len(every):
        raise ValueError("tables need names of their own, and ids go to 255")
    marks = [t.units for t in every], [t.multipliers for t in every]
    every[0] = _described("FMTU", "BNN", FmtType=[*kinds.values()], UnitIds=marks[0], MultIds=marks[1])
    out = [_definition(FMT, "FMT", FMT_LENGTH, "BBnNZ", "Type,Length,Name,Format,Columns")]
    blocks: list[Bytes] = []
    for table in every:
        layout = dataflash.make_layout(kinds[table.name], table.name, table.letters, table.columns)
        fits = len(table.name) <= 4 and len(table.letters) <= 16 and len(table.columns) <= 64
        if layout is None or not fits or layout.row.itemsize > 252:
            raise ValueError(f"table {table.name} of {table.columns} cannot be written as {table.letters}")
        length = layout.row.itemsize + 3
        out.append(_definition(layout.kind, table.name, length, table.letters, table.columns))
        blocks.append(_rows(layout, table))
    own = blocks[-len(tables) :] if tables else []
    heads = [block.tobytes() for block in blocks[: len(blocks) - len(own)]]
    times = [np.asarray(t.values.get("TimeUS", np.zeros(len(b)))) for t, b in zip(tables, own, strict=True)]
    return b"".join([*out, *heads, _interleaved(own, times)[0]])


def _definition(kind: int, name: str, length: int, letters: str, columns: str) -> bytes:
    body = np.array([(kind, length, name.encode(), letters.encode(), columns.encode())], dataflash.BODY)
    return b"\xa3\x95\x80" + body.tobytes()


def _rows(layout: dataflash.Layout, table: Table) -> Bytes:
    """Return the messages of a table, (n, length) bytes; numbers are divided, rounded, and clipped to their type."""
    counts = {len(values) for values in table.values.values()}
    if len(counts) != 1 or set(layout.columns) != table.values.keys():
        raise ValueError(f"table {table.name}: every column needs as many values as the others")
    rows = np.zeros(counts.pop(), np.dtype([("head", "u1", 3), ("body", layout.row)]))
    rows["head"] = (0xA3, 0x95, layout.kind)
    for i, (name, letter) in enumerate(zip(layout.columns, layout.letters, strict=True)):
        values = table.values[name]
        if letter in dataflash.TEXTS:
            rows["body"][str(i)] = np.array([str(value).encode() for value in values], dtype="S64")
            continue
        numbers = np.asarray(values)
        if letter not in "gfd":
            kind = np.dtype(dataflash.TYPES[letter]).base
            least, most = np.iinfo(kind).min, np.iinfo(kind).max
            if numbers.dtype.kind not in "iu":
                numbers = np.rint(np.nan_to_num(numbers) * dataflash.DIVISORS.get(letter, 1.0))
                if kind.itemsize == 8:  # 2**63 is no int64
                    most = int(np.nextafter(float(most), 0.0))
            numbers = np.clip(numbers, least, most).astype(kind)
        with np.errstate(over="ignore"):  # what is beyond a type of floating numbers is infinite
            rows["body"][str(i)] = numbers
    return rows.view(np.uint8).reshape(len(rows), rows.itemsize)


@dataclass(frozen=True)
class Event:
    """Events of one type of a Crazyflie.

    Attributes
    ----------
    key : identifier in the file, below 65536
    time : (n,) s since power-on, not negative
    columns : name -> (n,) values; the type of each array becomes its type in the file
    """

    key: int
    time: npt.NDArray[np.floating[Any]]
    columns: Mapping[str, npt.NDArray[Any]]


def crazyflie_bytes(events: Mapping[str, Event], version: int = 2) -> bytes:
    """Return a micro-SD log with its checksum; events of all types stand in the order of their times."""
    letters = {kind.lstrip("<"): letter for letter, kind in crazyflie.TYPES.items()}
    head = struct.pack("<BHH", 0xBC, version, len(events))
    tables = []
    for name, event in events.items():
        head += struct.pack("<H", event.key) + name.encode("ascii") + b"\0"
        head += struct.pack("<H", len(event.columns))
        for column, x in event.columns.items():
            head += f"{column}({letters[x.dtype.str[1:]]})\0".encode("ascii")
        kinds = [(column, x.dtype.newbyteorder("<").str) for column, x in event.columns.items()]
        records = np.zeros(event.time.size, crazyflie.record_type(version, kinds))
        names = list(records.dtype.names or [])
        records[names[0]] = event.key
        records[names[1]] = np.round(event.time * (1e3 if version == 1 else 1e6))
        for column in names[2:]:
            records[column] = event.columns[column]
        tables.append(records.view(np.uint8).reshape(len(records), records.itemsize))
    body = head + bytes(_interleaved(tables, [event.time for event in events.values()])[0])
    return body + struct.pack("<I", zlib.crc32(body))
