"""What a ULog tells beside its rows: information, parameters and texts, each from the body of its message."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from stoop.logs.ulog_formats import SIZES, BodyError, decoded

BREAKS: Final = "\n\t"  #: stay in a text
LEVELS: Final = ("EMERGENCY", "ALERT", "CRITICAL", "ERROR", "WARNING", "NOTICE", "INFO", "DEBUG")
_CODES: Final = {
    "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I",
    "int64_t": "q", "uint64_t": "Q", "float": "f", "double": "d", "bool": "?",
}  # fmt: skip
Value: TypeAlias = float | int | str | bytes


@dataclass(frozen=True)
class Text:
    """A message for the pilot: when [s], how grave, from whom (None where it is not said), and what."""

    time: float
    level: str
    tag: int | None
    text: str


@dataclass
class Notes:
    """All that is told beside the rows.

    Attributes
    ----------
    information : name -> value
    parts : name -> texts, each of parts that belong together
    initial : parameters at the start
    defaults : system and airframe -> parameters
    changed : when [s], parameter, new value
    texts : for the pilot
    """

    information: dict[str, Value] = field(default_factory=dict)
    parts: dict[str, list[list[Value]]] = field(default_factory=dict)
    initial: dict[str, float] = field(default_factory=dict)
    defaults: tuple[dict[str, float], dict[str, float]] = field(default_factory=lambda: ({}, {}))
    changed: list[tuple[float, str, float]] = field(default_factory=list)
    texts: list[Text] = field(default_factory=list)

    def take(self, kind: str, body: bytes, time: float, started: bool) -> None:
        """Take the body of a message of kind I, M, P, Q, L or C, met at a time [s], before or after the start.

        Raises
        ------
        BodyError
            When it is not what its kind promises.
        """
        if kind in "LC":
            self.texts.append(_text(body, kind == "C"))
            return
        first = body[0] if kind in "MQ" else 0
        key, value = _pair(body[1:] if kind in "MQ" else body)
        if kind == "I":
            self.information[key] = value
        elif kind == "M":
            self._add_part(key, value, bool(first))
        elif kind == "Q":
            for bit, known in enumerate(self.defaults):
                known.update({key: _number(key, value)} if first >> bit & 1 else {})
        elif started:
            self.changed.append((time, key, _number(key, value)))
        else:
            self.initial[key] = _number(key, value)

    def _add_part(self, key: str, value: Value, goes_on: bool) -> None:
        wholes = self.parts.setdefault(key, [])
        if goes_on and wholes:
            wholes[-1].append(value)
        else:
            wholes.append([value])

    def lines(self) -> Mapping[str, str]:
        """Return everything but the parameters at the start as texts."""
        told = {key: str(x) for key, x in self.information.items() if not isinstance(x, bytes)}
        for key, wholes in self.parts.items():
            told.setdefault(key, "\n".join(_joined([x for x in w if isinstance(x, str)]) for w in wholes))
        told["messages"] = "\n".join(f"{t.time:.3f} s [{t.level}] {t.text}" for t in self.texts)
        told["parameter changes"] = "\n".join(f"{t:.3f} s {key} = {x:.9g}" for t, key, x in self.changed)
        for whose, known in zip(("system", "airframe"), self.defaults, strict=True):
            told[f"parameter defaults, {whose}"] = "\n".join(f"{key} = {x:.9g}" for key, x in known.items())
        return {key: text for key, text in told.items() if text}


def _joined(parts: list[str]) -> str:
    """Put parts together: lines that hold no line ends, or a text cut anywhere."""
    return ("" if any("\n" in part for part in parts) else "\n").join(parts)


def _text(body: bytes, tagged: bool) -> Text:
    head = "<BHQ" if tagged else "<BQ"
    size = struct.calcsize(head)
    if len(body) < size:
        raise BodyError("a text without a time")
    level, *tag, stamp = struct.unpack_from(head, body)
    known = LEVELS[level - 48] if 48 <= level < 56 else "UNKNOWN"
    return Text(1e-6 * stamp, known, tag[0] if tag else None, decoded(body[size:], BREAKS))


def _pair(body: bytes) -> tuple[str, Value]:
    """Read the length of the key, TYPE NAME, and the value."""
    end = 1 + (body[0] if body else 0)
    kind, _, key = decoded(body[1:end]).partition(" ")
    if not key or end > len(body):
        raise BodyError("a value without a name")
    if kind in _CODES:
        if len(body) - end != SIZES[kind]:
            raise BodyError(f"{key[:40]} is not as long as its type")
        value: Value = struct.unpack("<" + _CODES[kind], body[end:])[0]
        return key, value
    return key, decoded(body[end:], BREAKS) if kind.startswith("char") else body[end:]


def _number(key: str, value: Value) -> float:
    if isinstance(value, str | bytes):
        raise BodyError(f"parameter {key[:40]} is no number")
    return float(value)
