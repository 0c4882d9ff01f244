"""A flight: registry variables on one uniform grid, on the log's own clock, and what the user should know of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.html import table
from stoop.base.notices import Notice
from stoop.base.rotations import continuous, euler_angles, normalized, quaternions_of, wrap
from stoop.base.variables import EULER, QUATERNION, VARIABLES, WRAPPED, variable
from stoop.errors import FlightError
from stoop.flight.channels import SourceRate, source_rate
from stoop.flight.faults import Fault

if TYPE_CHECKING:
    import xarray as xr

    from stoop.flight.air_data import AirData

ENDINGS: Final = (
    ".gz", ".csv", ".ulg", ".ulog", ".nc", ".cdf", ".bin", ".log", ".usd", ".mat", ".parquet", ".pq", ".bag", ".mcap", ".db3",
)  #: of logs; what stands before them is the name of the flight  # fmt: skip


@dataclass(frozen=True, repr=False)
class Flight:
    """One flight, ready to be cut into maneuvers.

    Attributes
    ----------
    name : stem of the path, as in FLIGHT@START:STOP
    path : where it was read from, if anywhere
    data : registry variables (SI, body axes forward-right-down) over "time" [s, log's own clock],
        uniform, NaN where there is no data
    rate : Hz, of the grid
    sources : variable -> how it was recorded
    notices : what was found: gaps, faults, defects, what was reconstructed
    air : result of the air data reconstruction, where there was one
    faults : suspected faults of sensors; each has a notice too
    unmapped : stream -> columns of the log that no mapping names; not kept in files of our own
    """

    name: str
    path: Path | None
    data: xr.Dataset
    rate: float
    sources: Mapping[str, SourceRate]
    notices: tuple[Notice, ...] = ()
    air: AirData | None = None
    faults: tuple[Fault, ...] = ()
    unmapped: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def time(self) -> FloatArray:
        """Grid, shape (n,) [s, log's own clock]."""
        return self.data["time"].to_numpy()

    @property
    def names(self) -> frozenset[str]:
        """Variables of the flight."""
        return frozenset(str(name) for name in self.data.data_vars)

    def column(self, name: str) -> FloatArray:
        """Return a variable, shape (n,), SI, NaN where there is no data."""
        return self.data[name].to_numpy()

    def __repr__(self) -> str:
        """Return name, length and number of channels on one line."""
        length = float(self.time[-1] - self.time[0]) if self.time.size else 0.0
        return f"<Flight {self.name}: {length:.1f} s at {self.rate:g} Hz, {len(self.data)} channels>"

    def _repr_html_(self) -> str:
        rows = [
            (name, column.attrs.get("units", ""), column.attrs.get("long_name", ""))
            for name, column in self.data.items()
        ]
        return table(
            repr(self).strip("<>"), ("channel", "unit", "meaning"), [tuple(map(str, r)) for r in rows]
        )


def from_columns(
    name: str,
    time: FloatArray,
    columns: Mapping[str, FloatArray],
    notices: tuple[Notice, ...] = (),
    source: str = "simulation",
) -> Flight:
    """Make a flight of channels that already lie on one uniform grid; nothing is filtered.

    Parameters
    ----------
    name : as in FLIGHT@START:STOP
    time : (n,) s, uniform
    columns : registry variable -> (n,) SI, NaN where there is no data; from Euler angles the quaternion
        is added, and the other way around; phi and psi of any number of turns are brought into (-pi, pi]
    notices : for the user
    source : where the channels come from

    Raises
    ------
    FlightError
        When a variable is unknown, a column is too short, or the time is not uniform.
    """
    time = np.ascontiguousarray(time, dtype=np.float64)
    steps = np.diff(time)
    if time.ndim != 1 or time.size < 2 or not np.all(steps > 0.0):
        raise FlightError(f"{name}: the time does not increase; give two and more rising samples")
    period = float((time[-1] - time[0]) / steps.size)
    if np.max(np.abs(steps - period)) > 1e-3 * period:
        raise FlightError(f"{name}: the time is not uniform; save the channels as CSV and load that instead")
    rate = 1.0 / period
    if abs(rate - round(rate)) < 1e-6 * rate:  # whole but for the rounding of the time stamps
        rate = float(round(rate))
    data = {key: np.asarray(values, dtype=np.float64) for key, values in columns.items()}
    for key, values in data.items():
        variable(key, name)
        if values.shape != time.shape:
            raise FlightError(
                f"{name}: '{key}' has {values.size} samples, the time {time.size}; give as many"
            )
    data = with_attitude(on_circle(data))
    ordered = {key: data[key] for key in VARIABLES if key in data}
    sources = {key: source_rate(source, time[np.isfinite(values)]) for key, values in ordered.items()}
    return Flight(name, None, dataset(time, ordered), rate, sources, notices)


def on_circle(data: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Bring phi and psi into (-pi, pi]: differences between them are taken within one turn."""
    return {key: wrap(values) if key in WRAPPED else values for key, values in data.items()}


def with_attitude(data: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Add the quaternion to Euler angles, or Euler angles to the quaternion, where the other is missing."""
    if set(QUATERNION) <= set(data):
        if set(EULER) <= set(data):
            return data
        parts = normalized(np.column_stack([data[key] for key in QUATERNION]))
        return {**data, **dict(zip(EULER, euler_angles(parts).T, strict=True))}
    if not set(EULER) <= set(data):
        return data
    parts = continuous(quaternions_of(np.column_stack([data[key] for key in EULER])))
    return {**data, **dict(zip(QUATERNION, parts.T, strict=True))}


def dataset(time: FloatArray, data: Mapping[str, FloatArray]) -> xr.Dataset:
    """Make a data set of gridded variables, with units and meanings from the registry."""
    import xarray as xr  # heavy, and only here

    columns = {}
    for name, x in data.items():
        known = VARIABLES[name]
        texts = {
            "units": known.unit,
            "long_name": known.meaning,
            "frame": known.frame,
            "positive": known.sign,
        }
        columns[name] = ("time", x, {key: value for key, value in texts.items() if value})
    clock = ("time", time, {"units": "s", "long_name": "time on the log's own clock"})
    return xr.Dataset(columns, coords={"time": clock})


def flight_name(path: Path) -> str:
    """Return the name by which a maneuver refers to a flight: the path's last part without endings."""
    stem = path.resolve().name
    for ending in ENDINGS:
        stem = stem.removesuffix(ending)
    return stem
