"""Numbers out of serialized ROS messages: a definition becomes a plan, and the plan walks over the bytes.

The definitions that a bag carries are data here and stay data: no code is generated from them. Nested fields get dotted names,
elements of arrays an index. Left out are texts, covariances, and arrays of more than `MAX_WIDTH` numbers, such as images.

References
----------
.. [1] ROS 1 serialization: fields follow each other, little-endian, texts and lists behind a uint32 length.
.. [2] ROS 2 serialization: OMG CDR version 1; each number is aligned to its size, counted from behind the head of 4 bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

FieldDefinitions: TypeAlias = Mapping[
    str, tuple[Any, Any]
]  #: type -> (constants, fields), as rosbags parses them

BASE, NAME, ARRAY, LIST = 1, 2, 3, 4  #: rosbags' Nodetype
CODES: Final = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
SIZES: Final = {code: struct.calcsize("<" + code) for code in CODES.values()}
MAX_WIDTH: Final = 64  #: numbers of an array that become columns
MAX_PARTS: Final = 20_000  #: of a plan
MAX_DEPTH: Final = 16


class UnreadableError(Exception):
    """A message, or its definition, that cannot be read; says why."""


@dataclass(frozen=True)
class Number:
    """One number; without a name it is passed over."""

    name: str
    code: str


@dataclass(frozen=True)
class Text:
    """A text, passed over."""


@dataclass(frozen=True)
class Many:
    """A list whose length stands before it: of numbers, or of anything that is passed over."""

    name: str
    code: str
    inner: tuple[Part, ...] = field(default=())


Part: TypeAlias = Number | Text | Many


def plan(kind: str, definitions: FieldDefinitions) -> tuple[Part, ...]:
    """Return what follows what in a message of a type.

    Raises
    ------
    UnreadableError
        When a definition is missing, holds itself, or is endless.
    """
    parts: list[Part] = []
    _unfold((NAME, kind), "", definitions, parts, 0, True)
    return tuple(parts)


def _unfold(
    what: Any, name: str, definitions: FieldDefinitions, parts: list[Part], depth: int, shown: bool
) -> None:
    if depth > MAX_DEPTH or len(parts) > MAX_PARTS:
        raise UnreadableError("its definition is endless")
    node, detail = int(what[0]), what[1]
    if node == BASE:
        parts.append(_base(detail[0], name if shown else ""))
    elif node == NAME:
        if detail not in definitions:
            raise UnreadableError(f"the bag does not define {detail}")
        for inner, kind in definitions[detail][1]:
            below = f"{name}.{inner}" if name else inner
            _unfold(kind, below, definitions, parts, depth + 1, shown and not inner.endswith("covariance"))
    elif node == ARRAY:
        element, count = detail
        if count > MAX_PARTS:
            raise UnreadableError(f"it holds an array of {count}")
        for i in range(count):
            _unfold(element, f"{name}[{i}]", definitions, parts, depth + 1, shown and count <= MAX_WIDTH)
    else:
        parts.append(_list(detail[0], name if shown else "", definitions, depth))


def _base(kind: str, name: str) -> Part:
    if kind == "string":
        return Text()
    if kind not in CODES:
        raise UnreadableError(f"it holds a {kind}")
    return Number(name, CODES[kind])


def _list(element: Any, name: str, definitions: FieldDefinitions, depth: int) -> Many:
    if int(element[0]) == BASE and element[1][0] in CODES:
        return Many(name, CODES[element[1][0]])
    inner: list[Part] = []
    _unfold(element, "", definitions, inner, depth + 1, False)
    return Many("", "", tuple(inner))


class Walker:
    """Reads messages of one plan.

    Parameters
    ----------
    parts : of the plan
    aligned : whether numbers are aligned to their size (ROS 2)
    """

    def __init__(self, parts: tuple[Part, ...], aligned: bool) -> None:
        self._parts = parts
        self._aligned = aligned

    def numbers(self, raw: bytes) -> dict[str, float]:
        """Return the numbers of a message by their names.

        Raises
        ------
        UnreadableError
            When the message is shorter than its definition says.
        """
        found: dict[str, float] = {}
        order, body = "<", raw
        if self._aligned:
            if len(raw) < 4 or raw[1] > 1:
                raise UnreadableError("its encoding is unknown")
            order, body = ("<" if raw[1] else ">"), raw[4:]
        try:
            self._walk(self._parts, body, 0, order, found)
        except struct.error:
            raise UnreadableError("it is shorter than its definition says") from None
        return found

    def _walk(self, parts: tuple[Part, ...], raw: bytes, at: int, order: str, found: dict[str, float]) -> int:
        for part in parts:
            if isinstance(part, Number):
                at = self._align(at, SIZES[part.code])
                (value,) = struct.unpack_from(order + part.code, raw, at)
                if part.name:
                    found[part.name] = float(value)
                at += SIZES[part.code]
            else:
                at = self._align(at, 4)
                (count,) = struct.unpack_from(order + "I", raw, at)
                if count > len(raw) - at - 4:
                    raise UnreadableError("it is shorter than its definition says")
                at = self._many(part, raw, at + 4, order, found, count)
        return at

    def _many(
        self, part: Text | Many, raw: bytes, at: int, order: str, found: dict[str, float], count: int
    ) -> int:
        if isinstance(part, Text):
            return at + int(count)
        if not part.code:
            for _ in range(count if part.inner else 0):  # each turn takes a byte at least
                at = self._walk(part.inner, raw, at, order, {})
            return at
        at = self._align(at, SIZES[part.code]) if count else at
        if part.name and 0 < count <= MAX_WIDTH:
            values = struct.unpack_from(f"{order}{count}{part.code}", raw, at)
            found.update({f"{part.name}[{i}]": float(value) for i, value in enumerate(values)})
        return at + int(count) * SIZES[part.code]

    def _align(self, at: int, size: int) -> int:
        return -(-at // size) * size if self._aligned else at
