"""ROS bags, 1 (.bag) and 2 (.db3, .mcap, folders), through the library rosbags, in a process of its own.

The library finds the messages; what is in them is read by the definitions that the bag carries (`stoop.logs.ros_layout`). Each
topic is a stream of its name. The time is header.stamp where there is one, else the time of recording; both are counted
from the beginning of the bag. By convention (REP 103) bodies are forward-left-up and the world is east-north-up.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import LogError
from stoop.logs.guard import guarded, need
from stoop.logs.recording import Defect, Recording, Stream, clean_stream
from stoop.logs.ros_layout import FieldDefinitions, UnreadableError, Walker, plan
from stoop.logs.tabular import most_values, typed

STAMP: Final = ("header.stamp.sec", "header.stamp.nanosec")
SAME_CLOCK: Final = 1e6  #: s; stamps farther from the time of recording are of another clock
NANOSECOND: Final = 1e-9  #: s
CONVENTION: Final = {"body frame": "flu", "world frame": "enu"}
_LIBRARY: Final = "ROS 2 Humble"


@dataclass
class _Topic:
    """What is known of a topic while its messages come in."""

    kind: str
    walker: Walker
    recorded: array[int] = field(default_factory=lambda: array("q"))
    columns: dict[str, array[float]] = field(default_factory=dict)
    unread: int = 0

    def take(self, stamp: int, raw: bytes) -> int:
        """Take a message in; the first one says which columns there are. Returns how many numbers were kept."""
        try:
            numbers = self.walker.numbers(raw)
        except UnreadableError:
            self.unread += 1
            return 0
        if not self.recorded:
            self.columns = {name: array("d") for name in numbers}
        self.recorded.append(stamp)
        for name, column in self.columns.items():
            column.append(numbers.get(name, math.nan))
        return len(self.columns) + 1


def read_rosbag(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a bag: a file, or the folder of a ROS 2 bag.

    Raises
    ------
    LogError
        When it is damaged, holds no numbers, or the library is missing.
    """
    need(path, "rosbags", "ros", "ROS bags")
    return guarded("stoop.logs.rosbag:load", path, topics)


def load(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a bag in this very process; see `read_rosbag`."""
    return typed(path, "ROS bag", lambda file: _load(file, topics))


def _load(path: Path, topics: frozenset[str] | None) -> Recording:
    second = path.suffix.lower() != ".bag" and not _is_first(path)
    with _reader(path, second) as reader:
        wanted = [c for c in reader.connections if _is_wanted(c.topic, topics)]
        unwanted = sorted({c.topic for c in reader.connections if c not in wanted})
        definitions, info = _definitions(wanted)
        known, defects = _topics(wanted, definitions, second)
        start = int(reader.start_time)
        kept = [c for c in wanted if c.topic in known and known[c.topic].kind == c.msgtype]
        defects += _fill(path, _messages(reader, kept), known)
    streams: dict[str, Stream] = {}
    for name, topic in known.items():
        stream, met = _stream(name, topic, start)
        defects += met
        if stream is not None and stream.time.size:
            streams[name] = stream
    if not streams:
        reason = f" ({defects[0]})" if defects else ""
        raise LogError(f"{path}: no topic holds numbers{reason}; name a bag with sensor messages")
    info |= CONVENTION | {"start": f"{start * NANOSECOND:.3f} s after 1970"}
    unread: dict[str, tuple[str, ...]] = dict.fromkeys(unwanted, ())
    return Recording(path, "rosbag", streams, tuple(defects), info=info, unread=unread)


def _is_first(path: Path) -> bool:
    if path.is_dir():
        return False
    with path.open("rb") as file:
        return file.read(9) == b"#ROSBAG V"


def _reader(path: Path, second: bool) -> Any:
    if second:
        from rosbags.rosbag2 import Reader as Reader2

        return Reader2(path)
    from rosbags.rosbag1 import Reader as Reader1

    return Reader1(path)


def _is_wanted(topic: str, topics: frozenset[str] | None) -> bool:
    """Tell whether a topic is wanted; who strips instances from names may have left nothing of "/imu"."""
    return topics is None or topic in topics or topic.partition("/")[0] in topics


def _definitions(connections: list[Any]) -> tuple[FieldDefinitions, dict[str, str]]:
    """Return the definitions in a bag, and those of a common ROS 2 for what it does not define."""
    from rosbags.interfaces import MessageDefinitionFormat as Form
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    first = any(c.msgdef.format == Form.MSG for c in connections)
    bare = any(c.msgdef.format == Form.NONE for c in connections)
    found: dict[str, Any] = dict(get_typestore(Stores.ROS2_HUMBLE if bare else Stores.EMPTY).fielddefs)
    for connection in connections:
        if connection.msgdef.format == Form.MSG:
            found |= get_types_from_msg(connection.msgdef.data, connection.msgtype)
        elif connection.msgdef.format == Form.IDL:
            for text in _idl_texts(connection.msgdef.data):
                found |= get_types_from_idl(text)
    told = f"of {_LIBRARY}: the bag has none" if bare and not first else "of the bag"
    return found, {"definitions": told}


def _idl_texts(text: str) -> Iterator[str]:
    line = "=" * 80 + "\n"
    for part in text.split(line) if text.startswith(f"{line}IDL: ") else [text]:
        yield part.split("\n", 1)[1] if part.startswith("IDL: ") else part


def _topics(
    connections: list[Any], definitions: FieldDefinitions, aligned: bool
) -> tuple[dict[str, _Topic], list[Defect]]:
    """Plan each topic; one of which a part cannot be read is left out."""
    topics: dict[str, _Topic] = {}
    defects = []
    for connection in connections:
        try:
            walker = Walker(plan(connection.msgtype, definitions), aligned)
            topic = topics.setdefault(connection.topic, _Topic(connection.msgtype, walker))
            if topic.kind != connection.msgtype:
                raise UnreadableError(f"the topic is of {topic.kind} too")
        except UnreadableError as error:
            what = f"messages of type {connection.msgtype} skipped: {error}"
            defects.append(Defect("skipped", connection.topic, what))
    return topics, defects


def _messages(reader: Any, connections: list[Any]) -> Iterator[tuple[str, int, bytes]]:
    if connections:
        for connection, stamp, raw in reader.messages(connections=connections):
            yield connection.topic, stamp, bytes(raw)


def _fill(path: Path, messages: Iterator[tuple[str, int, bytes]], topics: dict[str, _Topic]) -> list[Defect]:
    """Take all messages in; where the bag breaks, what came before is kept."""
    numbers, most = 0, most_values(path)
    try:
        for topic, stamp, raw in messages:
            numbers += topics[topic].take(stamp, raw)
            if numbers > most:
                raise LogError(
                    f"{path}: more than {most} numbers; name the topics in a mapping, or cut the bag"
                )
    except (LogError, MemoryError):
        raise
    except Exception as error:
        why = " ".join(str(error).split())[:120] or type(error).__name__
        return [Defect("corrupt", path.name, f"reading ended at damage ({why})")]
    return []


def _stream(name: str, topic: _Topic, start: int) -> tuple[Stream | None, tuple[Defect, ...]]:
    defects: tuple[Defect, ...] = ()
    if topic.unread:
        message = f"{topic.unread} messages skipped: they are not as they are defined"
        defects = (Defect("corrupt", name, message),)
    columns = {key: np.frombuffer(column) for key, column in topic.columns.items() if key not in STAMP}
    if not columns:
        return None, defects
    time, odd = _time(name, topic, start)
    stream, met = clean_stream(name, time, columns)
    return stream, (*defects, *odd, *met)


def _time(name: str, topic: _Topic, start: int) -> tuple[FloatArray, tuple[Defect, ...]]:
    """Return seconds from the beginning of the bag, by the stamp in the message where it can be used."""
    recorded: FloatArray = (np.frombuffer(topic.recorded, np.int64) - start).astype(np.float64) * NANOSECOND
    if not all(key in topic.columns for key in STAMP):
        return recorded, ()
    seconds, nanoseconds = (np.frombuffer(topic.columns[key]) for key in STAMP)
    stamped = (seconds - start // 10**9) + (nanoseconds - start % 10**9) * NANOSECOND
    if abs(float(np.median(stamped - recorded))) < SAME_CLOCK:
        return stamped, ()
    why = "header.stamp is empty or of another clock; the time of recording is used"
    return recorded, (Defect("time order", name, why),)
