"""Our own flight files: netCDF-3, all of a `Flight`, written whole or not at all."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.files import write_bytes_atomic
from stoop.base.notices import Notice, from_dict, notice
from stoop.base.variables import VARIABLES
from stoop.errors import LogError
from stoop.flight.air_data import AirData
from stoop.flight.channels import MAX_VALUE, SourceRate
from stoop.flight.faults import Fault, described
from stoop.flight.flight import Flight, dataset, on_circle
from stoop.logs import Recording
from stoop.logs.netcdf import AIR, FORMAT, STREAM

_FOREIGN: Final = "holds what stoop did not write; write the flight again"
NOTICES: Final = "notices"  #: attribute; files of older versions hold sentences as "notes"


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
    faults = [{**fault.to_dict(), "notice": fault.notice.to_dict()} for fault in flight.faults]
    attributes = {
        "stoop_format": FORMAT,
        "name": flight.name,
        "rate": flight.rate,
        "sources": json.dumps({name: asdict(source) for name, source in flight.sources.items()}),
        NOTICES: json.dumps([found.to_dict() for found in flight.notices]),
        "faults": json.dumps(faults),
    }
    data = flight.data.assign_attrs(attributes)
    if flight.air is not None:
        air = {item.name: getattr(flight.air, item.name) for item in fields(AirData) if item.name != "traces"}
        air[NOTICES] = [found.to_dict() for found in flight.air.notices]
        data = data.assign_attrs(air=json.dumps(air))
        data = data.assign({f"{AIR}_{name}": (AIR, trace) for name, trace in flight.air.traces.items()})
    content = data.to_netcdf(engine="scipy", format="NETCDF3_64BIT")
    write_bytes_atomic(Path(path), bytes(content))


def restore(recording: Recording, name: str) -> Flight:
    """Make the flight of a recording that `save` wrote.

    Raises
    ------
    LogError
        When its attributes are not what `save` writes.
    """
    stream = recording.streams[STREAM]
    data = {key: stream.columns[key] for key in VARIABLES if key in stream.columns}
    content: Mapping[str, Any] = recording.attributes
    try:
        rate = float(content["rate"])
        sources = {key: SourceRate(**entry) for key, entry in json.loads(content["sources"]).items()}
        notices = _notices({key: json.loads(content[key]) for key in (NOTICES, "notes") if key in content})
        faults = tuple(_fault(entry) for entry in json.loads(content["faults"]))
        air = None
        if "air" in content:
            entries = json.loads(content["air"])
            found = _notices({key: entries.pop(key) for key in (NOTICES, "notes") if key in entries})
            numbers: dict[str, Any] = {
                key: tuple(x) if isinstance(x, list) else x for key, x in entries.items()
            }
            traces = recording.streams.get(AIR)
            curves = {} if traces is None else {"time": traces.time, **traces.columns}
            air = AirData(**numbers, notices=found, traces=curves)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError):
        raise LogError(f"{recording.path}: {_FOREIGN}") from None
    uniform = (
        rate > 0.0 and math.isfinite(rate) and bool(np.all(np.abs(np.diff(stream.time) * rate - 1.0) < 1e-2))
    )
    possible = bool(data) and not any((np.abs(values) > MAX_VALUE).any() for values in data.values())
    if not (uniform and possible and set(data) <= set(sources)):
        raise LogError(f"{recording.path}: {_FOREIGN}")
    columns = on_circle(data)
    return Flight(name, recording.path, dataset(stream.time, columns), rate, sources, notices, air, faults)


def _notices(content: Mapping[str, Any]) -> tuple[Notice, ...]:
    """Read notices, or the sentences that older versions wrote."""
    if NOTICES in content:
        found = tuple(from_dict(entry) for entry in content[NOTICES])
        _ = [str(one) for one in found]  # raises where a value that the sentence needs is missing
        return found
    return tuple(notice("untyped-flight-note", text=str(sentence)) for sentence in content["notes"])


def _fault(content: Mapping[str, Any]) -> Fault:
    entries = dict(content)
    sentence, found = str(entries.pop("message")), entries.pop("notice", None)
    fault = described(**entries, text=sentence)
    if found is None:
        return fault
    (known,) = _notices({NOTICES: [found]})
    return Fault(**entries, notice=known)
