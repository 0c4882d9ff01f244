"""ULog files: topics with their rows, parameters and texts, as PX4's logger lays them out.

References
----------
.. [1] PX4 ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.base.units import MICROSECOND
from stoop.logs.ulog_formats import BASIC
from stoop.logs.ulog_notes import LEVELS

HEAD: Final = b"ULog\x01\x12\x35\x01"
_TYPES: Final = {np.dtype(code): name for name, code in reversed(BASIC.items())} | {
    np.dtype(bool): "bool",
    np.dtype("i1"): "int8_t",
}
_ELEMENT: Final = re.compile(r"(.+)\[(\d+)\]")
_BLOCK: Final = 2**16  #: rows scattered at a time


@dataclass(frozen=True)
class Topic:
    """Rows of one instance of a topic.

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


def ulog(
    topics: Sequence[Topic],
    parameters: Mapping[str, float] | None = None,
    info: Mapping[str, str | int] | None = None,
    texts: Iterable[tuple[float, str, str]] = (),
) -> bytes:
    """Return a whole log.

    Parameters
    ----------
    topics : numbered in this order; rows stand in the order of their times, as a logger writes them
    parameters : whole numbers of Python's type int are written as such
    info : texts and whole numbers, such as ``ver_sw`` and ``ver_hw``
    texts : time [s], one of `stoop.logs.ulog_notes.LEVELS`, text; they stand before the rows
    """
    said = b"".join(text(*each) for each in texts)
    return definitions(topics, parameters, info) + said + rows(topics)[0]


def message(kind: str, body: bytes) -> bytes:
    """Return a message: size, kind, body."""
    return struct.pack("<HB", len(body), ord(kind)) + body


def definitions(
    topics: Sequence[Topic],
    parameters: Mapping[str, float] | None = None,
    info: Mapping[str, str | int] | None = None,
) -> bytes:
    """Return what stands before the first row: flags, information, formats, parameters, and the list of topics."""
    start = min((round(t.time[0] / MICROSECOND) for t in topics if t.time.size), default=0)
    formats = {t.name: _format(t) for t in topics}
    return b"".join(
        [
            HEAD,
            struct.pack("<Q", start),
            message("B", bytes(40)),
            *(message("I", _information(key, value)) for key, value in (info or {}).items()),
            *(message("F", body) for body in formats.values()),
            *(message("P", _parameter(key, value)) for key, value in (parameters or {}).items()),
            *(
                message("A", struct.pack("<BH", topic.instance, number) + topic.name.encode())
                for number, topic in enumerate(topics)
            ),
        ]
    )


def text(time: float, level: str, said: str) -> bytes:
    """Return a message for the pilot."""
    head = struct.pack("<BQ", ord("0") + LEVELS.index(level), round(time / MICROSECOND))
    return message("L", head + said.encode())


def dropout(milliseconds: int) -> bytes:
    """Return the logger's word that it could not write for a while."""
    return message("O", struct.pack("<H", milliseconds))


def _information(key: str, value: str | int) -> bytes:
    if isinstance(value, int):
        return _keyed(f"int32_t {key}", struct.pack("<i", value))
    return _keyed(f"char[{len(value.encode())}] {key}", value.encode())


def _parameter(key: str, value: float) -> bytes:
    if isinstance(value, int):
        return _keyed(f"int32_t {key}", struct.pack("<i", value))
    return _keyed(f"float {key}", struct.pack("<f", value))


def _keyed(key: str, value: bytes) -> bytes:
    return bytes([len(key.encode())]) + key.encode() + value


def _format(topic: Topic) -> bytes:
    """Return the layout of a row; elements of an array that follow each other become one field."""
    fields = ["uint64_t timestamp;"]
    typed = [(*_element(name), _TYPES[np.asarray(x).dtype]) for name, x in topic.columns.items()]
    for (name, is_array, kind), group in groupby(typed, key=lambda x: (x[0], x[1] >= 0, x[2])):
        indices = [index for _, index, _ in group]
        if is_array and indices == list(range(len(indices))):
            fields.append(f"{kind}[{len(indices)}] {name};")
        else:
            fields += [f"{kind} {name}[{i}];" if i >= 0 else f"{kind} {name};" for i in indices]
    return f"{topic.name}:{''.join(fields)}".encode()


def _element(name: str) -> tuple[str, int]:
    match = _ELEMENT.fullmatch(name)
    return (match[1], int(match[2])) if match else (name, -1)


def rows(topics: Sequence[Topic]) -> tuple[bytearray, npt.NDArray[np.intp]]:
    """Return the rows of all topics in the order of their times, and where each of them begins."""
    tables = [_table(number, topic) for number, topic in enumerate(topics)]
    times = np.concatenate([topic.time for topic in topics]) if topics else np.zeros(0)
    widths = np.repeat([table.shape[1] for table in tables], [table.shape[0] for table in tables])
    order = np.argsort(times, kind="stable")
    begins = np.empty(times.size, dtype=np.intp)
    begins[order] = np.cumsum(widths[order]) - widths[order]
    content = bytearray(int(widths.sum()))
    out, first = np.frombuffer(content, dtype=np.uint8), 0
    for table in tables:
        _scatter(table, begins[first : first + table.shape[0]], out)
        first += table.shape[0]
    return content, np.sort(begins)


def _table(number: int, topic: Topic) -> npt.NDArray[np.uint8]:
    """Return the messages of one topic, one in a row."""
    columns = {name: np.asarray(x) for name, x in topic.columns.items()}
    names = ["_size", "_kind", "_number", "timestamp", *columns]
    kinds = ["<u2", "u1", "<u2", "<u8", *(BASIC[_TYPES[x.dtype]] for x in columns.values())]
    packed = np.zeros(topic.time.size, dtype=np.dtype({"names": names, "formats": kinds}))
    width = packed.dtype.itemsize
    packed["_size"], packed["_kind"], packed["_number"] = width - 3, ord("D"), number
    packed["timestamp"] = np.rint(topic.time / MICROSECOND)
    for name, x in columns.items():
        packed[name] = x
    return packed.view(np.uint8).reshape(-1, width)


def _scatter(table: npt.NDArray[np.uint8], begins: npt.NDArray[np.intp], out: npt.NDArray[np.uint8]) -> None:
    """Write the rows of a table to where they begin, some at a time: the list of places is large."""
    for k in range(0, table.shape[0], _BLOCK):
        out[begins[k : k + _BLOCK, None] + np.arange(table.shape[1])] = table[k : k + _BLOCK]
