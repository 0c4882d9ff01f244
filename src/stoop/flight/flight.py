"""A flight: registry variables on one uniform grid, on the log's own clock, and what the user should know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.base.arrays import FloatArray
from stoop.flight.channels import SourceRate
from stoop.flight.faults import Fault

if TYPE_CHECKING:
    import xarray as xr

    from stoop.flight.reconstruction import AirData


@dataclass(frozen=True)
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
    notes : plain words for the user: gaps, faults, defects, what was reconstructed
    air : result of the flight-path reconstruction, where there was one
    faults : suspected faults of sensors
    unmapped : stream -> columns of the log that no mapping names; not kept in files of our own
    """

    name: str
    path: Path | None
    data: xr.Dataset
    rate: float
    sources: Mapping[str, SourceRate]
    notes: tuple[str, ...] = ()
    air: AirData | None = None
    faults: tuple[Fault, ...] = ()
    unmapped: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def time(self) -> FloatArray:
        """Grid, shape (n,) [s, log's own clock]."""
        return self.data["time"].to_numpy()

    def column(self, name: str) -> FloatArray:
        """Return a variable, shape (n,), SI, NaN where there is no data."""
        return self.data[name].to_numpy()
