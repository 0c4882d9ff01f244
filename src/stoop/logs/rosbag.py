"""ROS bags, 1 (.bag) and 2 (.db3, .mcap, folders), through the library rosbags, in a child process (`stoop.logs.guard`).

The library finds the messages; they are decoded here, by the definitions that the bag carries: a definition becomes a list of
parts, and a walk over the bytes of a message reads them. The definitions stay data: no code is generated from them. Nested
fields get dotted names, elements of arrays an index. Texts, covariances, and arrays of more than `MAX_WIDTH` numbers, such as
images, are left out. Each topic is a stream of its name. The time is header.stamp where there is one, else the time of
recording; both are counted from the beginning of the bag.

References
----------
.. [1] ROS 1 serialization: fields follow each other, little-endian, texts and lists behind a uint32 length.
.. [2] ROS 2 serialization: OMG CDR version 1; each number is aligned to its size, counted from behind the head of 4 bytes.
.. [3] REP 103, Standard Units of Measure and Coordinate Conventions: bodies are forward-left-up, the world east-north-up.
"""

from __future__ import annotations

import math
import struct
from array import array
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import LogError
from stoop.logs.arrays import max_values
from stoop.logs.netcdf import MAX_DEPTH
from stoop.logs.recording import Defect, Recording, Stream, add_stream, nothing_read, reason

#: type -> (constants, fields), as rosbags parses them
FieldDefinitions: TypeAlias = Mapping[str, tuple[Any, Any]]

BASE, NAME, ARRAY, LIST = 1, 2, 3, 4  #: rosbags' Nodetype
CODES: Final = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
SIZES: Final = {code: struct.calcsize("<" + code) for code in CODES.values()}
MAX_WIDTH: Final = 64  #: numbers of an array that become columns
MAX_PARTS: Final = 20_000  #: of a definition
NANOSECOND: Final = 1e-9  #: s
STAMP: Final = ("header.stamp.sec", "header.stamp.nanosec")


class UnreadableError(Exception):
    """A message, or its definition, that cannot be read, and why."""


@dataclass(frozen=True)
class Part:
    """One part of a message."""

    name: str  #: of its column; empty where it is skipped
    code: str  #: of its numbers, see `struct`; empty for a text, or for a list of `inner` parts
    many: bool = False  #: whether a uint32 count stands before it
    inner: tuple[Part, ...] = ()  #: parts of each element of a list


def message_parts(kind: str, definitions: FieldDefinitions) -> tuple[Part, ...]:
    """Return the parts of a message of a type, in their order.

    Raises
    ------
    UnreadableError
        When a definition is missing, contains itself, or is endless.
    """
    parts: list[Part] = []
    _unfold((NAME, kind), "", definitions, parts, 0, True)
    return tuple(parts)


def _unfold(
    node: Any, name: str, definitions: FieldDefinitions, parts: list[Part], depth: int, kept: bool
) -> None:
    if depth > MAX_DEPTH or len(parts) > MAX_PARTS:
        raise UnreadableError("its definition is endless")
    kind, detail = int(node[0]), node[1]
    if kind == BASE:
        if detail[0] not in (*CODES, "string"):
            raise UnreadableError(f"it holds a {detail[0]}")
        code = CODES.get(detail[0], "")
        parts.append(Part(name if kept and code else "", code, many=not code))
    elif kind == NAME:
        if detail not in definitions:
            raise UnreadableError(f"the bag does not define {detail}")
        for inner, element in definitions[detail][1]:
            column = f"{name}.{inner}" if name else inner
            wanted = kept and not inner.endswith("covariance")
            _unfold(element, column, definitions, parts, depth + 1, wanted)
    elif kind == ARRAY:
        element, count = detail
        if count > MAX_PARTS:
            raise UnreadableError(f"it holds an array of {count}")
        for i in range(count):
            _unfold(element, f"{name}[{i}]", definitions, parts, depth + 1, kept and count <= MAX_WIDTH)
    elif int(detail[0][0]) == BASE and detail[0][1][0] in CODES:
        parts.append(Part(name if kept else "", CODES[detail[0][1][0]], many=True))
    else:
        elements: list[Part] = []
        _unfold(detail[0], "", definitions, elements, depth + 1, False)
        parts.append(Part("", "", many=True, inner=tuple(elements) or (_NOTHING,)))


_NOTHING: Final = Part("", "")  #: an element without content


@dataclass(frozen=True)
class Decoder:
    """Decodes messages of one type."""

    parts: tuple[Part, ...]  #: of a message
    aligned: bool  #: whether numbers are aligned to their size (ROS 2)

    def numbers(self, raw: bytes) -> dict[str, float]:
        """Return the numbers of a message by their names.

        Raises
        ------
        UnreadableError
            When the message is shorter than its definition says.
        """
        found: dict[str, float] = {}
        order, body = "<", raw
        if self.aligned:
            if len(raw) < 4 or raw[1] > 1:
                raise UnreadableError("its encoding is unknown")
            order, body = ("<" if raw[1] else ">"), raw[4:]
        try:
            self._walk(self.parts, body, 0, order, found)
        except struct.error:
            raise UnreadableError("it is shorter than its definition says") from None
        return found

    def _walk(self, parts: tuple[Part, ...], raw: bytes, at: int, order: str, found: dict[str, float]) -> int:
        for part in parts:
            if part.many:
                at = self._walk_many(part, raw, self._align(at, 4), order, found)
            elif part.code:
                at = self._align(at, SIZES[part.code])
                (value,) = struct.unpack_from(order + part.code, raw, at)
                if part.name:
                    found[part.name] = float(value)
                at += SIZES[part.code]
        return at

    def _walk_many(self, part: Part, raw: bytes, at: int, order: str, found: dict[str, float]) -> int:
        (count,) = struct.unpack_from(order + "I", raw, at)
        at += 4
        if count > len(raw) - at:
            raise UnreadableError("it is shorter than its definition says")
        if part.inner:
            for _ in range(0 if part.inner == (_NOTHING,) else count):  # each element takes a byte at least
                at = self._walk(part.inner, raw, at, order, {})
            return at
        if not part.code:
            return at + int(count)
        at = self._align(at, SIZES[part.code]) if count else at
        if part.name and 0 < count <= MAX_WIDTH:
            values = struct.unpack_from(f"{order}{count}{part.code}", raw, at)
            found.update({f"{part.name}[{i}]": float(value) for i, value in enumerate(values)})
        return at + int(count) * SIZES[part.code]

    def _align(self, at: int, size: int) -> int:
        return -(-at // size) * size if self.aligned else at


@dataclass
class _Topic:
    """Messages of a topic: times of recording [ns], columns of numbers, count of messages that cannot be decoded."""

    kind: str
    decoder: Decoder
    recorded: array[int] = field(default_factory=lambda: array("q"))
    columns: dict[str, array[float]] = field(default_factory=dict)
    undecoded: int = 0

    def append(self, stamp: int, raw: bytes) -> int:
        """Append a message; the first one sets the columns. Returns how many numbers were added."""
        try:
            numbers = self.decoder.numbers(raw)
        except UnreadableError:
            self.undecoded += 1
            return 0
        if not self.recorded:
            self.columns = {name: array("d") for name in numbers}
        self.recorded.append(stamp)
        for name, column in self.columns.items():
            column.append(numbers.get(name, math.nan))
        return len(self.columns) + 1

    def add(self, streams: dict[str, Stream], defects: list[Defect], name: str, start: int) -> None:
        """Add the stream; its time [s] counts from the beginning of the bag, by the messages' stamps if usable."""
        if self.undecoded:
            message = f"{self.undecoded} messages skipped: they do not match their definition"
            defects.append(Defect("corrupt", name, message))
        columns = {key: np.frombuffer(column) for key, column in self.columns.items() if key not in STAMP}
        if not columns:
            return
        time: FloatArray = (np.frombuffer(self.recorded, np.int64) - start).astype(np.float64) * NANOSECOND
        if all(key in self.columns for key in STAMP):
            seconds, nanoseconds = (np.frombuffer(self.columns[key]) for key in STAMP)
            stamped = (seconds - start // 10**9) + (nanoseconds - start % 10**9) * NANOSECOND
            if abs(float(np.median(stamped - time))) < 1e6:  # s; farther apart they are of different clocks
                time = stamped
            else:
                message = "header.stamp is empty or of another clock; the time of recording is used"
                defects.append(Defect("time order", name, message))
        add_stream(streams, defects, name, time, columns)


def parse_rosbag(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a bag, a file or the folder of a ROS 2 bag, in this process; its library may crash, loop or raise anything.

    Raises
    ------
    LogError
        When it holds no numbers, or more than its size allows.
    """
    with _open(path) as (reader, second):
        # a caller that strips instances from names may have left nothing of "/imu"
        every = reader.connections
        wanted = [c for c in every if topics is None or {c.topic, c.topic.partition("/")[0]} & topics]
        unwanted = sorted({c.topic for c in every if c not in wanted})
        definitions, source = _definitions(wanted)
        known, defects = _topics(wanted, definitions, second)
        start = int(reader.start_time)
        kept = [c for c in wanted if c.topic in known and known[c.topic].kind == c.msgtype]
        defects += _append_messages(path, reader, kept, known)
    streams: dict[str, Stream] = {}
    for name, topic in known.items():
        topic.add(streams, defects, name, start)
    if not streams:
        raise nothing_read(path, "no topic holds numbers", defects, "name a bag with sensor messages")
    info = {"definitions": source, "body frame": "flu", "world frame": "enu"}
    info["start"] = f"{start * NANOSECOND:.3f} s after 1970"
    unread: dict[str, tuple[str, ...]] = dict.fromkeys(unwanted, ())
    return Recording(path, "rosbag", streams, tuple(defects), info=info, unread=unread)


@contextmanager
def _open(path: Path) -> Iterator[tuple[Any, bool]]:
    """Open a bag; return the library's reader and whether it is of ROS 2."""
    first = path.suffix.lower() == ".bag"
    if not first and path.is_file():
        with path.open("rb") as file:
            first = file.read(9) == b"#ROSBAG V"
    if first:
        from rosbags.rosbag1 import Reader as Reader1

        with Reader1(path) as reader:
            yield reader, False
    else:
        from rosbags.rosbag2 import Reader as Reader2

        with Reader2(path) as reader:
            yield reader, True


def _definitions(connections: list[Any]) -> tuple[FieldDefinitions, str]:
    """Return the definitions in a bag, and those of a common ROS 2 for what it does not define; and their source."""
    from rosbags.interfaces import MessageDefinitionFormat as Form
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    stated = any(c.msgdef.format == Form.MSG for c in connections)
    bare = any(c.msgdef.format == Form.NONE for c in connections)
    found: dict[str, Any] = dict(get_typestore(Stores.ROS2_HUMBLE if bare else Stores.EMPTY).fielddefs)
    line = "=" * 80 + "\n"
    for connection in connections:
        text = connection.msgdef.data
        if connection.msgdef.format == Form.MSG:
            found |= get_types_from_msg(text, connection.msgtype)
        elif connection.msgdef.format == Form.IDL:
            for part in text.split(line) if text.startswith(f"{line}IDL: ") else [text]:
                found |= get_types_from_idl(part.split("\n", 1)[1] if part.startswith("IDL: ") else part)
    return found, "of ROS 2 Humble: the bag has none" if bare and not stated else "of the bag"


def _topics(
    connections: list[Any], definitions: FieldDefinitions, aligned: bool
) -> tuple[dict[str, _Topic], list[Defect]]:
    """Prepare a decoder for each topic; one of which a part cannot be read is left out."""
    topics: dict[str, _Topic] = {}
    defects = []
    for connection in connections:
        try:
            decoder = Decoder(message_parts(connection.msgtype, definitions), aligned)
            topic = topics.setdefault(connection.topic, _Topic(connection.msgtype, decoder))
            if topic.kind != connection.msgtype:
                raise UnreadableError(f"the topic is of {topic.kind} too")
        except UnreadableError as error:
            what = f"messages of type {connection.msgtype} skipped: {error}"
            defects.append(Defect("skipped", connection.topic, what))
    return topics, defects


def _append_messages(
    path: Path, reader: Any, connections: list[Any], topics: dict[str, _Topic]
) -> list[Defect]:
    """Decode all messages; where the bag breaks, what stands before is kept."""
    count, most = 0, max_values(path)
    try:
        for connection, stamp, raw in reader.messages(connections=connections) if connections else ():
            count += topics[connection.topic].append(stamp, bytes(raw))
            if count > most:
                raise LogError(
                    f"{path}: more than {most} numbers; name the topics in a mapping, or cut the bag"
                )
    except (LogError, MemoryError):
        raise
    except Exception as error:
        return [Defect("corrupt", path.name, f"reading ended at damage ({reason(error)})")]
    return []
