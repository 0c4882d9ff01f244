"""Blackbox logs written: header, I and P frames, GPS, home and slow frames, events; for simulated flights and for tests.

References
----------
.. [1] Betaflight, src/main/blackbox/blackbox_encoding.c and blackbox_fielddefs.h: encodings and predictors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from stoop.extend.arrays import IntArray

PRODUCT: Final = "H Product:Blackbox flight data recorder by Nicholas Sherlock\n"
GOODBYE: Final = b"E\xffEnd of log\0"
SIGNED_VB, UNSIGNED_VB, NEG_14BIT, TAG8_8SVB, NULL = 0, 1, 3, 6, 9
ZERO, PREVIOUS, STRAIGHT_LINE, AVERAGE_2, MINTHROTTLE, MOTOR_0 = range(6)
INC, HOME_COORD, P_1500, VBATREF, LAST_TIME, MINMOTOR = range(6, 12)
INTERVAL: Final = 32  #: frames from one I frame to the next


@dataclass(frozen=True)
class Field:
    """A field: name, sign, and predictor and encoding in its own frame and in P frames."""

    name: str
    is_signed: bool = True
    predictor: int = ZERO
    encoding: int = SIGNED_VB
    p_predictor: int = PREVIOUS
    p_encoding: int = SIGNED_VB


@dataclass(frozen=True)
class Rows:
    """Frames of one kind that are no main frames: at which main frame they follow (n,), and field -> (n,) whole numbers."""

    fields: Sequence[Field]
    after: IntArray
    values: Mapping[str, npt.NDArray[Any]]


def unsigned_vb(value: int) -> bytes:
    """Return 7 bits a byte, the lowest first."""
    value &= 0xFFFFFFFF
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def signed_vb(value: int) -> bytes:
    """Return a number with its sign in the lowest bit."""
    value = narrowed(value, 32)
    return unsigned_vb(value << 1 ^ (-1 if value < 0 else 0))


def narrowed(value: int, bits: int) -> int:
    """Return the signed number that the lowest bits are."""
    return (value + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)


def tag8_8svb(values: Sequence[int]) -> bytes:
    """Return up to eight numbers behind a byte that tells which of them are not zero; one alone has no such byte."""
    if len(values) == 1:
        return signed_vb(values[0])
    lead = sum((x != 0) << k for k, x in enumerate(values))
    return bytes([lead]) + b"".join(signed_vb(x) for x in values if x)


_SINGLE: Final[Mapping[int, Callable[[int], bytes]]] = {
    SIGNED_VB: signed_vb,
    UNSIGNED_VB: unsigned_vb,
    NEG_14BIT: lambda x: unsigned_vb(-x & 0x3FFF),
    NULL: lambda x: b"",
}
Groups: TypeAlias = Mapping[int, tuple[Callable[[Sequence[int]], bytes], int]]
GROUPS: Final[Groups] = {
    TAG8_8SVB: (tag8_8svb, 8)
}  #: encoding -> how a group is written, and its most numbers


def encoded(encodings: Sequence[int], values: Sequence[int], groups: Groups = GROUPS) -> bytes:
    """Return the bytes of a frame without its letter."""
    out, k = [], 0
    while k < len(values):
        encoding = encodings[k]
        if encoding in _SINGLE:
            out.append(_SINGLE[encoding](values[k]))
            k += 1
            continue
        write, most = groups[encoding]
        size = 1
        while size < most and k + size < len(values) and encodings[k + size] == encoding:
            size += 1
        padding = [0] * (0 if encoding == TAG8_8SVB else most - size)
        out.append(write([*values[k : k + size], *padding]))
        k += size
    return b"".join(out)


def blackbox_bytes(
    fields: Sequence[Field],
    values: Mapping[str, npt.NDArray[Any]],
    settings: Mapping[str, object] | None = None,
    others: Mapping[str, Rows] | None = None,
    groups: Groups = GROUPS,
) -> bytes:
    """Return one log of a file.

    Parameters
    ----------
    fields : of main frames, ``loopIteration`` and ``time`` [us] among them
    values : field -> (n,) whole numbers
    settings : lines of the header; ``minthrottle``, ``vbatref`` and ``motorOutput`` are also what predictors refer to
    others : letter (G, H or S) -> frames that follow main frames
    groups : encodings of several fields, which firmwares have more of than stoop writes

    A gap in ``loopIteration`` is begun anew by an event and an I frame.
    """
    known = {"I interval": INTERVAL, "P interval": 1, "P ratio": INTERVAL, **(settings or {})}
    head = [PRODUCT, "H Data version:2\n", *_defined("I", fields), *_defined("P", fields, as_p=True)]
    for letter, rows in (others or {}).items():
        head += _defined(letter, rows.fields)
    head += [f"H {name}:{value}\n" for name, value in known.items()]
    frames = _main_frames(fields, values, known, groups)
    homes, extra = (others or {}).get("H"), []
    for order, (letter, rows) in enumerate((others or {}).items()):
        table = {f.name: np.asarray(rows.values[f.name]).astype(np.int64) for f in rows.fields}
        if homes is not None:  # coordinates count from the last home position
            last = np.maximum(np.searchsorted(homes.after, rows.after, side="right") - 1, 0)
            for axis, name in enumerate(f.name for f in rows.fields if f.predictor == HOME_COORD):
                table[name] -= np.asarray(homes.values[f"GPS_home[{axis}]"]).astype(np.int64)[last]
        others_of = zip(*(x.tolist() for x in table.values()), strict=True)
        encodings = [f.encoding for f in rows.fields]
        for at, row in zip(rows.after.tolist(), others_of, strict=True):
            extra.append((int(at), order, letter.encode() + encoded(encodings, row, groups)))
    extra.sort()
    out, k = [], 0
    for i, frame in enumerate(frames):
        out.append(frame)
        while k < len(extra) and extra[k][0] <= i:
            out.append(extra[k][2])
            k += 1
    return "".join(head).encode("latin-1", "replace") + b"".join(out) + GOODBYE


def _defined(letter: str, fields: Sequence[Field], as_p: bool = False) -> list[str]:
    rows: dict[str, list[object]] = {} if as_p else {
        "name": [f.name for f in fields],
        "signed": [int(f.is_signed) for f in fields],
    }  # fmt: skip
    rows["predictor"] = [f.p_predictor if as_p else f.predictor for f in fields]
    rows["encoding"] = [f.p_encoding if as_p else f.encoding for f in fields]
    return [f"H Field {letter} {key}:{','.join(map(str, row))}\n" for key, row in rows.items()]


def _main_frames(
    fields: Sequence[Field],
    values: Mapping[str, npt.NDArray[Any]],
    settings: Mapping[str, Any],
    groups: Groups,
) -> Iterator[bytes]:
    """Yield each main frame."""
    table = np.column_stack([np.asarray(values[f.name]).astype(np.int64) for f in fields])
    names = [f.name for f in fields]
    base = np.zeros_like(table)
    constants = {
        MINTHROTTLE: int(settings.get("minthrottle", 0)),
        P_1500: 1500,
        VBATREF: int(settings.get("vbatref", 0)),
        MINMOTOR: int(str(settings.get("motorOutput", "0")).split(",")[0]),
    }
    for k, f in enumerate(fields):
        first_motor = f.predictor == MOTOR_0
        base[:, k] = table[:, names.index("motor[0]")] if first_motor else constants.get(f.predictor, 0)
    whole = (table - base).tolist()
    iterations, stamps = table[:, names.index("loopIteration")], table[:, names.index("time")].tolist()
    jumps = np.flatnonzero(np.diff(iterations, prepend=iterations[:1] - 1) != 1)
    since, resumed = 0, set(jumps.tolist())
    starts = np.zeros(len(table), np.intp)
    for i in range(len(table)):
        since = i if i in resumed or i - since == INTERVAL else since
        starts[i] = since
    rows = np.arange(len(table))
    before = table[np.maximum(rows - 1, starts)]
    earlier = table[np.maximum(rows - 2, starts)]
    half = np.trunc((before + earlier) / 2).astype(np.int64)
    guesses = {PREVIOUS: before, STRAIGHT_LINE: 2 * before - earlier, AVERAGE_2: half, INC: table}
    steps = table.copy()
    for k, f in enumerate(fields):
        guess = guesses.get(f.p_predictor)
        steps[:, k] -= constants.get(f.p_predictor, 0) if guess is None else guess[:, k]
    differences = steps.tolist()
    own, changes = [f.encoding for f in fields], [f.p_encoding for f in fields]
    for i, start in enumerate(starts.tolist()):
        if start != i:
            yield b"P" + encoded(changes, differences[i], groups)
            continue
        resume = b""
        if i in resumed and i:
            resume = b"E\x0e" + unsigned_vb(int(iterations[i])) + unsigned_vb(stamps[i])
        yield resume + b"I" + encoded(own, whole[i], groups)
