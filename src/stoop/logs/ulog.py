"""PX4 .ulg files: the topics wanted become streams, everything else that the log tells stands beside them.

References
----------
.. [1] PX4 ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.base.units import MICROSECOND
from stoop.errors import LogError, listed
from stoop.logs.recording import Defect, Recording, Stream, clean_stream, unreadable
from stoop.logs.scan.walk import DROPOUTS, DROPPED, STRANGERS, UNKNOWN
from stoop.logs.ulog_formats import PADDING, BodyError, Formats
from stoop.logs.ulog_scan import MAX_KEPT, Rows, Scan, TooMuchError, scan

MAGIC: Final = b"ULog\x01\x12\x35"
MAX_BYTES: Final = 2**36
MAX_FIELDS: Final = 200_000  #: columns of all topics together; a real log has some thousands


def read_ulog(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .ulg file.

    Parameters
    ----------
    path : the file
    topics : names of the topics to keep, all instances of each; None means all

    Returns
    -------
    Recording : with the parameters at the start, and as `info` what the log tells of itself: firmware and hardware,
        texts for the pilot ("messages"), "parameter changes", "parameter defaults, system" and "..., airframe"

    Raises
    ------
    LogError
        When it is no ULog file, or so damaged that no topic can be read.
    """
    size = _check_head(path)
    found = _scan(path, size, topics)
    streams, defects = _streams(path, found)
    defects = [*_file_defects(path, found), *defects]
    if not streams:
        raise LogError(_empty(path, found, topics))
    notes = found.notes
    unread: dict[str, tuple[str, ...]] = dict.fromkeys(sorted(found.unwanted), ())
    return Recording(
        path,
        "ulog",
        streams,
        tuple(defects),
        parameters=notes.initial,
        info=notes.lines(),
        unread=unread,
    )


def _check_head(path: Path) -> int:
    try:
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
        size = path.stat().st_size
    except OSError as error:
        raise unreadable(path, error) from None
    if not size:
        raise LogError(f"{path}: the log is empty; copy it again from the autopilot")
    if head != MAGIC:
        raise LogError(
            f"{path}: not a ULog file, its first bytes are wrong; copy it again from the autopilot"
        )
    if size > MAX_BYTES:
        raise LogError(f"{path}: larger than {MAX_BYTES >> 30} GiB; cut the log to the flight of interest")
    return size


def _scan(path: Path, size: int, topics: frozenset[str] | None) -> Scan:
    try:
        with path.open("rb") as file:
            return scan(file, size, topics)
    except OSError as error:
        raise LogError(
            f"{path}: cannot be read ({error.strerror}); copy it again from the autopilot"
        ) from None
    except BodyError as error:
        raise LogError(
            f"{path}: cannot be read, {error}; update stoop or convert the log with ulog2csv"
        ) from None
    except (TooMuchError, MemoryError):
        raise LogError(
            f"{path}: the topics wanted take more memory than there is, or than {MAX_KEPT >> 30} GiB; "
            "cut the log to the flight of interest"
        ) from None


def _empty(path: Path, found: Scan, topics: frozenset[str] | None) -> str:
    if found.streams or not found.topics or topics is None:
        return f"{path}: no topic holds data; the log was cut before the first sample, record again"
    there = listed(sorted(found.topics), 12)
    return f"{path}: the log holds none of the topics wanted, but {there}; log others, or map these"


def _streams(path: Path, found: Scan) -> tuple[dict[str, Stream], list[Defect]]:
    streams: dict[str, Stream] = {}
    defects: list[Defect] = []
    fields = 0
    for rows in sorted((r for r in found.streams if r.count), key=lambda r: (r.topic, r.instance)):
        name = f"{rows.topic}/{rows.instance}" if rows.instance else rows.topic
        if fields > MAX_FIELDS:
            defects.append(
                Defect("skipped", path.name, f"more than {MAX_FIELDS} columns: {name} and others not read")
            )
            break
        stream, told = _stream(name, rows, found.formats)
        fields += len(stream.columns) if stream else rows.width  # the columns of what fails were built too
        defects.extend(told)
        if stream is not None and stream.time.size:
            streams[name] = stream
    return streams, defects


def _stream(name: str, rows: Rows, formats: Formats) -> tuple[Stream | None, tuple[Defect, ...]]:
    try:
        table = rows.table(formats.row(rows.topic))
    except BodyError as error:
        return None, (Defect("skipped", name, str(error)),)
    columns = {key: table[key] for key in table.dtype.names or () if not _is_padding(key)}
    stamp = columns.pop("timestamp", None)
    if stamp is None:
        return None, (Defect("skipped", name, "no field 'timestamp'"),)
    return clean_stream(name, _seconds(stamp), columns)


def _is_padding(key: str) -> bool:
    return key.rpartition(".")[2].startswith(PADDING)


def _seconds(stamp: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    time = stamp.astype(np.float64)
    time *= MICROSECOND
    return time


def _file_defects(path: Path, found: Scan) -> Iterator[Defect]:
    """List what was wrong, each with its place in the file."""
    for begin, end in found.damages:
        yield Defect("corrupt", f"{path.name}, byte {begin}", f"{end - begin} damaged bytes were skipped")
    more = found.damaged - len(found.damages)
    if more:
        yield Defect("corrupt", path.name, f"damaged bytes were skipped in {more} more places")
    if found.ended >= 0:
        yield Defect("corrupt", f"{path.name}, byte {found.ended}", "too much damage; the rest was not read")
    if found.cut >= 0:
        place = f"{path.name}, byte {found.cut}"
        yield Defect("truncated", place, "the last message is cut; read what is left")
    for at, why in found.unusable:
        yield Defect("skipped", f"{path.name}, byte {at}", f"a message was skipped: {why}")
    yield from _sums(path, found)


def _sums(path: Path, found: Scan) -> Iterator[Defect]:
    sums = [int(x) for x in found.sums]
    if sums[STRANGERS]:
        place = f"{path.name}, byte {sums[STRANGERS + 1]}"
        yield Defect(
            "corrupt", place, f"{sums[STRANGERS]} rows skipped of topics that the log does not define"
        )
    if sums[UNKNOWN]:
        place = f"{path.name}, byte {sums[UNKNOWN + 1]}"
        yield Defect("skipped", place, f"{sums[UNKNOWN]} messages of unknown kinds")
    if found.silenced:
        yield Defect(
            "skipped", path.name, f"too many messages of kind {found.silenced}; not all were looked at"
        )
    if sums[DROPOUTS]:
        lost = 1e-3 * sums[DROPPED]
        message = f"the logger reports {sums[DROPOUTS]} dropouts, {lost:.2f} s in all"
        yield Defect("dropout", path.name, message)
