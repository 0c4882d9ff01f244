"""From named arrays to streams: what files of MATLAB, Parquet and netCDF have in common.

Such files hold arrays and say nothing of clocks. A clock is a vector whose name says so (`CLOCK`) and that grows; an array
belongs to the clock of its length in its own structure, or else in the nearest one around it. The clock stays among the
columns, as it was, so that a mapping can name another or say another unit. Without a clock samples are counted.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.errors import LogError, listed
from stoop.logs.recording import Defect, Recording, Stream, bytes_of, clean_stream

CLOCK: Final = re.compile(
    r"(t|times?|time[_ ]?stamp|sys_?time|rec_?time|sec|seconds)"
    r"([ _]?[(\[]?(?P<unit>s|sec|ms|us|ns)[)\]]?)?",
    re.IGNORECASE,
)
UNITS: Final = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "milliseconds": 1e-3, "us": 1e-6,
                "microseconds": 1e-6, "ns": 1e-9, "nanoseconds": 1e-9}  # fmt: skip
WHOLE: Final = "data"  #: name of the stream of arrays that stand in no structure
MAX_WIDTH: Final = 64  #: columns of a matrix
MAX_ARRAYS: Final = 4096
MAX_VALUES: Final = 200_000_000  #: numbers in all
GROWS: Final = 0.9  #: share of steps that go forward, in a clock

_T = TypeVar("_T")


@dataclass(frozen=True)
class Array:
    """One array of a file.

    Attributes
    ----------
    place : names of the structures that hold it, and its own
    values : (n,) or (n, k), or (k, n), numbers
    unit : as the file states it
    """

    place: tuple[str, ...]
    values: npt.NDArray[Any]
    unit: str = ""


@dataclass(frozen=True)
class _Group:
    """Arrays that share a clock: where it stands, in which structure, the time [s], samples, and what to say of it."""

    clock: tuple[str, ...]
    home: tuple[str, ...]
    time: FloatArray | None
    samples: int
    told: str
    members: list[Array] = field(default_factory=list)


def most_values(path: Path) -> int:
    """Return how many numbers a file may unfold to: a short one that claims many is damaged or meant to do harm."""
    return min(MAX_VALUES, 5_000_000 + 20 * bytes_of(path))


def left_out(path: Path, names: Sequence[str], why: str) -> list[Defect]:
    """Return one defect for all arrays that could not be read."""
    if not names:
        return []
    return [Defect("skipped", path.name, f"{listed(names, 10)}: {why}")]


def typed(path: Path, what: str, read: Callable[[Path], _T]) -> _T:
    """Call a parser that meets damage by any of a dozen exceptions, all of which mean the same."""
    try:
        return read(path)
    except LogError:
        raise
    except MemoryError:
        raise LogError(f"{path}: asks for more memory than there is; damaged? Copy it again") from None
    except Exception as error:
        why = " ".join(str(error).split())[:120] or type(error).__name__
        raise LogError(f"{path}: damaged {what} ({why}); copy it again, or export it as CSV") from None


def assemble(
    path: Path,
    kind: str,
    arrays: Iterable[Array],
    defects: Iterable[Defect] = (),
    topics: frozenset[str] | None = None,
) -> Recording:
    """Make a recording of arrays.

    Parameters
    ----------
    path, kind : file, and name of its format
    arrays : of the file; one number alone becomes a parameter
    defects : met on the way
    topics : streams wanted; None means all

    Raises
    ------
    LogError
        When no array holds samples.
    """
    found, whole = list(defects), list(arrays)
    streams: dict[str, Stream] = {}
    units: dict[str, dict[str, str]] = {}
    info: dict[str, str] = {}
    groups = _named(_grouped(whole))
    unread: dict[str, tuple[str, ...]] = {n: () for n in groups if topics is not None and n not in topics}
    for name, group in groups.items():
        if name not in unread:
            columns, stated = _columns(group)
            stream, met = _stream(name, group, columns)
            found.extend(met)
            if stream.time.size:
                streams[name] = stream
                units |= {name: stated} if stated else {}
                info[f"clock of {name}"] = group.told
    if not streams:
        raise LogError(f"{path}: no array holds samples; name a file with recorded channels")
    parameters = {".".join(a.place): float(a.values.flat[0]) for a in whole if a.values.size == 1}
    return Recording(path, kind, streams, tuple(found), {}, parameters, info, units, unread)


def _grouped(arrays: Sequence[Array]) -> list[_Group]:
    """Part arrays by the clock to which they belong."""
    vectors = [a for a in arrays if a.values.ndim in (1, 2) and max(a.values.shape) > 1]
    clocks = [clock for array in vectors if (clock := _clock(array)) is not None]
    groups: dict[tuple[tuple[str, ...], int], _Group] = {}
    for array in vectors:
        clock = _nearest(array, clocks)
        alone = _Group((), array.place[:-1][:1], None, max(array.values.shape), "none: samples are counted")
        group = clock or alone
        groups.setdefault((group.clock or group.home, group.samples), group).members.append(array)
    return list(groups.values())


def _named(groups: Iterable[_Group]) -> dict[str, _Group]:
    """Name a group by its structure, or else by its clock, or else by its length too."""
    named: dict[str, _Group] = {}
    for group in groups:
        home, clock = ".".join(group.home) or WHOLE, ".".join(group.clock)
        names = [
            home,
            *([clock] if clock else []),
            *(f"{clock or home}[{group.samples}]{n or ''}" for n in range(9)),
        ]
        named.setdefault(next((name for name in names if name not in named), names[-1]), group)
    return named


def _clock(array: Array) -> _Group | None:
    """Return a group to be, if an array is a clock."""
    named = CLOCK.fullmatch(array.place[-1])
    if named is None or (min(array.values.shape, default=0) != 1 and array.values.ndim == 2):
        return None
    values = np.asarray(array.values, dtype=np.float64).ravel()
    steps = np.diff(values)
    if not np.mean(steps > 0.0) >= GROWS:
        return None
    stated = array.unit.split(" ")[0].lower()
    unit = named["unit"] or (stated if stated in UNITS else "")
    period = UNITS[unit.lower()] if unit else _guess(float(np.median(steps[steps > 0.0])))
    told = f"{'.'.join(array.place)} in {unit or f'units of {period:g} s, which is guessed'}"
    return _Group(array.place, array.place[:-1], values * period, values.size, told)


def _guess(step: float) -> float:
    """Return the unit [s] for which the step between samples of a flight log, as a bare number, is typical."""
    return next((unit for most, unit in ((1.0, 1.0), (1e3, 1e-3), (1e6, 1e-6)) if step < most), 1e-9)


def _nearest(array: Array, clocks: Sequence[_Group]) -> _Group | None:
    """Return the clock of an array's length in its structure or the nearest around it, or else the only one there is."""
    fit = [clock for clock in clocks if clock.samples in array.values.shape]
    around = [clock for clock in fit if array.place[: len(clock.home)] == clock.home]
    if around:
        return max(around, key=lambda clock: len(clock.home))
    return fit[0] if len(fit) == 1 else None


def _columns(group: _Group) -> tuple[dict[str, npt.NDArray[Any]], dict[str, str]]:
    """Return the columns of a group, a matrix as "name[0]", "name[1]"; and the units that are stated."""
    columns: dict[str, npt.NDArray[Any]] = {}
    units: dict[str, str] = {}
    for array in group.members:
        within = array.place[: len(group.home)] == group.home
        name = ".".join(array.place[len(group.home) :] if within else array.place)
        rows = (
            array.values.reshape(group.samples, -1)
            if array.values.ndim == 1
            else _upright(array.values, group.samples)
        )
        for k in range(min(rows.shape[1], MAX_WIDTH)):
            column = name if rows.shape[1] == 1 else f"{name}[{k}]"
            columns.setdefault(column, rows[:, k])
            if array.unit:
                units.setdefault(column, array.unit)
    return columns, units


def _upright(values: npt.NDArray[Any], samples: int) -> npt.NDArray[Any]:
    """Return a matrix with samples as rows."""
    return values if values.shape[0] == samples else values.T


def _stream(
    name: str, group: _Group, columns: Mapping[str, npt.NDArray[Any]]
) -> tuple[Stream, tuple[Defect, ...]]:
    if group.time is not None:
        return clean_stream(name, group.time, columns)
    message = "no column looks like a time; samples are counted, name the clock in a mapping"
    stream, _ = clean_stream(name, np.arange(group.samples, dtype=np.float64), columns)
    return stream, (Defect("no clock", name, message),)
