"""netCDF files that others wrote: version 3 through SciPy, version 4 through h5py; in a process of its own.

Vectors and matrices of numbers are read; units, fill values, scales and offsets are taken from the attributes.
"""

from __future__ import annotations

import io
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.errors import LogError
from stoop.logs.guard import guarded, need
from stoop.logs.hdf5 import is_hdf5, masked, read_hdf5
from stoop.logs.recording import Defect, Recording
from stoop.logs.tabular import MAX_ARRAYS, Array, assemble, typed

MAX_BYTES: Final = 2**31


def read_foreign_netcdf(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .nc file.

    Raises
    ------
    LogError
        When it is damaged, holds no samples, or its version needs a package that is missing.
    """
    if is_hdf5(path):
        need(path, "h5py", "matlab", "netCDF-4 files")
    return guarded("stoop.logs.foreign_netcdf:load", path, topics)


def load(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .nc file in this very process; see `read_foreign_netcdf`."""
    read = partial(read_hdf5, matlab=False) if is_hdf5(path) else _read_classic
    return assemble(path, "netcdf", *typed(path, "netCDF file", read), topics)


def _read_classic(path: Path) -> tuple[list[Array], list[Defect]]:
    """Parse from memory: no count in a damaged header can then ask for more than the file."""
    from scipy.io import netcdf_file  # heavy, and only here

    if path.stat().st_size > MAX_BYTES:
        raise LogError(f"{path}: larger than {MAX_BYTES >> 20} MiB; cut the flight")
    with netcdf_file(io.BytesIO(path.read_bytes()), mmap=False) as file:
        if len(file.variables) > MAX_ARRAYS:
            raise LogError(f"{path}: more than {MAX_ARRAYS} arrays; save only the flight")
        found = [_array(name, variable) for name, variable in file.variables.items()]
    return [array for array in found if array is not None], []


def _array(name: str, variable: Any) -> Array | None:
    values = np.array(variable.data)
    if values.dtype.kind not in "biuf" or values.ndim > 2:
        return None
    values = np.atleast_1d(values.astype(values.dtype.newbyteorder("=")))
    stated = [
        getattr(variable, key, None) for key in ("_FillValue", "missing_value", "scale_factor", "add_offset")
    ]
    unit = getattr(variable, "units", b"")
    return Array(
        (name,), masked(values, *stated), unit.decode("utf-8", "replace") if isinstance(unit, bytes) else ""
    )
