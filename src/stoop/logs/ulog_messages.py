"""The definitions and texts in a ULog: layouts of rows, information, parameters and messages for the pilot."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final, TypeAlias

import numpy as np

BASIC: Final = {
    "int8_t": "i1", "uint8_t": "u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4", "uint32_t": "<u4",
    "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8", "bool": "i1", "char": "i1",
}  # fmt: skip
SIZES: Final = {name: np.dtype(code).itemsize for name, code in BASIC.items()}
LEVELS: Final = ("EMERGENCY", "ALERT", "CRITICAL", "ERROR", "WARNING", "NOTICE", "INFO", "DEBUG")
MAX_ROW: Final = 65533  #: bytes of data in a message at most
PADDING: Final = "_padding"
Value: TypeAlias = float | int | str | bytes


class BodyError(ValueError):
    """The body of a message does not have the form of its kind."""


@dataclass(frozen=True)
class Field:
    """A field of a format: type, how many of it (0 where it is no array), and name."""

    kind: str
    size: int
    name: str


def decoded(body: bytes, breaks: str = "") -> str:
    """Return a text without control characters, but with the line ends or tabs that are allowed."""
    text = body.decode("utf-8", "ignore")
    return text if text.isprintable() else "".join(c if c.isprintable() or c in breaks else " " for c in text)


@dataclass
class Formats:
    """The formats of a log: how the rows of its topics are laid out, nested and in arrays, up to the size of a message."""

    #: fields visited for the sizes of formats; a real log has some thousands
    max_visited: ClassVar = 5_000_000
    _fields: dict[str, tuple[Field, ...]] = field(default_factory=dict)
    _whole: dict[str, int] = field(default_factory=dict)
    _visited: int = 0

    def add(self, body: bytes) -> None:
        """Add a format, NAME:TYPE NAME;TYPE[N] NAME;...

        Raises
        ------
        BodyError
            When it is not of this form.
        """
        name, colon, rest = decoded(body).partition(":")
        if not name or not colon:
            raise BodyError("a format without a name")
        fields = []
        for text in filter(None, rest.split(";")):
            kind, space, column = text.partition(" ")
            kind, bracket, count = kind.partition("[")
            digits = count.removesuffix("]")
            if not (kind and space and column) or (bracket and not (digits.isascii() and digits.isdigit())):
                raise BodyError(f"'{text[:40]}' is no field")
            size = int(digits[:9]) if bracket else 0
            if size > MAX_ROW:
                raise BodyError(f"'{text[:40]}' is longer than a message")
            fields.append(Field(kind, size, column))
        if self._fields.setdefault(name, tuple(fields)) != tuple(fields):
            raise BodyError(f"format '{name[:80]}' is given twice")

    def sizes(self, name: str) -> tuple[int, int]:
        """Return how many bytes a row has without its padding at the end, and with it.

        Raises
        ------
        BodyError
            When there is no such format, or a message cannot hold it.
        """
        whole = self._size(name, 0)
        padding = 0
        for part in reversed(self._fields[name]):
            if not part.name.startswith(PADDING):
                break
            padding += max(part.size, 1) * self._size(part.kind, 1)
        if padding == whole:
            raise BodyError(f"a row of '{name[:80]}' is empty")
        return whole - padding, whole

    def _size(self, kind: str, depth: int) -> int:
        """Return the bytes of a type; each format is visited once, and none is empty."""
        if kind in SIZES:
            return SIZES[kind]
        if kind not in self._whole:
            if kind not in self._fields:
                raise BodyError(f"there is no format '{kind[:80]}'")
            if depth > 16:
                raise BodyError("formats are nested without end")
            self._visited += len(self._fields[kind])
            if self._visited > self.max_visited:
                raise BodyError("formats that do not exist are used too often")
            parts = (max(f.size, 1) * self._size(f.kind, depth + 1) for f in self._fields[kind])
            self._whole[kind] = sum(parts)
        if not 0 < self._whole[kind] <= MAX_ROW:
            raise BodyError(f"a row of '{kind[:80]}' is empty, or longer than a message")
        return self._whole[kind]

    def row(self, name: str) -> np.dtype[Any]:
        """Return the type of a row without its padding at the end.

        Raises
        ------
        BodyError
            When two numbers have one name.
        """
        kept, _ = self.sizes(name)
        parts, offset = [], 0
        for column, code in self._columns(name, ""):
            if offset >= kept:
                break
            parts.append((column, code, offset))
            offset += np.dtype(code).itemsize
        names, codes, offsets = (list(x) for x in zip(*parts, strict=True))
        try:
            return np.dtype({"names": names, "formats": codes, "offsets": offsets, "itemsize": kept})
        except ValueError:
            raise BodyError("two numbers have one name") from None

    def _columns(self, name: str, prefix: str) -> Iterator[tuple[str, str]]:
        for part in self._fields[name]:
            for one in [f"{part.name}[{i}]" for i in range(part.size)] if part.size else [part.name]:
                if part.kind in BASIC:
                    yield prefix + one, BASIC[part.kind]
                else:
                    yield from self._columns(part.kind, f"{prefix}{one}.")


@dataclass
class Metadata:
    """Everything in a log beside the rows."""

    information: dict[str, Value] = field(default_factory=dict)  #: name -> value
    #: name -> texts, each of parts that belong together
    parts: dict[str, list[list[Value]]] = field(default_factory=dict)
    initial: dict[str, float] = field(default_factory=dict)  #: parameters at the start
    #: system and airframe -> parameters
    defaults: tuple[dict[str, float], dict[str, float]] = field(default_factory=lambda: ({}, {}))
    changes: list[str] = field(default_factory=list)  #: lines with time [s], parameter and new value
    messages: list[str] = field(default_factory=list)  #: lines for the pilot, with time [s] and level

    def add(self, kind: str, body: bytes, time: float, started: bool) -> None:
        """Add the body of a message of kind I, M, P, Q, L or C, which stands at a time [s], before or after the start.

        Raises
        ------
        BodyError
            When it does not have the form of its kind.
        """
        if kind in "LC":
            head = "<BHQ" if kind == "C" else "<BQ"
            size = struct.calcsize(head)
            if len(body) < size:
                raise BodyError("a text without a time")
            level, *_, stamp = struct.unpack_from(head, body)
            name = LEVELS[level - 48] if 48 <= level < 56 else "UNKNOWN"
            self.messages.append(f"{1e-6 * stamp:.3f} s [{name}] {decoded(body[size:], _BREAKS)}")
            return
        first, pair = (body[0], body[1:]) if kind in "MQ" else (0, body)
        key, value = _key_and_value(pair)
        if kind == "I":
            self.information[key] = value
        elif kind == "M":
            wholes = self.parts.setdefault(key, [])
            if first and wholes:
                wholes[-1].append(value)
            else:
                wholes.append([value])
        elif isinstance(value, str | bytes):
            raise BodyError(f"parameter {key[:40]} is no number")
        elif kind == "Q":
            for bit, known in enumerate(self.defaults):
                known.update({key: float(value)} if first >> bit & 1 else {})
        elif started:
            self.changes.append(f"{time:.3f} s {key} = {float(value):.9g}")
        else:
            self.initial[key] = float(value)

    def texts(self) -> Mapping[str, str]:
        """Return everything but the parameters at the start as texts."""
        found = {key: str(x) for key, x in self.information.items() if not isinstance(x, bytes)}
        for key, wholes in self.parts.items():
            parts = [[x for x in whole if isinstance(x, str)] for whole in wholes]
            # parts are lines without line ends, or a text that was cut anywhere
            joined = (("" if any("\n" in x for x in one) else "\n").join(one) for one in parts)
            found.setdefault(key, "\n".join(joined))
        found["messages"] = "\n".join(self.messages)
        found["parameter changes"] = "\n".join(self.changes)
        for whose, known in zip(("system", "airframe"), self.defaults, strict=True):
            found[f"parameter defaults, {whose}"] = "\n".join(f"{key} = {x:.9g}" for key, x in known.items())
        return {key: text for key, text in found.items() if text}


_BREAKS: Final = "\n\t"  #: allowed in texts


def _key_and_value(body: bytes) -> tuple[str, Value]:
    """Decode length of the key, TYPE NAME, and the value."""
    end = 1 + (body[0] if body else 0)
    kind, _, key = decoded(body[1:end]).partition(" ")
    if not key or end > len(body):
        raise BodyError("a value without a name")
    if kind in BASIC and kind != "char":
        if len(body) - end != SIZES[kind]:
            raise BodyError(f"{key[:40]} is not as long as its type")
        value: Value = np.frombuffer(body[end:], "?" if kind == "bool" else BASIC[kind])[0].item()
        return key, value
    return key, decoded(body[end:], _BREAKS) if kind.startswith("char") else body[end:]
