"""Two walks over a DataFlash log: count the messages of each layout, then copy the bodies of those that are wanted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.logs.dataflash_walk import FMT, FMT_LENGTH, MAX_LAYOUTS, Bytes, Integers, walk

#: bytes walked over at once
WINDOW: Final = 2**25
#: bytes; a smaller log is read before the compiled walk is even loaded
SMALL: Final = 2**20


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


def survey(data: Bytes) -> Survey:
    """Walk over a log, (size,) bytes, and count."""
    nothing = np.zeros(MAX_LAYOUTS, np.int64)
    return _walk(data, nothing, nothing, np.empty(0, np.uint8))


def gather(
    data: Bytes, found: Survey, kept: Sequence[int], passed: Callable[[int], None] | None = None
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


def _walk(
    data: Bytes, room: Integers, place: Integers, out: Bytes, passed: Callable[[int], None] | None = None
) -> Survey:
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
        if passed is not None:
            passed(min(at, data.size))
    layouts, damaged, lost, cut = state.tolist()
    return Survey(
        definitions[:layouts], length[:layouts], count[:layouts], unknown, gaps[:damaged], damaged, lost, cut
    )
