"""Our own netCDF-3 files, read from memory: no count in a damaged header can ask for more than the file."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import LogError
from stoop.logs.recording import Recording, Stream, increasing, unreadable

if TYPE_CHECKING:
    from scipy.io import netcdf_file

FORMAT: Final = "stoop-flight/1"
STREAM: Final = "flight"
AIR: Final = "air"
MAX_BYTES: Final = 2**31


def read_netcdf(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a flight that stoop wrote, whole whatever is asked for.

    Raises
    ------
    LogError
        When it is empty, damaged, or not written by stoop.
    """
    content = _content(path)
    attributes, columns, traces = _parse(path, content)
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
    if "time" in traces:
        streams[AIR] = Stream(traces.pop("time"), traces)
    return Recording(path, "stoop-netcdf", streams, (), attributes)


def _content(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            content = file.read(min(MAX_BYTES, os.fstat(file.fileno()).st_size) + 1)  # asks for what it reads
    except OSError as error:
        raise unreadable(path, error) from None
    if not content:
        raise LogError(f"{path}: the file is empty; write the flight again")
    if content[:3] != b"CDF":
        raise LogError(f"{path}: not a netCDF-3 file; read the original log instead")
    if len(content) > MAX_BYTES:
        raise LogError(f"{path}: larger than {MAX_BYTES >> 20} MiB; cut the flight")
    return content


def _parse(
    path: Path, content: bytes
) -> tuple[dict[str, str | float], dict[str, FloatArray], dict[str, FloatArray]]:
    """Let SciPy parse; it meets damage by any of a dozen exceptions, all of which mean the same."""
    from scipy.io import netcdf_file  # heavy, and only here

    try:
        with netcdf_file(io.BytesIO(content), mmap=False) as file:
            attributes = {name: _attribute(value) for name, value in vars(file)["_attributes"].items()}
            columns = _over(file, "time")
            traces = {name.removeprefix(f"{AIR}_"): trace for name, trace in _over(file, AIR).items()}
    except Exception as error:
        what = " ".join(str(error).split())[:120] or type(error).__name__
        raise LogError(f"{path}: damaged netCDF file ({what}); write the flight again") from None
    return attributes, columns, traces


def _over(file: netcdf_file, dimension: str) -> dict[str, FloatArray]:
    """Return the variables over one dimension."""
    return {
        name: np.array(variable.data, dtype=np.float64)
        for name, variable in file.variables.items()
        if variable.dimensions == (dimension,)
    }


def _attribute(value: Any) -> str | float:
    return value.decode("utf-8") if isinstance(value, bytes) else float(value)
