"""netCDF files: flights that stoop wrote, and those of others, which are read in a child process (`stoop.logs.guard`).

Version 3 is read by SciPy, version 4, which is HDF5, by h5py. Vectors and matrices of numbers are read; units, fill
values, scales and offsets are taken from the attributes. Of HDF5 only what stands in the file itself is read: links to
other files, arrays whose bytes lie elsewhere, references and objects are skipped.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import LogError
from stoop.logs.arrays import MAX_ARRAYS, Array, assemble, left_out, max_values
from stoop.logs.guard import is_hdf5
from stoop.logs.recording import Defect, Recording, Stream, increasing, log_content, reason

FORMAT: Final = "stoop-flight/1"
STREAM: Final = "flight"
AIR: Final = "air"
MAX_BYTES: Final = 2**31
MAX_DEPTH: Final = 16  #: of groups or structures
_PACKING: Final = ("_FillValue", "missing_value", "scale_factor", "add_offset")
_DAMAGE: Final = (OSError, RuntimeError, ValueError, TypeError, KeyError)  #: raised by h5py


def read_netcdf(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a flight that stoop wrote, whatever topics are asked for.

    Raises
    ------
    LogError
        When it is empty, damaged, or not written by stoop.
    """
    from scipy.io import netcdf_file  # heavy, and only here

    content = log_content(path, MAX_BYTES, "write the flight again")
    if content[:3] != b"CDF":
        raise LogError(f"{path}: not a netCDF-3 file; read the original log instead")
    try:  # from memory: no count in a damaged header can allocate more than the file
        with netcdf_file(io.BytesIO(content), mmap=False) as file:
            written = vars(file)["_attributes"].items()
            attributes = {n: x.decode("utf-8") if isinstance(x, bytes) else float(x) for n, x in written}
            columns: dict[str, FloatArray] = {}
            air: dict[str, FloatArray] = {}
            for name, variable in file.variables.items():
                if variable.dimensions == ("time",):
                    columns[name] = np.array(variable.data, dtype=np.float64)
                elif variable.dimensions == (AIR,):
                    air[name.removeprefix(f"{AIR}_")] = np.array(variable.data, dtype=np.float64)
    except Exception as error:
        raise LogError(f"{path}: damaged netCDF file ({reason(error)}); write the flight again") from None
    if attributes.get("stoop_format") != FORMAT:
        raise LogError(
            f"{path}: not a flight written by stoop (format '{FORMAT}'); read the original log instead, "
            f"or, where others wrote it so, draft its mapping by stoop map {path} -o {path}.toml"
        )
    time = columns.pop("time", None)
    if time is None or not time.size or increasing(time).size != time.size:
        raise LogError(f"{path}: its time is missing or out of order; write the flight again")
    if any(values.shape != time.shape for values in columns.values()):
        raise LogError(f"{path}: a channel is not as long as the time; write the flight again")
    streams = {STREAM: Stream(time, columns)}
    if "time" in air:
        streams[AIR] = Stream(air.pop("time"), air)
    return Recording(path, "stoop-netcdf", streams, (), attributes)


def parse_foreign_netcdf(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .nc file of others in this process; its library may crash, loop or raise anything.

    Raises
    ------
    LogError
        When it holds no samples, or more numbers than its size allows.
    """
    if is_hdf5(path):
        arrays, defects = read_hdf5(path, matlab=False)
        return assemble(path, "netcdf", arrays, defects, topics)
    from scipy.io import netcdf_file  # heavy, and only here

    arrays = []
    content = log_content(path, MAX_BYTES, "export it again")
    with netcdf_file(io.BytesIO(content), mmap=False) as file:
        if len(file.variables) > MAX_ARRAYS:
            raise LogError(f"{path}: more than {MAX_ARRAYS} arrays; save only the flight")
        for name, variable in file.variables.items():
            values = np.array(variable.data)
            if values.dtype.kind in "biuf":
                native = np.atleast_1d(values.astype(values.dtype.newbyteorder("=")))
                packing = [getattr(variable, key, None) for key in _PACKING]
                unit = getattr(variable, "units", b"")
                stated = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else ""
                arrays.append(Array((name,), _unpacked(native, *packing), stated))
    return assemble(path, "netcdf", arrays, (), topics)


def _unpacked(values: Any, fill: Any, missing: Any, scale: Any, offset: Any) -> Any:
    """Return the numbers that packed ones stand for, by the attributes of netCDF (conventions CF, 8.1)."""
    if all(attribute is None for attribute in (fill, missing, scale, offset)):
        return values
    numbers = np.asarray(values, dtype=np.float64)
    for absent in (fill, missing):
        if absent is not None:
            numbers = np.where(values == np.asarray(absent).flat[0], np.nan, numbers)
    factor = 1.0 if scale is None else float(np.asarray(scale).flat[0])
    return numbers * factor + (0.0 if offset is None else float(np.asarray(offset).flat[0]))


def read_hdf5(path: Path, matlab: bool) -> tuple[list[Array], list[Defect]]:
    """Read all arrays of numbers of an HDF5 file.

    Parameters
    ----------
    path : the file
    matlab : whether it is MATLAB's, which transposes matrices and marks the class of each array

    Raises
    ------
    LogError
        When there are more arrays, or more numbers than the size of the file allows.
    """
    import h5py  # heavy, and only here

    arrays: list[Array] = []
    skipped: list[str] = []
    defects: list[Defect] = []
    total, most = 0, max_values(path)
    with h5py.File(path, "r") as file:
        for place, dataset in _datasets(h5py, file, (), defects, {_address(h5py, file)}):
            total += int(dataset.size or 0)
            if len(arrays) == MAX_ARRAYS or total > most:
                raise LogError(
                    f"{path}: more than {MAX_ARRAYS} arrays or {most} numbers; save only the flight"
                )
            try:
                text = dataset.dtype.kind in "SO" or _attribute(dataset, "MATLAB_class") in (
                    "char", "cell", "string")  # fmt: skip
                elsewhere = dataset.external is not None or dataset.is_virtual
                name = _attribute(dataset, "NAME")
                bare = name.startswith("This is a netCDF dimension but not a netCDF var")
                empty = "MATLAB_empty" in dataset.attrs or dataset.shape is None
                numeric = dataset.dtype.kind in "biuf"
                if elsewhere or empty or bare or text or not numeric:
                    skipped += [] if text else [".".join(place)]
                    continue
                values = np.atleast_1d(dataset[()])
                if matlab:
                    arrays.append(Array(place, values.T))
                else:
                    packing = [dataset.attrs.get(key) for key in _PACKING]
                    arrays.append(Array(place, _unpacked(values, *packing), _attribute(dataset, "units")))
            except _DAMAGE as error:
                defects.append(_damaged(place, error))
    return arrays, [*defects, *left_out(path, skipped, "no arrays of numbers")]


def _datasets(
    h5py: Any, group: Any, place: tuple[str, ...], defects: list[Defect], visited: set[int]
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Descend into groups, into each once, along links within the file only; list the members that cannot be opened."""
    for name in group:
        within = isinstance(group.get(name, getlink=True), h5py.HardLink)
        if len(place) > MAX_DEPTH or name.startswith("#") or not within:
            continue
        try:
            item = group[name]
        except _DAMAGE as error:
            defects.append(_damaged((*place, name), error))
            continue
        if isinstance(item, h5py.Group):
            if (address := _address(h5py, item)) not in visited:  # links may form circles
                visited.add(address)
                yield from _datasets(h5py, item, (*place, name), defects, visited)
        elif isinstance(item, h5py.Dataset):
            yield (*place, name), item


def _address(h5py: Any, group: Any) -> int:
    return int(h5py.h5o.get_info(group.id).addr)


def _damaged(place: tuple[str, ...], error: Exception) -> Defect:
    return Defect("corrupt", ".".join(place), f"damaged and skipped ({reason(error, 80)})")


def _attribute(dataset: Any, name: str) -> str:
    """Return an attribute that is a text; empty where it is none."""
    value = dataset.attrs.get(name, "")
    value = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return value if isinstance(value, str) else ""
