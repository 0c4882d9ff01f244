"""From named arrays to streams, for files of MATLAB, Parquet and netCDF.

Such files hold arrays and do not name their clocks. A clock is a vector whose name says so (`CLOCK`) and that grows; an array
belongs to the clock of its length in its own structure, or else in the nearest one around it. The clock stays among the
columns, in its own unit, so that a mapping can name another one or another unit. Without a clock samples are counted.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, count
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.errors import listed
from stoop.logs.recording import Defect, Recording, Stream, add_stream, log_size, nothing_read

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
MIN_RISING: Final = 0.9  #: share of the steps of a clock that go forward


@dataclass(frozen=True)
class Array:
    """One array of a file."""

    place: tuple[str, ...]  #: names of the structures that hold it, and its own
    values: npt.NDArray[Any]  #: (n,) or (n, k), or (k, n), numbers
    unit: str = ""  #: as the file states it


@dataclass(frozen=True)
class _Group:
    """Arrays that share a clock: its place, its structure, the time [s], samples, and a description of the clock."""

    clock: tuple[str, ...]
    home: tuple[str, ...]
    time: FloatArray | None
    samples: int
    description: str
    members: list[Array] = field(default_factory=list)


def max_values(path: Path) -> int:
    """Return how many numbers a file may unfold to: a short one that claims many is damaged or malicious."""
    return min(MAX_VALUES, 5_000_000 + 20 * log_size(path))


def left_out(path: Path, names: Sequence[str], why: str) -> list[Defect]:
    """Return one defect for all arrays that cannot be read."""
    return [Defect("skipped", path.name, f"{listed(names, 10)}: {why}")] if names else []


def assemble(
    path: Path,
    kind: str,
    arrays: Sequence[Array],
    defects: Iterable[Defect] = (),
    topics: frozenset[str] | None = None,
) -> Recording:
    """Return the recording of some arrays.

    Parameters
    ----------
    path, kind : file, and name of its format
    arrays : of the file; a single number becomes a parameter
    defects : of the file
    topics : streams wanted; None means all

    Raises
    ------
    LogError
        When no array holds samples.
    """
    found = list(defects)
    streams: dict[str, Stream] = {}
    units: dict[str, dict[str, str]] = {}
    info: dict[str, str] = {}
    # a dimension of one is none: Simulink saves vectors as 3 x 1 x n
    arrays = [replace(a, values=a.values.squeeze()) if a.values.ndim > 2 else a for a in arrays]
    cubes = [".".join(a.place) for a in arrays if a.values.ndim > 2]
    found += left_out(path, cubes, "neither vectors nor matrices")
    groups = _groups(arrays)
    unread: dict[str, tuple[str, ...]] = {n: () for n in groups if topics is not None and n not in topics}
    for name, group in groups.items():
        if name in unread:
            continue
        columns, stated, lost = _columns(group)
        found += left_out(path, lost, f"of another's name, or beyond column {MAX_WIDTH}")
        time = np.arange(group.samples, dtype=np.float64) if group.time is None else group.time
        there = add_stream(streams, found, name, time, columns)
        if group.time is None:
            message = "no column looks like a time; samples are counted, name the clock in a mapping"
            found.append(Defect("no clock", name, message))
        if there:
            units |= {name: stated} if stated else {}
            info[f"clock of {name}"] = group.description
    if not streams:
        raise nothing_read(path, "no array holds samples", found, "name a file with recorded channels")
    parameters = {".".join(a.place): float(a.values.flat[0]) for a in arrays if a.values.size == 1}
    return Recording(path, kind, streams, tuple(found), {}, parameters, info, units, unread)


def _groups(arrays: Sequence[Array]) -> dict[str, _Group]:
    """Group arrays by their clock; the name is that of the structure, else of the clock, else with the length."""
    vectors = [a for a in arrays if a.values.ndim in (1, 2) and a.values.size > 1]
    clocks = [clock for array in vectors if (clock := _clock(array)) is not None]
    groups: dict[tuple[tuple[str, ...], int], _Group] = {}
    for array in vectors:
        # the clock of its length in its structure or the nearest around it, or else the only one there is
        fitting = [clock for clock in clocks if clock.samples in array.values.shape]
        around = [clock for clock in fitting if array.place[: len(clock.home)] == clock.home]
        if around:
            group = max(around, key=lambda clock: len(clock.home))
        elif len(fitting) == 1:
            group = fitting[0]
        else:
            samples = max(array.values.shape)
            group = _Group((), array.place[:-1][:1], None, samples, "none: samples are counted")
        groups.setdefault((group.clock or group.home, group.samples), group).members.append(array)
    named: dict[str, _Group] = {}
    for group in groups.values():
        home, own = ".".join(group.home) or WHOLE, ".".join(group.clock)
        sized = (f"{own or home}[{group.samples}]{n or ''}" for n in count())
        named[next(name for name in chain([home], filter(None, [own]), sized) if name not in named)] = group
    return named


def _clock(array: Array) -> _Group | None:
    """Return the group of a clock; None where an array is none."""
    named = CLOCK.fullmatch(array.place[-1])
    if named is None or (min(array.values.shape, default=0) != 1 and array.values.ndim == 2):
        return None
    values = np.asarray(array.values, dtype=np.float64).ravel()
    steps = np.diff(values)
    if not np.mean(steps > 0.0) >= MIN_RISING:
        return None
    stated = array.unit.split(" ")[0].lower()
    unit = named["unit"] or (stated if stated in UNITS else "")
    if unit:
        period = UNITS[unit.lower()]
    else:  # the unit in which the step is typical of a flight log
        step = float(np.median(steps[steps > 0.0]))
        period = next((x for most, x in ((1.0, 1.0), (1e3, 1e-3), (1e6, 1e-6)) if step < most), 1e-9)
    description = f"{'.'.join(array.place)} in {unit or f'units of {period:g} s, which is guessed'}"
    return _Group(array.place, array.place[:-1], values * period, values.size, description)


def _columns(group: _Group) -> tuple[dict[str, npt.NDArray[Any]], dict[str, str], list[str]]:
    """Return the columns of a group, a matrix as "name[0]", "name[1]"; the stated units; and arrays not read whole."""
    columns: dict[str, npt.NDArray[Any]] = {}
    units: dict[str, str] = {}
    lost: list[str] = []
    for array in group.members:
        within = array.place[: len(group.home)] == group.home
        name = ".".join(array.place[len(group.home) :] if within else array.place)
        rows = array.values if array.values.shape[0] == group.samples else array.values.T
        rows = rows.reshape(group.samples, -1)
        labels = [name] if rows.shape[1] == 1 else [f"{name}[{k}]" for k in range(rows.shape[1])]
        if len(labels) > MAX_WIDTH or labels[0] in columns:
            lost.append(name)
        for k, column in enumerate(labels[:MAX_WIDTH]):
            columns.setdefault(column, rows[:, k])
            if array.unit:
                units.setdefault(column, array.unit)
    return columns, units, lost
