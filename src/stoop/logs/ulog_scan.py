"""From the bytes of a ULog to the rows of the topics wanted: a piece at a time, so that only those rows are kept."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, BinaryIO, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from stoop.logs.scan import walk as plain
from stoop.logs.ulog_formats import BodyError, Formats, decoded
from stoop.logs.ulog_notes import Notes

START: Final = 16  #: bytes before the first message: magic, version, time
PIECE: Final = 2**22  #: bytes read at a time, beside what the last message needs
SMALL: Final = 2**21  #: bytes up to which plain Python is done before compiled code is loaded
LISTED: Final = 2**17  #: rows listed before they are copied
MOST_EVENTS: Final = 200_000  #: messages of a kind that Python looks at; a log of hours has some thousands
MOST_DAMAGES: Final = 20_000
MOST_STREAMS: Final = 20_000
MAX_KEPT: Final = 2**33  #: bytes of all rows
MARGIN, LEAST_GROWTH, MOST_GROWTH = (
    1.05,
    1.5,
    16.0,
)  #: by which the room for a stream's rows grows when it is full
LOUD: Final = b"AFIMPQRLC"  #: kinds that are more than rows
NAMED: Final = 20  #: defects of a kind that are listed one by one

Bytes: TypeAlias = npt.NDArray[np.uint8]


class TooMuchError(Exception):
    """The rows wanted do not fit into memory."""


class Rows:
    """The rows of a stream, in one piece of memory; its last part is not touched, and so takes none, until it is filled.

    Attributes
    ----------
    topic, instance : whose rows
    width : bytes of a row
    count : rows
    """

    def __init__(self, topic: str, instance: int, width: int) -> None:
        self.topic, self.instance, self.width, self.count = topic, instance, width, 0
        self._bytes = np.empty(0, dtype=np.uint8)

    def append(self, rows: Bytes, share: float) -> None:
        """Add whole rows, after so large a share of the file."""
        end = self.count * self.width
        if end + rows.size > self._bytes.size:
            more = min(
                max(MARGIN / share, LEAST_GROWTH), MOST_GROWTH
            )  # as many as it takes, if it goes on like this
            grown = np.empty(int(more * (end + rows.size)), dtype=np.uint8)
            grown[:end] = self._bytes[:end]
            self._bytes = grown
        self._bytes[end : end + rows.size] = rows
        self.count += rows.size // self.width

    def table(self, row: np.dtype[Any]) -> npt.NDArray[np.void]:
        """Return the rows."""
        return self._bytes[: self.count * self.width].view(row)


@dataclass
class Scan:
    """What was found.

    Attributes
    ----------
    formats, notes : what the log says about itself
    topics : names of all topics, wanted or not
    streams : rows of those wanted, by topic and instance
    unwanted : topics, with instance, whose rows were passed over
    damages : first and last place of bytes that belong to no message; the first `NAMED` of `damaged`
    unusable : place of a message that could not be used, and why; the first `NAMED` of them
    silenced : kinds of messages of which there were too many
    cut : where the last message begins, if it is cut, else -1
    ended : where reading was given up for too much damage, else -1
    sums : see `stoop.logs.scan.walk`
    """

    formats: Formats = field(default_factory=Formats)
    notes: Notes = field(default_factory=Notes)
    topics: set[str] = field(default_factory=set)
    streams: list[Rows] = field(default_factory=list)
    unwanted: set[str] = field(default_factory=set)
    damages: list[tuple[int, int]] = field(default_factory=list)
    damaged: int = 0
    unusable: list[tuple[int, str]] = field(default_factory=list)
    silenced: str = ""
    cut: int = -1
    ended: int = -1
    sums: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(plain.SUMS, dtype=np.int64))


def scan(file: BinaryIO, size: int, topics: frozenset[str] | None) -> Scan:
    """Go through a ULog once.

    Parameters
    ----------
    file : at its beginning, of which the magic was looked at
    size : bytes
    topics : whose rows are kept; None means all

    Raises
    ------
    BodyError
        When the file says that it cannot be read without knowing more than this reader does.
    TooMuchError
        When more than `MAX_KEPT` bytes would have to be kept.
    """
    file.seek(START)
    offsets, misplaced = _appended(file.read(plain.HEADER + 40), size)
    scanner = _Scanner(file, size, topics)
    if misplaced:
        scanner.found.unusable.append((START, "the places of appended data lie outside the file"))
    begins = (START, *offsets)
    for begin, end in zip(begins, (*offsets, size), strict=True):
        if scanner.found.ended < 0:
            scanner.section(begin, end)
    return scanner.found


def _appended(head: bytes, size: int) -> tuple[tuple[int, ...], bool]:
    """Read the flags, if the file has any: where data were appended, and whether those places can be true."""
    if len(head) < plain.HEADER + 40 or head[2:3] != b"B" or int.from_bytes(head[:2], "little") < 40:
        return (), False
    incompatible = head[11:19]
    if incompatible[0] & ~1 or any(incompatible[1:]):
        raise BodyError("it is of a newer kind, which this reader does not know")
    given = [x for x in struct.unpack_from("<3Q", head, 19) if x]
    rising = all(a < b for a, b in pairwise((START, *given, size)))
    if not incompatible[0]:
        return (), False
    return (tuple(given), False) if rising else ((), True)


class _Scanner:
    """The state of going through a file: the piece of it at hand, and what is known of its topics."""

    def __init__(self, file: BinaryIO, size: int, topics: frozenset[str] | None) -> None:
        self.found = Scan()
        self._file, self._size, self._topics = file, size, topics
        self._started, self._time, self._kept = False, 0.0, 0
        self._events: Counter[int] = Counter()
        self._streams: dict[tuple[str, int], int] = {}
        self._arrays(size)
        if size <= SMALL:
            self._code: Any = plain  # a small file is read before Numba is loaded
        else:
            from stoop.logs.scan.compiled import ulog

            self._code = ulog()

    def _arrays(self, size: int) -> None:
        view: Callable[[Any], Any] = memoryview if size <= SMALL else _same
        self._buffer = np.empty(min(size, PIECE) + plain.LOOKAHEAD, dtype=np.uint8)
        self._arena = np.empty_like(self._buffer)
        self._owners = np.zeros(min(size // 5 + 1, LISTED), dtype=np.int32)
        self._bytes, self._out, self._owner = view(self._buffer), view(self._arena), view(self._owners)
        self._places = view(np.zeros(self._owners.size, dtype=np.int64))
        self._low, self._high, self._slots = (view(np.zeros(2**16, dtype=np.int32)) for _ in range(3))
        self._sums = view(self.found.sums)
        loud = np.zeros(256, dtype=np.uint8)
        loud[list(LOUD)] = 1
        self._loud = view(loud)
        self._view = view

    def section(self, begin: int, end: int) -> None:
        """Read from one place of the file to another, where the next section begins or the file ends."""
        self._file.seek(begin)
        self._offset, self._at, self._have, self._lost, self._end = begin, 0, 0, -1, end
        self.found.cut = -1
        final = False
        while not final and self.found.ended < 0:
            final = self._refill()
            self._piece(final)

    def _refill(self) -> bool:
        """Move what is left to the front and read on behind it; tell whether the end of the section is there."""
        rest = self._have - self._at
        self._buffer[:rest] = self._buffer[self._at : self._have].copy()
        self._offset, self._at = self._offset + self._at, 0
        asked = min(self._buffer.size - rest, self._end - self._offset - rest)
        got = self._file.readinto(memoryview(self._buffer)[rest : rest + asked])  # type: ignore[attr-defined, arg-type]
        self._have = rest + got
        return bool(got < asked or self._offset + self._have >= self._end)

    def _piece(self, final: bool) -> None:
        count, why = 0, plain.EVENT
        while why not in (plain.DONE, plain.MORE) and self.found.ended < 0:
            if self._lost >= 0 and not self._resumed(final):
                break
            self._at, count, why = self._code.walk(
                self._bytes, self._at, self._have, final, self._offset, self._loud, self._low, self._high,
                self._slots, self._places, self._owner, count, self._sums,
            )  # fmt: skip
            if why == plain.FULL:
                count = self._copy(count)
            elif why == plain.EVENT:
                self._event(count)
            elif why in (plain.DAMAGE, plain.CUT):
                self._lose(why == plain.CUT)
        self._copy(count)

    def _lose(self, cut: bool) -> None:
        """Note where messages end; where they go on is still to be sought."""
        self._lost = self._offset + self._at
        self.found.cut = self._lost if cut else -1
        self._at = min(self._at + 1, self._have)

    def _resumed(self, final: bool) -> bool:
        """Seek where messages go on; tell whether that was found in this piece."""
        stop = self._have if final else max(self._at, self._have - plain.LOOKAHEAD)
        self._at = self._code.seek(self._bytes, self._at, stop, self._have, self._low, self._high)
        if self._at >= stop and not final:
            return False
        if self._at < stop or self.found.cut < 0:
            self._damaged(self._lost, self._offset + self._at)
        self._lost = -1
        return self._at < stop

    def _damaged(self, begin: int, end: int) -> None:
        self.found.damaged += 1
        self.found.cut = -1
        if len(self.found.damages) < NAMED:
            self.found.damages.append((begin, end))
        if self.found.damaged > MOST_DAMAGES:
            self.found.ended = end

    def _copy(self, count: int) -> int:
        """Copy the rows listed to their streams; return how many are listed then."""
        if count:
            self._time = max(self._time, self._stamp(count - 1))
            widths = np.array([stream.width for stream in self.found.streams], dtype=np.int64)
            sizes = np.bincount(self._owners[:count], minlength=widths.size) * widths
            ends = np.cumsum(sizes)
            self._kept += int(ends[-1])
            if self._kept > MAX_KEPT:
                raise TooMuchError
            share = (self._offset + self._have) / self._size
            cursors = ends - sizes
            self._code.gather(
                self._bytes,
                self._places,
                self._owner,
                count,
                self._view(widths),
                self._view(cursors),
                self._out,
            )
            for k in np.flatnonzero(sizes):
                self.found.streams[k].append(self._arena[ends[k] - sizes[k] : ends[k]], share)
        return 0

    def _stamp(self, number: int) -> float:
        """Return the time of a row in the list [s], where its topic begins with it, as all of PX4's do."""
        place = int(self._places[number])
        return 1e-6 * int.from_bytes(self._buffer[place : place + 8].tobytes(), "little")

    def _event(self, count: int) -> None:
        """Handle the message at hand and go past it."""
        size, kind = (
            int(self._bytes[self._at]) | int(self._bytes[self._at + 1]) << 8,
            int(self._bytes[self._at + 2]),
        )
        begin = self._at + plain.HEADER
        body = self._buffer[begin : begin + size].tobytes()
        if kind == ord("P") and self._started and count:
            self._time = max(self._time, self._stamp(count - 1))
        try:
            self._take(chr(kind), body)
        except BodyError as error:
            if len(self.found.unusable) < NAMED:
                self.found.unusable.append((self._offset + self._at, str(error)))
        self._at = begin + size
        self._events[kind] += 1
        if self._events[kind] >= MOST_EVENTS:
            self._loud[kind] = 0
            self.found.silenced += chr(kind)

    def _take(self, kind: str, body: bytes) -> None:
        if kind == "F":
            self.found.formats.add(body)
        elif kind == "A":
            self._started = True
            self._add(body)
        elif kind == "R":
            self._high[int.from_bytes(body, "little")] = 0
        else:
            self._started |= kind in "LC"
            self.found.notes.take(kind, body, self._time, self._started)

    def _add(self, body: bytes) -> None:
        """Add a topic: what its rows look like, and whether they are wanted."""
        instance, number = struct.unpack_from("<BH", body)
        name = decoded(body[3:])
        self._high[number] = 0
        kept, whole = self.found.formats.sizes(name)
        self._low[number], self._high[number] = kept, whole
        self.found.topics.add(name)
        wanted = self._topics is None or name in self._topics
        self._slots[number] = self._stream(name, instance, kept) if wanted else -1
        if not wanted and len(self.found.unwanted) < MOST_STREAMS:
            self.found.unwanted.add(f"{name}/{instance}" if instance else name)

    def _stream(self, name: str, instance: int, width: int) -> int:
        known = self._streams.setdefault((name, instance), len(self.found.streams))
        if known == len(self.found.streams):
            if known >= MOST_STREAMS:
                del self._streams[(name, instance)]
                raise BodyError(f"there are more than {MOST_STREAMS} topics")
            self.found.streams.append(Rows(name, instance, width))
        return known


def _same(array: Any) -> Any:
    return array
