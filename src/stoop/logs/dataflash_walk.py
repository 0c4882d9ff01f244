"""The walk over a DataFlash log: from message to message, and past damage.

A message is ``A3 95 id body``; its length stands in an earlier FMT message (``A3 95 80``, 89 bytes, which holds id and length
in its first two bytes). There is no checksum: a message is whole if the mark of the next one follows it.

The walk advances with every step, and does not search again what it has searched: time is linear in the size of the file.

Plain functions, in the part of Python that Numba compiles too (`stoop.logs.compiled`); small logs do without.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int64]

FMT: Final = 128  #: id of the message that defines messages, also of itself
FMT_LENGTH: Final = 89
MAX_LAYOUTS: Final = 1024  #: an id has one layout for the whole log, unless it is damaged or was put together
WINDOW: Final = 2**25  #: bytes walked over at once
SMALL: Final = 2**20  #: bytes; a smaller log is read before the compiled walk is even loaded


def is_mark(data: Bytes, at: int) -> bool:
    """Return whether a message can begin here; the end of the file counts as one."""
    if at >= data.size:
        return at == data.size
    return data[at] == 0xA3 and (at + 1 == data.size or data[at + 1] == 0x95)


def find(data: Bytes, at: int, end: int, layout_of: Integers, length: Integers) -> int:
    """Return the first place before `end` with a message of a known kind that a mark follows; `end` if there is none."""
    while at < end:
        if data[at] == 0xA3 and at + 2 < data.size and data[at + 1] == 0x95:
            layout = layout_of[data[at + 2]]
            if layout >= 0 and is_mark(data, at + length[layout]):
                return at
        at += 1
    return end


def define(body: Bytes, layout_of: Integers, length: Integers, definitions: Bytes, state: Integers) -> None:
    """Add a definition, unless it is known, impossible, or one too many.

    state = number of layouts, number of damaged places, bytes in them, place of the cut last message
    """
    kind, size, count = body[0], body[1], state[0]
    known = layout_of[kind]
    if kind == 128 or size < 3 or count == definitions.shape[0]:
        return
    if known >= 0 and np.all(definitions[known] == body):
        return
    layout_of[kind] = count
    length[count] = size
    definitions[count] = body
    state[0] = count + 1


def add_gap(start: int, end: int, gaps: Integers, state: Integers) -> None:
    """Add a damaged place."""
    if state[1] < gaps.shape[0]:
        gaps[state[1], 0] = start
        gaps[state[1], 1] = end
    state[1] += 1
    state[2] += end - start


def walk(
    at: int, stop: int, data: Bytes, layout_of: Integers, length: Integers, definitions: Bytes, count: Integers,
    unknown: Integers, gaps: Integers, state: Integers, place: Integers, room: Integers, out: Bytes,
) -> int:  # fmt: skip
    """Count the messages that begin from `at` to `stop`, copy the bodies of those that have room, return where to go on."""
    while at < stop:
        if at + 2 >= data.size or data[at] != 0xA3 or data[at + 1] != 0x95:
            after = find(data, at + 1, data.size, layout_of, length)
            add_gap(at, after, gaps, state)
            at = after
            continue
        layout = layout_of[data[at + 2]]
        if layout < 0:
            unknown[data[at + 2]] += 1
            at = find(data, at + 3, data.size, layout_of, length)
            continue
        after = at + length[layout]
        if not is_mark(data, after):  # damaged, cut short, or the last whole one before damage
            inner = find(data, at + 3, min(after, data.size), layout_of, length)
            if inner < min(after, data.size):
                add_gap(at, inner, gaps, state)
                at = inner
                continue
            if after > data.size:
                state[3] = at
                return data.size
        if data[at + 2] == 128:
            define(data[at + 3 : after], layout_of, length, definitions, state)
        if count[layout] < room[layout]:
            size = length[layout] - 3
            start = place[layout] + count[layout] * size
            out[start : start + size] = data[at + 3 : after]
        count[layout] += 1
        at = after
    return at


@dataclass(frozen=True)
class Survey:
    """Result of one walk."""

    #: (layouts, 86) bodies of the FMT messages in their order; the first is that of FMT itself
    definitions: Bytes
    length: Integers  #: (layouts,) bytes of a message with its head of 3
    count: Integers  #: (layouts,) messages
    unknown: Integers  #: (256,) messages of each id that was not defined before them
    gaps: Integers  #: (gaps, 2) first byte of a damaged place and first after it; the first 64 of them
    damaged: int  #: number of damaged places, and bytes in all of them
    lost: int
    cut: int  #: place of a last message that is cut; -1 if there is none


def ignore(at: int) -> None:
    """Do nothing with the progress of a walk."""


def survey(data: Bytes) -> Survey:
    """Walk over a log, (size,) bytes, and count."""
    nothing = np.zeros(MAX_LAYOUTS, np.int64)
    return _walk(data, nothing, nothing, np.empty(0, np.uint8), ignore)


def gather(
    data: Bytes, found: Survey, kept: Sequence[int], passed: Callable[[int], None] = ignore
) -> dict[int, Bytes]:
    """Walk over a surveyed log again and copy the bodies of some layouts; `passed` is called with each place reached.

    Returns
    -------
    layout -> (messages, length - 3) bytes
    """
    room, place = np.zeros((2, MAX_LAYOUTS), np.int64)
    sizes = [int(found.count[k] * (found.length[k] - 3)) for k in kept]
    ends = np.cumsum([0, *sizes])
    room[kept], place[kept] = found.count[kept], ends[:-1]
    out = np.zeros(int(ends[-1]), np.uint8)
    _walk(data, room, place, out, passed)
    return {k: out[ends[i] : ends[i + 1]].reshape(-1, found.length[k] - 3) for i, k in enumerate(kept)}


def _walk(data: Bytes, room: Integers, place: Integers, out: Bytes, passed: Callable[[int], None]) -> Survey:
    definitions = np.zeros((MAX_LAYOUTS, FMT_LENGTH - 3), np.uint8)
    length, count = np.zeros((2, MAX_LAYOUTS), np.int64)
    unknown, gaps = np.zeros(256, np.int64), np.zeros((64, 2), np.int64)
    layout_of, state = np.full(256, -1), np.array([1, 0, 0, -1])
    layout_of[FMT], length[0] = 0, FMT_LENGTH
    step: Callable[..., int] = walk
    if data.size >= SMALL:
        from stoop.logs.compiled import dataflash

        step = dataflash().walk
    at = 0
    while at < data.size:
        stop = min(at + WINDOW, data.size)
        at = step(
            at, stop, data, layout_of, length, definitions, count, unknown, gaps, state, place, room, out
        )
        passed(min(at, data.size))
    layouts, damaged, lost, cut = state.tolist()
    return Survey(
        definitions[:layouts], length[:layouts], count[:layouts], unknown, gaps[:damaged], damaged, lost, cut
    )
