"""Arrays of numbers in an HDF5 file, as MATLAB 7.3 and netCDF-4 write it.

Only what stands in the file itself is read: links to other files, arrays whose bytes lie elsewhere, references and objects are
passed over.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.errors import LogError
from stoop.logs.recording import Defect, unreadable
from stoop.logs.tabular import MAX_ARRAYS, Array, left_out, most_values

MAGIC: Final = b"\x89HDF\r\n\x1a\n"
PLACES: Final = (0, 512)  #: where the mark stands; MATLAB puts a head of its own before
MAX_DEPTH: Final = 16
DAMAGE: Final = (
    OSError,
    RuntimeError,
    ValueError,
    TypeError,
    KeyError,
)  #: what h5py raises where it meets any
_NO_VARIABLE: Final = "This is a netCDF dimension but not a netCDF variable"


def is_hdf5(path: Path) -> bool:
    """Tell whether a file is HDF5.

    Raises
    ------
    LogError
        When it cannot be read, or is empty.
    """
    try:
        with path.open("rb") as file:
            head = file.read(PLACES[-1] + len(MAGIC))
    except OSError as error:
        raise unreadable(path, error) from None
    if not head:
        raise LogError(f"{path}: the file is empty; export it again")
    return any(head[place:].startswith(MAGIC) for place in PLACES)


def read_hdf5(path: Path, matlab: bool) -> tuple[list[Array], list[Defect]]:
    """Read all arrays of numbers.

    Parameters
    ----------
    path : the file
    matlab : whether it is MATLAB's, who turns matrices and marks what each array is
    """
    import h5py  # heavy, and only here

    arrays: list[Array] = []
    skipped: list[str] = []
    defects: list[Defect] = []
    total, most = 0, most_values(path)
    with h5py.File(path, "r") as file:
        for place, dataset in _datasets(h5py, file, (), defects):
            total += int(dataset.size or 0)
            if len(arrays) == MAX_ARRAYS or total > most:
                raise LogError(
                    f"{path}: more than {MAX_ARRAYS} arrays or {most} numbers; save only the flight"
                )
            try:
                array = _array(place, dataset, matlab)
            except DAMAGE as error:
                defects.append(_damaged(place, error))
                continue
            if array is not None:
                arrays.append(array)
            elif not _is_text(dataset):
                skipped.append(".".join(place))
    return arrays, [*defects, *left_out(path, skipped, "no vectors or matrices of numbers")]


def _damaged(place: tuple[str, ...], error: Exception) -> Defect:
    why = " ".join(str(error).split())[:80]
    return Defect("corrupt", ".".join(place), f"damaged and skipped ({why})")


def _datasets(
    h5py: Any, group: Any, place: tuple[str, ...], defects: list[Defect]
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Go down into groups, along links within the file only; note the members that cannot be opened."""
    for name in group:
        if (
            len(place) > MAX_DEPTH
            or name.startswith("#")
            or not isinstance(group.get(name, getlink=True), h5py.HardLink)
        ):
            continue
        try:
            item = group[name]
        except DAMAGE as error:
            defects.append(_damaged((*place, name), error))
            continue
        if isinstance(item, h5py.Group):
            yield from _datasets(h5py, item, (*place, name), defects)
        elif isinstance(item, h5py.Dataset):
            yield (*place, name), item


def _array(place: tuple[str, ...], dataset: Any, matlab: bool) -> Array | None:
    """Read one array; None where it holds no numbers, or not in this file."""
    elsewhere = dataset.external is not None or dataset.is_virtual
    if elsewhere or dataset.dtype.kind not in "biuf" or dataset.ndim > 2 or "MATLAB_empty" in dataset.attrs:
        return None
    if _is_text(dataset) or _word(dataset, "NAME").startswith(_NO_VARIABLE):
        return None
    values = np.atleast_1d(dataset[()])
    if matlab:
        return Array(place, values.T)
    numbers = masked(
        values,
        *(dataset.attrs.get(key) for key in ("_FillValue", "missing_value", "scale_factor", "add_offset")),
    )
    return Array(place, numbers, _word(dataset, "units"))


def masked(values: Any, fill: Any, missing: Any, scale: Any, offset: Any) -> Any:
    """Return the numbers that stored ones stand for, by the attributes that netCDF gives them."""
    if all(attribute is None for attribute in (fill, missing, scale, offset)):
        return values
    numbers = np.asarray(values, dtype=np.float64)
    for absent in (fill, missing):
        if absent is not None:
            numbers = np.where(values == np.asarray(absent).flat[0], np.nan, numbers)
    factor, shift = (
        default if a is None else float(np.asarray(a).flat[0]) for a, default in ((scale, 1.0), (offset, 0.0))
    )
    return numbers * factor + shift


def _is_text(dataset: Any) -> bool:
    return dataset.dtype.kind in "SO" or _word(dataset, "MATLAB_class") in ("char", "cell", "string")


def _word(dataset: Any, name: str) -> str:
    """Return an attribute that is a text; empty where it is none."""
    value = dataset.attrs.get(name, "")
    value = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return value if isinstance(value, str) else ""
