"""PX4 .ulg files: the topics wanted become streams; parameters and texts of the log stand beside them.

The file is read a piece at a time, and only the rows of wanted topics are kept.

References
----------
.. [1] PX4 ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from stoop.base.units import MICROSECOND
from stoop.errors import LogError, listed
from stoop.logs import ulog_walk
from stoop.logs.recording import Defect, Recording, Stream, add_stream, checked_size, unreadable
from stoop.logs.ulog_messages import PADDING, BodyError, Formats, Metadata, decoded

MAGIC: Final = b"ULog\x01\x12\x35"
_START: Final = 16  #: bytes before the first message: magic, version, time
_FLAGS: Final = ulog_walk.HEADER + 40  #: bytes of the message of flags at least
_HANDLED: Final = b"AFIMPQRLC"  #: kinds of messages other than rows

Bytes: TypeAlias = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Limits:
    """What is read of a log, and how; a real log stays far below the limits."""

    size: int = 2**36  #: bytes of a file
    columns: int = 200_000  #: of all topics together; a real log has some thousands
    streams: int = 20_000  #: topics with instances
    memory: int = 2**33  #: bytes of all rows that are kept
    events: int = 200_000  #: messages of one kind other than rows; a log of hours has some thousands
    damages: int = 20_000  #: damaged places after which reading ends
    listed: int = 20  #: defects of a kind that are listed one by one
    piece: int = 2**22  #: bytes read at a time, beside what the last message needs
    small: int = 2**21  #: bytes up to which plain Python is done before compiled code is loaded
    rows: int = 2**17  #: rows listed before they are copied


LIMITS: Final = Limits()


def read_ulog(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .ulg file.

    Parameters
    ----------
    path : the file
    topics : names of the topics to keep, all instances of each; None means all

    Returns
    -------
    Recording : with the parameters at the start, and as `info` firmware and hardware, texts for the pilot
        ("messages"), "parameter changes", "parameter defaults, system" and "..., airframe"

    Raises
    ------
    LogError
        When it is no ULog file, or so damaged that no topic can be read.
    """
    try:
        with path.open("rb") as file:
            size = checked_size(path, file, LIMITS.size)
            if file.read(len(MAGIC)) != MAGIC:
                raise LogError(
                    f"{path}: not a ULog file, its first bytes are wrong; copy it again from the autopilot"
                )
            found = scan(file, size, topics)
    except OSError as error:
        raise unreadable(path, error) from None
    except BodyError as error:
        raise LogError(
            f"{path}: cannot be read, {error}; update stoop or convert the log with ulog2csv"
        ) from None
    except MemoryError:
        raise LogError(
            f"{path}: the topics wanted need more memory than is free, or than {LIMITS.memory >> 30} GiB; "
            "cut the log to the flight of interest"
        ) from None
    streams, skipped = _streams(path, found)
    if not streams:
        if found.streams or not found.topics or topics is None:
            first = next((f" ({defect})" for defect in (*_file_defects(path, found), *skipped)), "")
            raise LogError(
                f"{path}: no topic holds data{first}; the log was cut before the first sample, record again"
            )
        raise LogError(
            f"{path}: the log holds none of the topics wanted, but {listed(sorted(found.topics), 12)}; "
            "log others, or map these"
        )
    defects = (*_file_defects(path, found), *skipped)
    unread: dict[str, tuple[str, ...]] = dict.fromkeys(sorted(found.unread), ())
    parameters, info = found.metadata.initial, found.metadata.texts()
    return Recording(path, "ulog", streams, defects, parameters=parameters, info=info, unread=unread)


def _streams(path: Path, found: Scanner) -> tuple[dict[str, Stream], list[Defect]]:
    streams: dict[str, Stream] = {}
    defects: list[Defect] = []
    fields = 0
    for rows in sorted((r for r in found.streams if r.count), key=lambda r: (r.topic, r.instance)):
        name = f"{rows.topic}/{rows.instance}" if rows.instance else rows.topic
        if fields > LIMITS.columns:
            message = f"more than {LIMITS.columns} columns: {name} and others not read"
            defects.append(Defect("skipped", path.name, message))
            break
        try:
            table = rows.content[: rows.count * rows.width].view(found.formats.row(rows.topic))
            names = [key for key in table.dtype.names or () if not key.rpartition(".")[2].startswith(PADDING)]
            if "timestamp" not in names:
                raise BodyError("no field 'timestamp'")
        except BodyError as error:
            fields += rows.width  # the columns of an unusable topic were built too
            defects.append(Defect("skipped", name, str(error)))
            continue
        time = table["timestamp"].astype(np.float64)
        time *= MICROSECOND
        fields += len(names) - 1
        add_stream(streams, defects, name, time, {key: table[key] for key in names if key != "timestamp"})
    return streams, defects


def _file_defects(path: Path, found: Scanner) -> Iterator[Defect]:
    """List what is wrong with the file, each with its place."""
    at, counts = f"{path.name}, byte", found.counts.tolist()
    for begin, end in found.damages:
        yield Defect("corrupt", f"{at} {begin}", f"{end - begin} damaged bytes were skipped")
    more = found.damaged - len(found.damages)
    if more:
        yield Defect("corrupt", path.name, f"damaged bytes were skipped in {more} more places")
    if found.ended >= 0:
        yield Defect("corrupt", f"{at} {found.ended}", "too much damage; the rest was not read")
    if found.cut >= 0:
        yield Defect("truncated", f"{at} {found.cut}", "the last message is cut; the rest was read")
    for place, why in found.unusable:
        yield Defect("skipped", f"{at} {place}", f"a message was skipped: {why}")
    if count := counts[ulog_walk.UNKNOWN_TOPICS]:
        message = f"{count} rows skipped of topics that the log does not define"
        yield Defect("corrupt", f"{at} {counts[ulog_walk.UNKNOWN_TOPICS + 1]}", message)
    if count := counts[ulog_walk.UNKNOWN_KINDS]:
        place = counts[ulog_walk.UNKNOWN_KINDS + 1]
        yield Defect("skipped", f"{at} {place}", f"{count} messages of unknown kinds")
    if found.silenced:
        message = f"too many messages of kind {found.silenced}; not all were read"
        yield Defect("skipped", path.name, message)
    if count := counts[ulog_walk.DROPOUTS]:
        lost = 1e-3 * counts[ulog_walk.LOST_MS]
        message = f"the logger reports {count} dropouts, {lost:.2f} s in all"
        yield Defect("dropout", path.name, message)


@dataclass(eq=False)
class Rows:
    """The rows of a stream, in one piece of memory, whose last part takes none until it is filled."""

    topic: str
    instance: int
    width: int  #: bytes of a row
    count: int = 0  #: rows
    #: of the rows, and room behind
    content: Bytes = field(default_factory=lambda: np.empty(0, dtype=np.uint8))

    def append(self, rows: Bytes, share: float) -> None:
        """Add whole rows, after such a share of the file."""
        end = self.count * self.width
        if end + rows.size > self.content.size:
            growth = min(max(1.05 / share, 1.5), 16.0)  # enough for the whole file at this density of rows
            grown = np.empty(int(growth * (end + rows.size)), dtype=np.uint8)
            grown[:end] = self.content[:end]
            self.content = grown
        self.content[end : end + rows.size] = rows
        self.count += rows.size // self.width


def scan(file: BinaryIO, size: int, topics: frozenset[str] | None) -> Scanner:
    """Read a ULog once.

    Parameters
    ----------
    file : a ULog by its magic
    size : bytes
    topics : whose rows are kept; None means all

    Raises
    ------
    BodyError
        When the file states that it needs a newer reader.
    MemoryError
        When more than `Limits.memory` bytes would have to be kept.
    """
    file.seek(_START)
    head = file.read(_FLAGS)
    scanner = Scanner(file, size, topics)
    offsets: list[int] = []  # where data were appended, by the message of flags, if there is one
    if len(head) == _FLAGS and head[2:3] == b"B" and int.from_bytes(head[:2], "little") >= 40:
        incompatible = head[11:19]
        if incompatible[0] & ~1 or any(incompatible[1:]):
            raise BodyError("it is of a newer kind, which this reader does not know")
        if incompatible[0]:
            offsets = [x for x in struct.unpack_from("<3Q", head, 19) if x]
    if not all(a < b for a, b in pairwise((_START, *offsets, size))) and offsets:
        offsets = []
        scanner.unusable.append((_START, "the places of appended data lie outside the file"))
    for begin, end in pairwise((_START, *offsets, size)):
        if scanner.ended < 0:
            scanner.read_section(begin, end)
    return scanner


@dataclass(eq=False)
class Scanner:
    """Reads a file piece by piece."""

    file: BinaryIO
    size: int  #: bytes of the file
    wanted: frozenset[str] | None  #: topics whose rows are kept; None means all
    formats: Formats = field(default_factory=Formats)
    metadata: Metadata = field(default_factory=Metadata)
    topics: set[str] = field(default_factory=set)  #: names of all topics, wanted or not
    streams: list[Rows] = field(default_factory=list)  #: rows of those wanted, by topic and instance
    unread: set[str] = field(default_factory=set)  #: topics, with instance, whose rows are not kept
    #: begin and end of bytes that belong to no message; the first of the `damaged` ones
    damages: list[tuple[int, int]] = field(default_factory=list)
    damaged: int = 0
    #: place of a message that could not be used, and why; the first ones
    unusable: list[tuple[int, str]] = field(default_factory=list)
    silenced: str = ""  #: kinds of messages of which there are too many
    cut: int = -1  #: where the last message begins, if it is cut
    ended: int = -1  #: where reading ended for too much damage

    def __post_init__(self) -> None:
        """Make the buffers, and choose the code that walks over them."""
        size = self.size
        self.counts = np.zeros(ulog_walk.COUNTS, dtype=np.int64)  # see `stoop.logs.ulog_walk`
        self._started, self._time, self._kept = False, 0.0, 0
        self._events: Counter[int] = Counter()
        self._numbers: dict[tuple[str, int], int] = {}
        # plain Python is faster on memory views than on arrays
        self._code: Any = ulog_walk
        self._view: Callable[[Any], Any] = memoryview
        if size > LIMITS.small:
            from stoop.logs.compiled import ulog

            self._code, self._view = ulog(), np.asarray
        view: Callable[[Any], Any] = self._view
        self._buffer = np.empty(min(size, LIMITS.piece) + ulog_walk.LOOKAHEAD, dtype=np.uint8)
        self._arena = np.empty_like(self._buffer)
        self._owners = np.zeros(min(size // 5 + 1, LIMITS.rows), dtype=np.int32)
        self._bytes, self._out, self._owner_view = view(self._buffer), view(self._arena), view(self._owners)
        self._places = view(np.zeros(self._owners.size, dtype=np.int64))
        self._low, self._high, self._slots = (view(np.zeros(2**16, dtype=np.int32)) for _ in range(3))
        self._counts = view(self.counts)
        handled = np.zeros(256, dtype=np.uint8)
        handled[list(_HANDLED)] = 1
        self._handled = view(handled)

    def read_section(self, begin: int, end: int) -> None:
        """Read from one place of the file to another, where the next section begins or the file ends."""
        self.file.seek(begin)
        self._offset, self._at, self._have, self._lost = begin, 0, 0, -1
        self.cut = -1
        final = False
        while not final and self.ended < 0:
            # move the rest to the front and read on behind it
            rest = self._have - self._at
            self._buffer[:rest] = self._buffer[self._at : self._have].copy()
            self._offset, self._at = self._offset + self._at, 0
            asked = min(self._buffer.size - rest, end - self._offset - rest)
            got = self.file.readinto(memoryview(self._buffer)[rest : rest + asked])  # type: ignore[attr-defined, arg-type]
            self._have = rest + got
            final = bool(got < asked or self._offset + self._have >= end)
            self._read_piece(final)

    def _read_piece(self, final: bool) -> None:
        listed, why = 0, ulog_walk.EVENT
        while why not in (ulog_walk.DONE, ulog_walk.MORE) and self.ended < 0:
            if self._lost >= 0 and not self._resume(final):
                break
            self._at, listed, why = self._code.walk(
                self._bytes, self._at, self._have, final, self._offset, self._handled, self._low, self._high,
                self._slots, self._places, self._owner_view, listed, self._counts,
            )  # fmt: skip
            if why == ulog_walk.FULL:
                self._copy(listed)
                listed = 0
            elif why == ulog_walk.EVENT:
                self._handle_message(listed)
            elif why in (ulog_walk.DAMAGE, ulog_walk.CUT):
                self._lost = self._offset + self._at
                self.cut = self._lost if why == ulog_walk.CUT else -1
                self._at = min(self._at + 1, self._have)
        self._copy(listed)

    def _resume(self, final: bool) -> bool:
        """Seek where messages go on after damage; return whether that is in this piece."""
        stop = self._have if final else max(self._at, self._have - ulog_walk.LOOKAHEAD)
        self._at = self._code.seek(self._bytes, self._at, stop, self._have, self._low, self._high)
        if self._at >= stop and not final:
            return False
        if self._at < stop or self.cut < 0:
            self.damaged += 1
            self.cut = -1
            end = self._offset + self._at
            if len(self.damages) < LIMITS.listed:
                self.damages.append((self._lost, end))
            if self.damaged > LIMITS.damages:
                self.ended = end
        self._lost = -1
        return self._at < stop

    def _copy(self, listed: int) -> None:
        """Copy the listed rows to their streams."""
        if not listed:
            return
        self._advance_time(listed)
        widths = np.array([stream.width for stream in self.streams], dtype=np.int64)
        sizes = np.bincount(self._owners[:listed], minlength=widths.size) * widths
        ends = np.cumsum(sizes)
        self._kept += int(ends[-1])
        if self._kept > LIMITS.memory:
            raise MemoryError
        share = (self._offset + self._have) / self.size
        to = self._view(widths), self._view(ends - sizes), self._out
        self._code.gather(self._bytes, self._places, self._owner_view, listed, *to)
        for k in np.flatnonzero(sizes):
            self.streams[k].append(self._arena[ends[k] - sizes[k] : ends[k]], share)

    def _advance_time(self, listed: int) -> None:
        """Advance to the time [s] of the last listed row, where its topic begins with it, as all of PX4's do."""
        place = int(self._places[listed - 1])
        stamp = int.from_bytes(self._buffer[place : place + 8].tobytes(), "little")
        self._time = max(self._time, 1e-6 * stamp)

    def _handle_message(self, listed: int) -> None:
        """Handle the message at hand, which is no row, and go past it."""
        size = int(self._bytes[self._at]) | int(self._bytes[self._at + 1]) << 8
        number = int(self._bytes[self._at + 2])
        begin, kind = self._at + ulog_walk.HEADER, chr(number)
        body = self._buffer[begin : begin + size].tobytes()
        if kind == "P" and self._started and listed:
            self._advance_time(listed)
        try:
            if kind == "F":
                self.formats.add(body)
            elif kind == "A":
                self._started = True
                self._add_topic(body)
            elif kind == "R":
                self._high[int.from_bytes(body, "little")] = 0
            else:
                self._started |= kind in "LC"
                self.metadata.add(kind, body, self._time, self._started)
        except BodyError as error:
            if len(self.unusable) < LIMITS.listed:
                self.unusable.append((self._offset + self._at, str(error)))
        self._at = begin + size
        self._events[number] += 1
        if self._events[number] >= LIMITS.events:
            self._handled[number] = 0
            self.silenced += kind

    def _add_topic(self, body: bytes) -> None:
        """Add a topic: the size of its rows, and the stream to which they belong, if it is wanted."""
        instance, number = struct.unpack_from("<BH", body)
        name = decoded(body[3:])
        self._high[number] = 0
        kept, whole = self.formats.sizes(name)
        self._low[number], self._high[number] = kept, whole
        self.topics.add(name)
        self._slots[number] = -1
        if self.wanted is not None and name not in self.wanted:
            if len(self.unread) < LIMITS.streams:
                self.unread.add(f"{name}/{instance}" if instance else name)
            return
        known = self._numbers.get((name, instance), len(self.streams))
        if known == LIMITS.streams:
            raise BodyError(f"there are more than {LIMITS.streams} topics")
        if known == len(self.streams):
            self._numbers[name, instance] = known
            self.streams.append(Rows(name, instance, kept))
        self._slots[number] = known
