"""ArduPilot DataFlash logs (.bin): self-describing binary messages, read column by column.

A log names its kinds of messages (FMT), their units (FMTU, UNIT, MULT), the parameters (PARM) and writes texts (MSG, VER).
Each kind becomes a stream; where a unit of FMTU says that a column numbers the instance, each instance becomes one: "IMU",
"IMU/1". Values are scaled as the letters c, C, e, E and L of the format say; MULT only gives the unit its prefix, as ArduPilot
means it. The bytes are walked twice, in compiled code; only what is wanted is copied.
"""

from __future__ import annotations

import mmap
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from stoop.errors import LogError, listed
from stoop.logs.dataflash_content import assemble, is_wanted
from stoop.logs.dataflash_format import Layout, Messages, parse_layout
from stoop.logs.recording import Defect, Recording, unreadable
from stoop.logs.scan.dataflash import gather, ignore, survey

MAX_PLACES: Final = 10  #: damaged places that are listed; the rest is counted
_AGAIN: Final = "copy it again from the autopilot"


def read_dataflash(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .bin file.

    Parameters
    ----------
    path : the file
    topics : names of messages wanted, such as {"IMU", "ATT"}; None means all

    Raises
    ------
    LogError
        When it is empty, no DataFlash log, or holds no sample.
    """
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            if not size:
                raise LogError(f"{path}: the log is empty; {_AGAIN}")
            content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)  # goes with the last array over it
    except OSError as error:
        raise unreadable(path, error) from None
    return parse_dataflash(path, content, topics)


def parse_dataflash(
    path: Path, content: bytes | mmap.mmap, topics: frozenset[str] | None = None
) -> Recording:
    """Read a log from memory; see `read_dataflash`."""
    data = np.frombuffer(content, np.uint8)
    forget = _forgetter(content)
    found = survey(data, forget)
    layouts, defects = _layouts(found.definitions, found.count, path.name)
    wanted = [k for k, layout in sorted(layouts.items()) if is_wanted(layout.name, topics)]
    blocks = gather(data, found, wanted, forget)
    kinds = [Messages(layouts[k], block.reshape(-1).view(layouts[k].row)) for k, block in blocks.items()]
    defects += _damage(path.name, found.gaps.tolist(), found.damaged, found.lost, found.cut)
    unknown = [f"{kind} ({count})" for kind, count in enumerate(found.unknown.tolist()) if count]
    if unknown:
        message = f"messages of undefined kinds skipped: {listed(unknown, 10)}"
        defects.append(Defect("skipped", path.name, message))
    names = sorted(layout.name for k, layout in layouts.items() if k not in wanted)
    return replace(assemble(path, kinds, defects), unread=dict.fromkeys(names, ()))


def _forgetter(content: bytes | mmap.mmap) -> Callable[[int], None]:
    """Return what gives pages of a mapped file back once they were read, so that a log does not lie in memory twice."""
    if not isinstance(content, mmap.mmap) or not hasattr(mmap, "MADV_DONTNEED"):
        return ignore
    mapped = content

    def forget(at: int) -> None:
        if whole := at // mmap.PAGESIZE * mmap.PAGESIZE:
            mapped.madvise(mmap.MADV_DONTNEED, 0, whole)

    return forget


def _layouts(
    definitions: npt.NDArray[np.uint8], counts: npt.NDArray[np.int64], place: str
) -> tuple[dict[int, Layout], list[Defect]]:
    """Return the layouts that have messages; of several with one name, that with the most."""
    layouts: dict[int, Layout] = {}
    by_name: dict[str, int] = {}
    defects = []
    for k in np.argsort(-counts, kind="stable").tolist():
        if k == 0 or not counts[k]:
            continue
        layout = parse_layout(definitions[k].tobytes())
        if layout is None:
            message = (
                f"{counts[k]} messages of kind {definitions[k][0]} skipped: their definition makes no sense"
            )
            defects.append(Defect("skipped", place, message))
        elif layout.name in by_name:
            message = f"{counts[k]} messages skipped: they are defined otherwise than the rest"
            defects.append(Defect("skipped", layout.name, message))
        else:
            by_name[layout.name] = k
            layouts[k] = layout
    return layouts, defects


def _damage(place: str, gaps: list[list[int]], damaged: int, lost: int, cut: int) -> list[Defect]:
    defects = [
        Defect("corrupt", f"{place} byte {start}", f"{end - start} bytes are no message and were skipped")
        for start, end in gaps[:MAX_PLACES]
    ]
    if damaged > MAX_PLACES:
        message = f"damaged in {damaged} places, {lost} bytes in all; the first {MAX_PLACES} are listed"
        defects.append(Defect("corrupt", place, message))
    if cut >= 0:
        defects.append(Defect("truncated", f"{place} byte {cut}", "the last message is cut"))
    return defects
