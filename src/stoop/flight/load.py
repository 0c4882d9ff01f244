"""Log -> Flight."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from stoop import logs
from stoop.flight.build import build
from stoop.flight.channels import Channels
from stoop.flight.flight import Flight, flight_name
from stoop.flight.px4 import px4_channels
from stoop.flight.variables import VARIABLES
from stoop.logs import FloatArray, Recording

if TYPE_CHECKING:
    import xarray as xr

DEFAULT_RATE: Final = 100.0  #: Hz


def load(path: str | Path, mapping: str | Path | None = None, rate: float = DEFAULT_RATE) -> Flight:
    """Read a log and lay its channels on one uniform grid.

    Parameters
    ----------
    path : see `stoop.logs.read`
    mapping : TOML file for CSV logs
    rate : Hz, of the grid; a flight written by stoop keeps the rate it was written with

    Returns
    -------
    Flight : with air data reconstructed when the log has no vane

    Raises
    ------
    LogError, FlightError
    """
    path = Path(path)
    recording = logs.read(path, Path(mapping) if mapping is not None else None)
    channels = channels_of(recording)
    grid, data, sources = build(channels, rate, str(path))
    notes = tuple(str(defect) for defect in recording.defects)
    return Flight(flight_name(path), path, dataset(grid.time, data), rate, sources, notes)


def channels_of(recording: Recording) -> list[Channels]:
    """Name the channels of a recording by the registry."""
    return px4_channels(recording)


def dataset(time: FloatArray, data: Mapping[str, FloatArray]) -> xr.Dataset:
    """Make a data set of gridded variables, with units and meanings from the registry."""
    import xarray as xr  # heavy, and only here

    columns = {name: ("time", x, _attributes(name)) for name, x in data.items()}
    clock = ("time", time, {"units": "s", "long_name": "time on the log's own clock"})
    return xr.Dataset(columns, coords={"time": clock})


def _attributes(name: str) -> dict[str, str]:
    known = VARIABLES[name]
    return {"units": known.unit, "long_name": known.meaning, "frame": known.frame, "positive": known.sign}
