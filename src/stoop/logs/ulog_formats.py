"""How the rows of a ULog's topics are laid out: formats, nested and in arrays, none believed further than a message reaches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

BASIC: Final = {
    "int8_t": "i1", "uint8_t": "u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4", "uint32_t": "<u4",
    "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8", "bool": "i1", "char": "i1",
}  # fmt: skip
SIZES: Final = {name: np.dtype(code).itemsize for name, code in BASIC.items()}
MAX_NESTING: Final = 16
MAX_ROW: Final = 65533  #: bytes of data in a message at most
MAX_LOOKED: Final = 5_000_000  #: fields gone through for the sizes of formats; a real log has some thousands
PADDING: Final = "_padding"


class BodyError(ValueError):
    """The body of a message is not what its kind promises."""


@dataclass(frozen=True)
class Field:
    """A field of a format: type, how many of it (0 where it is no array), and name."""

    kind: str
    size: int
    name: str


def decoded(body: bytes, breaks: str = "") -> str:
    """Return a text without what a terminal would obey, and without line ends or tabs unless they are allowed."""
    text = body.decode("utf-8", "ignore")
    return text if text.isprintable() else "".join(c if c.isprintable() or c in breaks else " " for c in text)


class Formats:
    """The formats of a log."""

    def __init__(self) -> None:
        self._fields: dict[str, tuple[Field, ...]] = {}
        self._whole: dict[str, int] = {}
        self._looked = 0

    def add(self, body: bytes) -> None:
        """Read NAME:TYPE NAME;TYPE[N] NAME;...

        Raises
        ------
        BodyError
            When it is not of this form.
        """
        name, colon, rest = decoded(body).partition(":")
        if not name or not colon:
            raise BodyError("a format without a name")
        fields = tuple(_field(text) for text in rest.split(";") if text)
        if self._fields.setdefault(name, fields) != fields:
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
        for field in reversed(self._fields[name]):
            if not field.name.startswith(PADDING):
                break
            padding += max(field.size, 1) * self._size(field.kind, 1)
        if padding == whole:
            raise BodyError(f"a row of '{name[:80]}' is empty")
        return whole - padding, whole

    def _size(self, kind: str, depth: int) -> int:
        """Return the bytes of a type; each format is looked at once, and none is empty."""
        if kind in SIZES:
            return SIZES[kind]
        if kind not in self._whole:
            if kind not in self._fields:
                raise BodyError(f"there is no format '{kind[:80]}'")
            if depth > MAX_NESTING:
                raise BodyError("formats are nested without end")
            self._looked += len(self._fields[kind])
            if self._looked > MAX_LOOKED:
                raise BodyError("formats that are not there were asked for too often")
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
        for field in self._fields[name]:
            names = [f"{field.name}[{i}]" for i in range(field.size)] if field.size else [field.name]
            for one in names:
                if field.kind in BASIC:
                    yield prefix + one, BASIC[field.kind]
                else:
                    yield from self._columns(field.kind, f"{prefix}{one}.")


def _field(text: str) -> Field:
    kind, space, name = text.partition(" ")
    kind, bracket, count = kind.partition("[")
    digits = count.removesuffix("]")
    if not (kind and space and name) or (bracket and not (digits.isascii() and digits.isdigit())):
        raise BodyError(f"'{text[:40]}' is no field")
    size = int(digits[:9]) if bracket else 0
    if size > MAX_ROW:
        raise BodyError(f"'{text[:40]}' is longer than a message")
    return Field(kind, size, name)
