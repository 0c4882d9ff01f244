"""MATLAB files: version 5 to 7.2 through SciPy, 7.3 through h5py; in a process of its own.

Numbers in structures, however deep, are read; strings, cells and objects (timeseries, tables) are not, and are listed. A
structure of arrays with its clock is a stream: "ins" with the columns "gyro.x", "acc[0]".
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.errors import LogError
from stoop.logs.guard import guarded, need
from stoop.logs.hdf5 import is_hdf5, read_hdf5
from stoop.logs.recording import Defect, Recording
from stoop.logs.tabular import MAX_ARRAYS, Array, assemble, typed

MAX_DEPTH: Final = 16
MAX_ELEMENTS: Final = 1000  #: of an array of structures


def read_matlab(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .mat file.

    Raises
    ------
    LogError
        When it is damaged, holds no samples, or its version needs a package that is missing.
    """
    if is_hdf5(path):
        need(path, "h5py", "matlab", "MATLAB files of version 7.3")
    return guarded("stoop.logs.matlab:load", path, topics)


def load(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .mat file in this very process; see `read_matlab`."""
    if is_hdf5(path):
        arrays, defects = typed(path, "MATLAB file", lambda: read_hdf5(path, matlab=True))
    else:
        arrays, defects = typed(path, "MATLAB file", lambda: _read_old(path))
    return assemble(path, "mat", arrays, defects, topics)


def _read_old(path: Path) -> tuple[list[Array], list[Defect]]:
    from scipy.io import loadmat  # heavy, and only here

    content = loadmat(path, struct_as_record=True, squeeze_me=False, chars_as_strings=True)
    arrays: list[Array] = []
    skipped: list[str] = []
    for name, value in content.items():
        if not name.startswith("__"):
            for place, leaf in _leaves((name,), value):
                _take(path, arrays, skipped, place, leaf)
    return arrays, listed(path, skipped)


def _take(path: Path, arrays: list[Array], skipped: list[str], place: tuple[str, ...], leaf: Any) -> None:
    """Keep an array of numbers; name what is none."""
    if len(arrays) == MAX_ARRAYS:
        raise LogError(f"{path}: more than {MAX_ARRAYS} arrays; save only those of the flight")
    if type(leaf) is np.ndarray and leaf.dtype.kind in "biuf":
        arrays.append(Array(place, leaf))
    elif not (isinstance(leaf, np.ndarray) and leaf.dtype.kind == "U"):  # texts are of no use
        skipped.append(".".join(place))


def listed(path: Path, skipped: list[str]) -> list[Defect]:
    """Return one defect for all that could not be read."""
    if not skipped:
        return []
    some = ", ".join(skipped[:10]) + (f" and {len(skipped) - 10} more" if len(skipped) > 10 else "")
    why = "neither numbers nor structures of numbers (cells, objects, tables); save plain arrays"
    return [Defect("skipped", path.name, f"{some}: {why}")]


def _leaves(place: tuple[str, ...], value: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Go down into structures."""
    if type(value) is not np.ndarray or value.dtype.names is None or len(place) > MAX_DEPTH:
        yield place, value
        return
    if value.size == 1:
        for name in value.dtype.names:
            yield from _leaves((*place, name), value.flat[0][name])
        return
    for name in value.dtype.names:
        parts = [element[name] for element in value.flat[:MAX_ELEMENTS]] if value.size <= MAX_ELEMENTS else []
        if parts and all(_is_number(part) for part in parts):  # one number per element: a column
            yield (*place, name), np.array([part.flat[0] for part in parts])
        for i, part in enumerate(parts if not all(_is_number(part) for part in parts) else []):
            yield from _leaves((*place[:-1], f"{place[-1]}[{i}]", name), part)


def _is_number(value: Any) -> bool:
    return type(value) is np.ndarray and value.size == 1 and value.dtype.kind in "biuf"
