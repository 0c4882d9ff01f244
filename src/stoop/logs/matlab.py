"""MATLAB files: versions 5 to 7.2 through SciPy, 7.3 through h5py; in a child process (`stoop.logs.guard`).

Numbers in structures, however deep, are read; strings, cells and objects (timeseries, tables) are not, and are listed. A
structure of arrays with its clock is a stream: "ins" with the columns "gyro.x", "acc[0]".
"""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.errors import LogError
from stoop.logs.arrays import MAX_ARRAYS, Array, assemble, left_out, max_values
from stoop.logs.guard import is_hdf5
from stoop.logs.netcdf import MAX_BYTES, MAX_DEPTH, read_hdf5
from stoop.logs.recording import Defect, Recording, log_content, reason

MAX_ELEMENTS: Final = 1000  #: of an array of structures
HEAD: Final = 128  #: bytes before the first variable
COMPRESSED: Final = b"\x0f"  #: type of a packed variable
NUMBER: Final = 8  #: bytes
PART: Final = 2**20  #: bytes that are unpacked at once


def parse_matlab(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .mat file in this process; its library may crash, loop or raise anything.

    Raises
    ------
    LogError
        When it holds no samples, or more numbers than its size allows.
    """
    arrays, defects = read_hdf5(path, matlab=True) if is_hdf5(path) else _read_old(path)
    return assemble(path, "mat", arrays, defects, topics)


def _read_old(path: Path) -> tuple[list[Array], list[Defect]]:
    """Read one variable after the other, so that damage to one does not affect the others."""
    from scipy.io import loadmat  # heavy, and only here

    arrays: list[Array] = []
    skipped: list[str] = []
    defects: list[Defect] = []
    most = max_values(path)
    for at, content in _variables(log_content(path, MAX_BYTES, "export it again")):
        if _unpacked_size(content, NUMBER * most) > NUMBER * most:
            raise LogError(f"{path}: more than {most} numbers, for a file that short; save only the flight")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of variables that occur twice, and of objects
                file: Any = io.BytesIO(content)  # SciPy's stubs know names only
                variables = loadmat(file, struct_as_record=True, squeeze_me=False)
        except MemoryError:
            raise
        except Exception as error:
            message = f"a variable is damaged and was skipped ({reason(error, 80)})"
            defects.append(Defect("corrupt", f"{path.name} byte {at}", message))
            continue
        for name, value in variables.items():
            for place, leaf in _leaves((name,), value) if not name.startswith("__") else ():
                if len(arrays) == MAX_ARRAYS:
                    raise LogError(f"{path}: more than {MAX_ARRAYS} arrays; save only those of the flight")
                if type(leaf) is np.ndarray and leaf.dtype.kind in "biuf":
                    arrays.append(Array(place, leaf))
                elif not (isinstance(leaf, np.ndarray) and leaf.dtype.kind == "U"):  # texts are of no use
                    skipped.append(".".join(place))
        if sum(array.values.size for array in arrays) > most:
            raise LogError(f"{path}: more than {most} numbers, for a file that short; save only the flight")
    if not arrays and defects:
        raise LogError(f"{path}: nothing can be read ({defects[0]}); save it again")
    why = "neither numbers nor structures of numbers (cells, objects, tables); save plain arrays"
    return arrays, [*defects[:20], *left_out(path, skipped, why)]


def _variables(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield where each variable begins, and a file of it alone; files before version 5 are one variable."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:HEAD])
    if order is None:
        yield 0, content
        return
    at, count = HEAD, 0
    while at + 8 <= len(content) and count < MAX_ARRAYS:
        _, size = struct.unpack_from(f"{order}II", content, at)
        yield at, content[:HEAD] + content[at : at + 8 + size]
        at, count = at + 8 + size, count + 1


def _unpacked_size(content: bytes, most: int) -> int:
    """Return the bytes to which the variable of a file of one unpacks, counted until there are more than `most`."""
    stream, size = zlib.decompressobj(), 0
    if content[126:HEAD] not in (b"IM", b"MI") or content[HEAD : HEAD + 4].strip(b"\0") != COMPRESSED:
        return size
    with suppress(zlib.error):  # of which the reader says more
        for at in range(HEAD + 8, len(content), PART):
            packed = content[at : at + PART]
            while packed and size <= most:
                size += len(stream.decompress(packed, PART))
                packed = stream.unconsumed_tail
    return size


def _leaves(place: tuple[str, ...], value: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Descend into structures; a field with one number per element of an array of structures is a column."""
    if type(value) is not np.ndarray or value.dtype.names is None or len(place) > MAX_DEPTH:
        yield place, value
    elif value.size == 1:
        for name in value.dtype.names:
            yield from _leaves((*place, name), value.flat[0][name])
    elif value.size <= MAX_ELEMENTS:
        for name in value.dtype.names:
            parts = [element[name] for element in value.flat]
            if parts and all(type(x) is np.ndarray and x.size == 1 and x.dtype.kind in "biuf" for x in parts):
                yield (*place, name), np.array([part.flat[0] for part in parts])
                continue
            for i, part in enumerate(parts):
                yield from _leaves((*place[:-1], f"{place[-1]}[{i}]", name), part)
