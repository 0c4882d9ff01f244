"""What every reader returns: streams of channels on the log's own clock, and the defects of the log."""

from __future__ import annotations

import os
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray, IntArray
from stoop.errors import LogError, one_line

MAX_SORTED: Final = 2_000_000  #: samples, an hour at 400 Hz and more; sorting takes 100 bytes for each


@dataclass(frozen=True)
class Stream:
    """Channels that were recorded together."""

    time: FloatArray  #: (n,) s, on the log's own clock, finite and strictly increasing
    columns: Mapping[str, FloatArray]  #: name -> (n,) values as recorded, in the log's own units

    @property
    def period(self) -> float:
        """Median time between samples [s]; NaN with fewer than two samples."""
        return float(np.median(np.diff(self.time))) if self.time.size > 1 else float("nan")


@dataclass(frozen=True)
class Defect:
    """A fault in a log in spite of which the rest was read."""

    kind: str  #: "time order", "truncated", "corrupt", "dropout", "text", "skipped", "assumed" or "no clock"
    place: str  #: file, topic or column
    message: str  #: one plain sentence

    def __str__(self) -> str:
        """Return the defect on one line."""
        return one_line(f"{self.place}: {self.message}")


@dataclass(frozen=True)
class Recording:
    """A log as it was written."""

    path: Path  #: the file or folder
    #: "ulog", "px4-csv", "dataflash", "crazyflie", "blackbox", "blackbox-csv", "mat", "parquet", "netcdf", "rosbag",
    #: "table" or "stoop-netcdf"
    format: str
    #: topic or file -> Stream; further instances of a topic are called "topic/1", "topic/2"
    streams: Mapping[str, Stream]
    defects: tuple[Defect, ...] = ()  #: faults in the log
    #: texts and numbers beside the channels (only in netCDF files of stoop)
    attributes: Mapping[str, str | float] = field(default_factory=dict)
    #: of the autopilot, at the start of the log
    parameters: Mapping[str, float] = field(default_factory=dict)
    info: Mapping[str, str] = field(default_factory=dict)  #: texts of the log, such as firmware and hardware
    #: stream -> column -> unit as the file states it; empty where it states none
    units: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    #: stream -> columns that are in the log but were not asked for; no columns: the whole stream
    unread: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Numbers(Mapping[str, FloatArray]):
    """Columns of any number type, converted to float64 on access: a large log stays small."""

    raw: Mapping[str, npt.NDArray[Any]]  #: name -> (n,) numbers
    keep: IntArray | None = None  #: indices of the valid samples; None means all
    divisors: Mapping[str, float] = field(default_factory=dict)  #: name -> what its numbers are divided by

    def __getitem__(self, name: str) -> FloatArray:
        values = self.raw[name]
        with np.errstate(invalid="ignore"):  # a signaling NaN in a damaged log is a NaN
            kept = values if self.keep is None else values[self.keep]
            numbers = np.ascontiguousarray(kept, dtype=np.float64)
        return numbers / self.divisors[name] if name in self.divisors else numbers

    def __iter__(self) -> Iterator[str]:
        return iter(self.raw)

    def __len__(self) -> int:
        return len(self.raw)

    @property
    def nbytes(self) -> int:
        """Bytes of the columns as they are stored."""
        return sum(values.nbytes for values in self.raw.values())


def log_size(path: Path) -> int:
    """Return the bytes of a log: a file, or the files of a folder."""
    return sum(file.stat().st_size for file in (path.iterdir() if path.is_dir() else [path]))


def unreadable(path: Path, error: OSError) -> LogError:
    """Return the error of a file that cannot be opened."""
    return LogError(f"{path}: cannot be read ({error.strerror}); check the name and its permissions")


def log_content(path: Path, most: int, remedy: str) -> bytes:
    """Return the content of a file of at most `most` bytes.

    Raises
    ------
    LogError
        When it cannot be read, is empty (the message ends in `remedy`), or is larger.
    """
    try:
        with path.open("rb") as file:
            content = file.read(min(most, os.fstat(file.fileno()).st_size) + 1)
    except OSError as error:
        raise unreadable(path, error) from None
    if not content:
        raise LogError(f"{path}: the log is empty; {remedy}")
    if len(content) > most:
        raise LogError(f"{path}: larger than {most >> 20} MiB; cut the log to the flight of interest")
    return content


def checked_size(path: Path, file: BinaryIO, most: int) -> int:
    """Return the bytes of a log of an autopilot; `LogError` when there are none, or more than `most`."""
    size = file.seek(0, 2)
    file.seek(0)
    if not size:
        raise LogError(f"{path}: the log is empty; copy it again from the autopilot")
    if size > most:
        raise LogError(f"{path}: larger than {most >> 30} GiB; cut the log to the flight of interest")
    return size


def reason(error: BaseException, most: int = 120) -> str:
    """Return the message of an exception as one short line."""
    return " ".join(str(error).split())[:most] or type(error).__name__


def clean_stream(
    place: str, time: FloatArray, columns: Mapping[str, npt.NDArray[Any]]
) -> tuple[Stream, tuple[Defect, ...]]:
    """Drop the samples whose time is not finite or breaks the order.

    Parameters
    ----------
    place : name of the stream in a defect
    time : (n,) s
    columns : name -> (n,)

    Returns
    -------
    stream : the samples that are left, perhaps none
    defects : none, or one that counts the dropped samples
    """
    if bool(np.all(time[1:] > time[:-1])) and np.isfinite(time[:1]).all() and np.isfinite(time[-1:]).all():
        return Stream(time, Numbers(columns)), ()  # nearly always: no lists of indices are made
    keep = increasing(time)
    lost = time.size - keep.size
    if not lost:
        return Stream(time, Numbers(columns)), ()
    message = f"{lost} of {time.size} samples dropped: time stands still or runs back"
    return Stream(time[keep], Numbers(columns, keep)), (Defect("time order", place, message),)


def add_stream(
    streams: dict[str, Stream],
    defects: list[Defect],
    name: str,
    time: FloatArray,
    columns: Mapping[str, npt.NDArray[Any]],
) -> bool:
    """Add a stream by `clean_stream`, and its defects; return whether any sample is left."""
    stream, dropped = clean_stream(name, time, columns)
    defects += dropped
    if stream.time.size:
        streams[name] = stream
    return stream.time.size > 0


def nothing_read(path: Path, what: str, defects: Sequence[Defect], remedy: str) -> LogError:
    """Return the error of a log without a usable stream, with the first defect as its cause."""
    because = f" ({defects[0]})" if defects else ""
    return LogError(f"{path}: {what}{because}; {remedy}")


def increasing(time: FloatArray) -> IntArray:
    """Return the indices of a longest strictly increasing run of finite times.

    A single wild stamp thus costs one sample, whether it points to the past or to the future. Of more than
    `MAX_SORTED` samples those above all before them are returned: this needs no memory, but trusts a leap ahead.
    """
    finite = np.flatnonzero(np.isfinite(time))
    times = time[finite]
    if times.size < 2 or bool(np.all(np.diff(times) > 0.0)):
        return finite
    if times.size > MAX_SORTED:
        highest = np.maximum.accumulate(times)
        return finite[np.flatnonzero(np.concatenate([[True], times[1:] > highest[:-1]]))]
    # patience sorting: tails[k] is the smallest end of an increasing run of length k + 1
    tails: list[float] = []
    ends: list[int] = []
    before = np.full(times.size, -1, dtype=np.intp)
    for i, value in enumerate(times.tolist()):
        k = bisect_left(tails, value)
        before[i] = ends[k - 1] if k else -1
        tails[k : k + 1] = [value]
        ends[k : k + 1] = [i]
    chain = np.empty(len(ends), dtype=np.intp)
    at = ends[-1]
    for k in range(len(ends) - 1, -1, -1):
        chain[k] = at
        at = int(before[at])
    return finite[chain]
