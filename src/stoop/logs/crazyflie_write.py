"""Crazyflie micro-SD logs, written: for simulated flights, and for tests of the reader."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

_LETTERS: Final = {
    "i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I",
    "i8": "q", "u8": "Q", "f2": "e", "f4": "f", "f8": "d",
}  # fmt: skip
_STAMPS: Final = {1: ("<u4", 1e3), 2: ("<u8", 1e6)}


@dataclass(frozen=True)
class Event:
    """Events of one type.

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
    """Return a whole log with its checksum; events of all types stand in the order of their times."""
    head = struct.pack("<BHH", 0xBC, version, len(events))
    for name, event in events.items():
        head += struct.pack("<H", event.key) + name.encode("ascii") + b"\0"
        head += struct.pack("<H", len(event.columns))
        for column, values in event.columns.items():
            head += f"{column}({_LETTERS[values.dtype.str[1:]]})\0".encode("ascii")
    body = head + _body(tuple(events.values()), version)
    return body + struct.pack("<I", zlib.crc32(body))


def _body(events: tuple[Event, ...], version: int) -> bytes:
    rows = [row for event in events for row in _rows(event, version)]
    times = np.concatenate([event.time for event in events]) if events else np.empty(0)
    return b"".join(rows[i] for i in np.argsort(times, kind="stable"))


def _rows(event: Event, version: int) -> list[bytes]:
    stamp, per_second = _STAMPS[version]
    fields = [("", "<u2"), ("", stamp)]
    fields += [(name, values.dtype.newbyteorder("<").str) for name, values in event.columns.items()]
    records = np.zeros(event.time.size, np.dtype([(n or f"\0{i}", t) for i, (n, t) in enumerate(fields)]))
    names = records.dtype.names or ()
    records[names[0]] = event.key
    records[names[1]] = np.round(event.time * per_second)
    for name, values in event.columns.items():
        records[name] = values
    return [record.tobytes() for record in records]
