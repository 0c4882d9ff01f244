"""Our own flight files: netCDF-3, all of a `Flight`, written whole or not at all."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.files import write_bytes_atomic
from stoop.base.variables import VARIABLES
from stoop.errors import LogError
from stoop.flight.channels import WILD, SourceRate
from stoop.flight.faults import Fault
from stoop.flight.flight import Flight
from stoop.flight.make import dataset, on_circle
from stoop.logs import Recording, Stream
from stoop.logs.netcdf import AIR, FORMAT, STREAM

if TYPE_CHECKING:
    from stoop.flight.reconstruction import AirData

_BAD: Final = "holds what stoop did not write; write the flight again"


def save(flight: Flight, path: str | Path) -> None:
    """Write a flight as netCDF-3; `load` of the file gives it back bit for bit.

    Parameters
    ----------
    flight : what to write
    path : the file, usually NAME.nc

    Raises
    ------
    OutputError
        When it cannot be written; an older file of that name is then still whole.
    """
    attributes = {
        "stoop_format": FORMAT,
        "name": flight.name,
        "rate": flight.rate,
        "sources": json.dumps({name: asdict(source) for name, source in flight.sources.items()}),
        "notes": json.dumps(list(flight.notes)),
        "faults": json.dumps([asdict(fault) for fault in flight.faults]),
    }
    data = flight.data.assign_attrs(attributes)
    if flight.air is not None:
        data = data.assign_attrs(air=json.dumps(_air_numbers(flight.air)))
        traces = {f"{AIR}_{name}": (AIR, trace) for name, trace in flight.air.traces.items()}
        data = data.assign(traces)
    content = data.to_netcdf(engine="scipy", format="NETCDF3_64BIT")
    write_bytes_atomic(Path(path), bytes(content))


def _air_numbers(air: AirData) -> dict[str, Any]:
    return {item.name: getattr(air, item.name) for item in fields(air) if item.name != "traces"}


def restore(recording: Recording, name: str) -> Flight:
    """Make the flight of a recording that `save` wrote.

    Raises
    ------
    LogError
        When its attributes are not what `save` writes.
    """
    stream = recording.streams[STREAM]
    data = {key: stream.columns[key] for key in VARIABLES if key in stream.columns}
    try:
        rate = float(recording.attributes["rate"])
        sources = {key: SourceRate(**entry) for key, entry in _json(recording, "sources").items()}
        notes = tuple(str(note) for note in _json(recording, "notes"))
        faults = tuple(Fault(**entry) for entry in _json(recording, "faults"))
        air = _air(recording)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError):
        raise LogError(f"{recording.path}: {_BAD}") from None
    if not (_uniform(stream.time, rate) and _all_numbers(data) and set(data) <= set(sources)):
        raise LogError(f"{recording.path}: {_BAD}")
    columns = on_circle(data)
    return Flight(name, recording.path, dataset(stream.time, columns), rate, sources, notes, air, faults)


def _uniform(time: FloatArray, rate: float) -> bool:
    return math.isfinite(rate) and rate > 0.0 and bool(np.all(np.abs(np.diff(time) * rate - 1.0) < 1e-2))


def _all_numbers(data: Mapping[str, FloatArray]) -> bool:
    """Tell whether there is a channel at all and none is beyond any size."""
    return bool(data) and not any((np.abs(values) > WILD).any() for values in data.values())


def _json(recording: Recording, key: str) -> Any:
    return json.loads(str(recording.attributes[key]))


def _air(recording: Recording) -> AirData | None:
    if "air" not in recording.attributes:
        return None
    from stoop.flight.reconstruction import AirData

    numbers = {key: _frozen(value) for key, value in _json(recording, "air").items()}
    stream = recording.streams.get(AIR)
    return AirData(**numbers, traces=_traces(stream) if stream is not None else {})


def _traces(stream: Stream) -> dict[str, FloatArray]:
    return {"time": stream.time, **stream.columns}


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
