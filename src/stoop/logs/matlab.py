"""MATLAB files: version 5 to 7.2 through SciPy, 7.3 through h5py; in a process of its own.

Numbers in structures, however deep, are read; strings, cells and objects (timeseries, tables) are not, and are listed. A
structure of arrays with its clock is a stream: "ins" with the columns "gyro.x", "acc[0]".
"""

from __future__ import annotations

import io
import struct
import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.errors import LogError
from stoop.logs.guard import guarded, need
from stoop.logs.hdf5 import is_hdf5, read_hdf5
from stoop.logs.recording import Defect, Recording
from stoop.logs.tabular import MAX_ARRAYS, Array, assemble, left_out, most_values, typed

MAX_DEPTH: Final = 16
MAX_BYTES: Final = 2**31
MAX_DEFECTS: Final = 20
HEAD: Final = 128  #: bytes before the first variable
WHY: Final = "neither numbers nor structures of numbers (cells, objects, tables); save plain arrays"
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
    read = partial(read_hdf5, matlab=True) if is_hdf5(path) else _read_old
    return assemble(path, "mat", *typed(path, "MATLAB file", read), topics)


def _read_old(path: Path) -> tuple[list[Array], list[Defect]]:
    """Read one variable after the other, so that damage to one costs no other."""
    if path.stat().st_size > MAX_BYTES:
        raise LogError(f"{path}: larger than {MAX_BYTES >> 20} MiB; save only the flight")
    content = path.read_bytes()
    arrays: list[Array] = []
    skipped: list[str] = []
    defects: list[Defect] = []
    most = most_values(path)
    for at, variable in _variables(content):
        try:
            found = _loaded(variable)
        except MemoryError:
            raise
        except Exception as error:
            why = " ".join(str(error).split())[:80] or type(error).__name__
            defects.append(
                Defect("corrupt", f"{path.name} byte {at}", f"a variable is damaged and was skipped ({why})")
            )
            continue
        for name, value in found.items():
            for place, leaf in _leaves((name,), value) if not name.startswith("__") else ():
                _take(path, arrays, skipped, place, leaf)
        if sum(array.values.size for array in arrays) > most:
            raise LogError(f"{path}: more than {most} numbers, for a file that short; save only the flight")
    if not arrays and defects:
        raise LogError(f"{path}: nothing can be read ({defects[0]}); save it again")
    return arrays, [*defects[:MAX_DEFECTS], *left_out(path, skipped, WHY)]


def _variables(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Return where each variable begins, and a file of it alone; older files are taken as a whole."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        yield 0, content
        return
    at, count = HEAD, 0
    while at + 8 <= len(content) and count < MAX_ARRAYS:
        _, size = struct.unpack_from(f"{order}II", content, at)
        yield at, content[:HEAD] + content[at : at + 8 + size]
        at, count = at + 8 + size, count + 1


def _loaded(content: bytes) -> dict[str, Any]:
    from scipy.io import loadmat  # heavy, and only here

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of variables that occur twice, and of objects
        file: Any = io.BytesIO(content)  # SciPy's stubs know names only
        return dict(loadmat(file, struct_as_record=True, squeeze_me=False))


def _take(path: Path, arrays: list[Array], skipped: list[str], place: tuple[str, ...], leaf: Any) -> None:
    """Keep an array of numbers; name what is none."""
    if len(arrays) == MAX_ARRAYS:
        raise LogError(f"{path}: more than {MAX_ARRAYS} arrays; save only those of the flight")
    if type(leaf) is np.ndarray and leaf.dtype.kind in "biuf":
        arrays.append(Array(place, leaf))
    elif not (isinstance(leaf, np.ndarray) and leaf.dtype.kind == "U"):  # texts are of no use
        skipped.append(".".join(place))


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
