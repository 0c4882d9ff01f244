"""Crazyflie micro-SD logs (``.usd``, versions 1 and 2).

The file is little endian: one byte 0xBC, the version (uint16) and the number of event types (uint16); for each type its
identifier (uint16), its name ended by a zero, the number of variables (uint16) and each variable as ``name(t)`` ended by
a zero, where t is a letter of Python's struct module. Events follow, each with identifier (uint16), time stamp (version 1:
uint32 in ms, version 2: uint64 in us) and the variables without padding; the last four bytes are the CRC-32 of all before.

References
----------
Bitcraze AB, "uSD-card-deck", Crazyflie firmware documentation, section "uSD-card log format", and tools/usdlog/cfusdlog.py.
"""

from __future__ import annotations

import zlib
from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from stoop.base.units import FACTORS
from stoop.errors import LogError
from stoop.logs.recording import Defect, Recording, Stream, add_stream

MAX_VARIABLES: Final = 4096  #: of all event types together; the firmware allows some dozens
MAX_LISTED: Final = 20  #: damaged places that are listed one by one
MAX_SEARCHES: Final = 1000  #: for the next event after damage
CHECKSUM: Final = 4  #: bytes

TYPES: Final[Mapping[str, str]] = {
    "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8",
    "e": "<f2", "f": "<f4", "d": "<f8",
}  # fmt: skip
STAMPS: Final[Mapping[int, tuple[str, float]]] = {1: ("<u4", FACTORS["ms"]), 2: ("<u8", FACTORS["us"])}

#: identifier -> name of the event, type of its record
Layouts: TypeAlias = dict[int, tuple[str, np.dtype[Any]]]


def record_type(version: int, variables: list[tuple[str, str]]) -> np.dtype[Any]:
    """Return the type of an event: identifier, time stamp, and variables by name and type."""
    fields = [("", "<u2"), ("", STAMPS[version][0]), *variables]
    return np.dtype([(name or f"\0{i}", kind) for i, (name, kind) in enumerate(fields)])


def parse_crazyflie(path: Path, data: bytes, topics: frozenset[str] | None = None) -> Recording:
    """Read a micro-SD log of a Crazyflie.

    Parameters
    ----------
    path : its name
    data : its content
    topics : names of the events wanted; None means all

    Returns
    -------
    Recording : one stream per event name, columns called as in the file and in its units, time in s since power-on

    Raises
    ------
    LogError
        When it is no such log, or nothing of it can be read.
    """
    version, layouts, begin = _header(data, path)
    stated = int.from_bytes(data[-CHECKSUM:], "little")
    whole = len(data) - CHECKSUM >= begin and zlib.crc32(memoryview(data)[:-CHECKSUM]) == stated
    end = len(data) - CHECKSUM if whole else len(data)
    offsets, defects = _walk(data, version, layouts, begin, end, path.name)
    if not whole and not defects:
        message = "the checksum does not fit: the end is missing, or some values are wrong"
        defects = [Defect("corrupt", path.name, message)]
    streams: dict[str, Stream] = {}
    for key, (name, layout) in layouts.items():
        if (topics is None or name in topics) and len(offsets[key]):
            rows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), layout.itemsize)
            records = np.ascontiguousarray(rows[np.asarray(offsets[key])]).view(layout)[:, 0]
            _, stamp, *columns = layout.names or ()
            time = records[stamp].astype(np.float64) * STAMPS[version][1]
            add_stream(streams, defects, name, time, {column: records[column] for column in columns})
    if not any(len(places) for places in offsets.values()):
        raise LogError(f"{path}: no event was recorded; start the log before the flight and stop it after")
    info = {"log version": str(version), "checksum": "fits" if whole else "does not fit"}
    return Recording(path, "crazyflie", streams, tuple(defects), info=info)


@dataclass
class _Cursor:
    """Reads the numbers and zero-ended texts of a header one after the other."""

    _data: bytes
    _path: Path
    at: int

    def number(self) -> int:
        """Return the next uint16."""
        self.at += 2
        if self.at > len(self._data):
            raise self.error("it ends too soon")
        return int.from_bytes(self._data[self.at - 2 : self.at], "little")

    def text(self) -> str:
        """Return the next text."""
        end = self._data.find(b"\0", self.at, self.at + 256)
        if end < 0:
            raise self.error("it ends too soon")
        raw, self.at = self._data[self.at : end], end + 1
        if not raw.isascii() or not (name := raw.decode("ascii")).isprintable():
            raise self.error("a name is not text")
        return name

    def error(self, what: str) -> LogError:
        """Return the error of a damaged header."""
        where = f"{self._path}: damaged header at byte {self.at}"
        return LogError(f"{where} ({what}); copy it again from the card")


def _header(data: bytes, path: Path) -> tuple[int, Layouts, int]:
    """Return version, layouts, and the offset of the first event."""
    if not data:
        raise LogError(f"{path}: the log is empty; copy it again from the card")
    if data[:1] != b"\xbc":
        raise LogError(
            f"{path}: not a Crazyflie log, its first byte is not 0xBC; copy it again from the card"
        )
    cursor = _Cursor(data, path, 1)
    version = cursor.number()
    if version not in STAMPS:
        raise LogError(f"{path}: version {version} of the Crazyflie log is unknown; stoop reads 1 and 2")
    layouts: Layouts = {}
    names: set[str] = set()
    left = MAX_VARIABLES
    for _ in range(cursor.number()):
        key, name, count = cursor.number(), cursor.text(), cursor.number()
        left -= count + 1
        if left < 0:
            raise cursor.error("more variables than any log has")
        variables: dict[str, str] = {}
        for _ in range(count):
            text = cursor.text()
            variable, kind = text[:-3], text[-2:-1]
            if not variable or text != f"{variable}({kind})" or kind not in TYPES:
                raise cursor.error(f"variable {text!r} has no known type")
            if variable in variables:
                raise cursor.error(f"event {name!r} declares a variable twice")
            variables[variable] = TYPES[kind]
        if key in layouts or name in names:
            raise cursor.error(f"event {name!r} is declared twice")
        layouts[key] = name, record_type(version, [*variables.items()])
        names.add(name)
    return version, layouts, cursor.at


def _walk(
    data: bytes, version: int, layouts: Layouts, at: int, end: int, name: str
) -> tuple[dict[int, array[int]], list[Defect]]:
    """Step from event to event; where an identifier is unknown, search for the next chain of plausible events."""
    sizes = {key: record.itemsize for key, (_, record) in layouts.items()}
    offsets = {key: array("Q") for key in sizes}
    lost: list[tuple[int, int]] = []
    while at + 2 <= end:
        key = data[at] | data[at + 1] << 8
        size = sizes.get(key)
        if size is None and end - at <= CHECKSUM:  # a checksum that does not fit
            break
        if size is None:
            found = _search(data, version, sizes, at + 1, end) if len(lost) < MAX_SEARCHES else end
            lost.append((at, found))
            at = found
            continue
        if at + size > end:
            break
        offsets[key].append(at)
        at += size
    texts = [f"unknown event at byte {a}; {b - a} bytes skipped" for a, b in lost[:MAX_LISTED]]
    defects = [Defect("corrupt", name, text) for text in texts]
    if more := lost[MAX_LISTED:]:
        skipped = sum(last - first for first, last in more)
        defects.append(Defect("corrupt", name, f"{len(more)} more such places; {skipped} bytes skipped"))
    if at < end and end - at != CHECKSUM:
        message = f"the last event, at byte {at}, is cut; the rest was read"
        defects.append(Defect("truncated", name, message))
    return offsets, defects


def _search(data: bytes, version: int, sizes: Mapping[int, int], at: int, end: int) -> int:
    """Return the first offset at which three plausible events follow each other, or the end."""
    known = np.array(sorted(sizes), dtype=np.uint16)
    chunk = 4096
    while at + 2 <= end:
        stop = min(at + chunk, end - 1)
        raw = np.frombuffer(data, np.uint8, stop - at + 1, at).astype(np.uint16)
        for candidate in np.flatnonzero(np.isin(raw[:-1] | raw[1:] << 8, known)):
            if _is_chain(data, version, sizes, at + int(candidate), end):
                return at + int(candidate)
        at, chunk = stop, min(4 * chunk, 2**20)
    return end


def _is_chain(data: bytes, version: int, sizes: Mapping[int, int], at: int, end: int) -> bool:
    """Return whether three events of known size follow each other within a minute."""
    kind, unit = STAMPS[version]
    before: float | None = None
    for _ in range(3):
        size = sizes.get(int.from_bytes(data[at : at + 2], "little"))
        if size is None or at + size > end:
            return False
        stamp = int.from_bytes(data[at + 2 : at + 2 + int(kind[2:])], "little") * unit
        if before is not None and not 0.0 <= stamp - before < 60.0:
            return False
        before, at = stamp, at + size
    return True
