"""The walk over a DataFlash log: from message to message, and past damage.

A message is ``A3 95 id body``; its length stands in an earlier FMT message (``A3 95 80``, 89 bytes, which holds id and length
in its first two bytes). There is no checksum: a message is whole if the mark of the next one follows it.

The walk advances with every step, and does not search again what it has searched: time is linear in the size of the file.

Plain functions, in the part of Python that Numba compiles too (`stoop.logs.compiled`); small logs do without.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int64]

FMT: Final = 128  #: id of the message that defines messages, also of itself
FMT_LENGTH: Final = 89
MAX_LAYOUTS: Final = 1024  #: an id has one layout for the whole log, unless it is damaged or was put together


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
