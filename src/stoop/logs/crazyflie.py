"""Crazyflie micro-SD logs (``.usd``, versions 1 and 2), read into columns.

The file is little endian: one byte 0xBC, the version (uint16) and the number of event types (uint16); for each type its
identifier (uint16), its name ended by a zero, the number of variables (uint16) and each variable as ``name(t)`` ended by
a zero, where t is a letter of Python's struct module. Events follow, each with identifier (uint16), time stamp (version 1:
uint32 in ms, version 2: uint64 in us) and the variables without padding; the last four bytes are the CRC-32 of all before.

References
----------
Bitcraze AB, "uSD-card-deck", Crazyflie firmware documentation, section "uSD-card log format", and tools/usdlog/cfusdlog.py.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from stoop.base.units import FACTORS
from stoop.errors import LogError
from stoop.logs.recording import Defect, Recording, Stream, clean_stream, unreadable

MAGIC: Final = b"\xbc"
MAX_BYTES: Final = 2**26  #: 20 variables at 1 kHz for eleven minutes; a battery lasts seven
MAX_VARIABLES: Final = 4096  #: of all event types together; the firmware allows some dozens
MAX_RESYNCS: Final = 1000
_TOLD: Final = 20  #: damaged places that are listed one by one
_CHECKSUM: Final = 4
_AHEAD: Final = 60.0  #: s between events that are believed to follow each other
_CHUNK: Final = 4096

_TYPES: Final[Mapping[str, str]] = {
    "b": "i1",
    "B": "u1",
    "h": "<i2",
    "H": "<u2",
    "i": "<i4",
    "I": "<u4",
    "q": "<i8",
    "Q": "<u8",
    "e": "<f2",
    "f": "<f4",
    "d": "<f8",
}
_STAMPS: Final[Mapping[int, tuple[str, float]]] = {1: ("<u4", FACTORS["ms"]), 2: ("<u8", FACTORS["us"])}

Layouts: TypeAlias = dict[int, tuple[str, np.dtype[Any]]]


@dataclass(frozen=True)
class _Header:
    """What the first bytes declare: layouts is identifier -> (event name, record), body the offset of the first event."""

    version: int
    layouts: Layouts
    body: int


def read_crazyflie(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a micro-SD log of a Crazyflie.

    Parameters
    ----------
    path : the file
    topics : names of the events wanted; None means all

    Returns
    -------
    Recording : one stream per event name, columns called as in the file and in its units, time in s since power-on

    Raises
    ------
    LogError
        When it is no such log, or nothing of it can be read.
    """
    return parse_crazyflie(_bytes(path), path, topics)


def parse_crazyflie(data: bytes, path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a log that is already in memory; `path` is only its name."""
    header = _header(data, path)
    whole = len(data) - _CHECKSUM >= header.body and _checksum_fits(data)
    offsets, defects = _walk(data, header, len(data) - _CHECKSUM if whole else len(data), path.name)
    if not whole and not defects:
        message = "the checksum does not fit: the end is missing, or some values are wrong"
        defects = [Defect("corrupt", path.name, message)]
    streams: dict[str, Stream] = {}
    for key, (name, layout) in header.layouts.items():
        if (topics is None or name in topics) and len(offsets[key]):
            stream, found = _stream(name, _records(data, offsets[key], layout), header.version)
            defects.extend(found)
            if stream.time.size:
                streams[name] = stream
    if not any(len(found) for found in offsets.values()):
        raise LogError(f"{path}: no event was recorded; start the log before the flight and stop it after")
    info = {"log version": str(header.version), "checksum": "fits" if whole else "does not fit"}
    return Recording(path, "crazyflie", streams, tuple(defects), info=info)


def _bytes(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise LogError(
                f"{path}: larger than {MAX_BYTES >> 20} MiB; cut the log to the flight of interest"
            )
        return path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from None


def _checksum_fits(data: bytes) -> bool:
    view = memoryview(data)
    return zlib.crc32(view[:-_CHECKSUM]) == int.from_bytes(view[-_CHECKSUM:], "little")


class _Cursor:
    """Reads numbers and zero-ended texts one after the other; any fault is the file's."""

    def __init__(self, data: bytes, path: Path, at: int) -> None:
        self._data = data
        self._path = path
        self.at = at

    def number(self) -> int:
        self._need(self.at + 2)
        (value,) = struct.unpack_from("<H", self._data, self.at)
        self.at += 2
        return int(value)

    def text(self) -> str:
        end = self._data.find(b"\0", self.at, self.at + 256)
        self._need(end + 1 if end >= 0 else len(self._data) + 1)
        raw, self.at = self._data[self.at : end], end + 1
        if not raw.isascii() or not (name := raw.decode("ascii")).isprintable():
            raise self.fault("a name is not text")
        return name

    def fault(self, what: str) -> LogError:
        return LogError(
            f"{self._path}: damaged header at byte {self.at} ({what}); copy it again from the card"
        )

    def _need(self, end: int) -> None:
        if end > len(self._data):
            raise self.fault("it ends too soon")


def _header(data: bytes, path: Path) -> _Header:
    if not data:
        raise LogError(f"{path}: the log is empty; copy it again from the card")
    if data[:1] != MAGIC:
        raise LogError(
            f"{path}: not a Crazyflie log, its first byte is not 0xBC; copy it again from the card"
        )
    cursor = _Cursor(data, path, 1)
    version = cursor.number()
    if version not in _STAMPS:
        raise LogError(f"{path}: version {version} of the Crazyflie log is unknown; stoop reads 1 and 2")
    layouts: Layouts = {}
    names: set[str] = set()
    left = MAX_VARIABLES
    for _ in range(cursor.number()):
        key, name, record, left = _event_type(cursor, version, left)
        if key in layouts or name in names:
            raise cursor.fault(f"event {name!r} is declared twice")
        layouts[key] = name, record
        names.add(name)
    return _Header(version, layouts, cursor.at)


def _event_type(cursor: _Cursor, version: int, left: int) -> tuple[int, str, np.dtype[Any], int]:
    """Read one entry of the table of events; `left` variables may still be declared."""
    key, name, count = cursor.number(), cursor.text(), cursor.number()
    if count + 1 > left:
        raise cursor.fault("more variables than any log has")
    fields = [("", "<u2"), ("", _STAMPS[version][0])]
    fields += [_variable(cursor) for _ in range(count)]
    named = [n for n, _ in fields[2:]]
    if len(set(named)) < len(named):
        raise cursor.fault(f"event {name!r} declares a variable twice")
    return key, name, np.dtype([(n or f"\0{i}", t) for i, (n, t) in enumerate(fields)]), left - count - 1


def _variable(cursor: _Cursor) -> tuple[str, str]:
    text = cursor.text()
    name, kind = text[:-3], text[-2:-1]
    if not name or text != f"{name}({kind})" or kind not in _TYPES:
        raise cursor.fault(f"variable {text!r} has no known type")
    return name, _TYPES[kind]


def _walk(data: bytes, header: _Header, end: int, name: str) -> tuple[dict[int, array[int]], list[Defect]]:
    """Step from event to event; where an identifier is unknown, search for the next chain of plausible events."""
    sizes = {key: record.itemsize for key, (_, record) in header.layouts.items()}
    offsets = {key: array("Q") for key in sizes}
    lost: list[tuple[int, int]] = []
    at = header.body
    while at + 2 <= end:
        key = data[at] | data[at + 1] << 8
        size = sizes.get(key)
        if size is None and end - at <= _CHECKSUM:  # a checksum that does not fit
            break
        if size is None:
            found = _resync(data, header, sizes, at + 1, end) if len(lost) < MAX_RESYNCS else end
            lost.append((at, found))
            at = found
            continue
        if at + size > end:
            break
        offsets[key].append(at)
        at += size
    return offsets, _damage(lost, at, end, name)


def _damage(lost: list[tuple[int, int]], at: int, end: int, name: str) -> list[Defect]:
    """Say where events could not be followed, and what is left of a cut end."""
    defects = [
        Defect("corrupt", name, f"unknown event at byte {first}; {last - first} bytes skipped")
        for first, last in lost[:_TOLD]
    ]
    if len(lost) > _TOLD:
        skipped = sum(last - first for first, last in lost[_TOLD:])
        defects.append(
            Defect("corrupt", name, f"{len(lost) - _TOLD} more such places; {skipped} bytes skipped")
        )
    if at < end and end - at != _CHECKSUM:
        message = f"the last event, at byte {at}, is cut; read what is left"
        defects.append(Defect("truncated", name, message))
    return defects


def _resync(data: bytes, header: _Header, sizes: Mapping[int, int], start: int, end: int) -> int:
    """Return the first offset from `start` at which three events in a row are plausible, or the end."""
    known = np.array(sorted(sizes), dtype=np.uint16)
    at, chunk = start, _CHUNK
    while at + 2 <= end:
        stop = min(at + chunk, end - 1)
        raw = np.frombuffer(data, np.uint8, stop - at + 1, at).astype(np.uint16)
        for candidate in np.flatnonzero(np.isin(raw[:-1] | raw[1:] << 8, known)):
            if _plausible(data, header, sizes, at + int(candidate), end):
                return at + int(candidate)
        at, chunk = stop, min(4 * chunk, 2**20)
    return end


def _plausible(data: bytes, header: _Header, sizes: Mapping[int, int], at: int, end: int) -> bool:
    kind, unit = _STAMPS[header.version]
    width = int(kind[2:])
    before: float | None = None
    for _ in range(3):
        size = sizes.get(int.from_bytes(data[at : at + 2], "little"))
        if size is None or at + size > end:
            return False
        stamp = int.from_bytes(data[at + 2 : at + 2 + width], "little") * unit
        if before is not None and not 0.0 <= stamp - before < _AHEAD:
            return False
        before, at = stamp, at + size
    return True


def _records(data: bytes, offsets: array[int], layout: np.dtype[Any]) -> npt.NDArray[Any]:
    """Copy the records at the given offsets into one structured array."""
    rows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), layout.itemsize)
    return np.ascontiguousarray(rows[np.asarray(offsets)]).view(layout)[:, 0]


def _stream(name: str, records: npt.NDArray[Any], version: int) -> tuple[Stream, tuple[Defect, ...]]:
    _, stamp, *columns = records.dtype.names or ()
    time = records[stamp].astype(np.float64) * _STAMPS[version][1]
    return clean_stream(name, time, {column: records[column] for column in columns})
