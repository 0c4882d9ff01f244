"""Log -> Flight, and our own flight files: netCDF-3, all of a `Flight`, written whole or not at all."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.files import write_file
from stoop.base.notices import Notice, attempt, notice
from stoop.base.numbers import MAX_NUMBER
from stoop.base.packages import hooks
from stoop.base.toml import parse_json
from stoop.base.variables import EULER, QUATERNION, RATES, VARIABLES
from stoop.errors import FlightError, LogError
from stoop.flight import gridding
from stoop.flight.air_data import with_air
from stoop.flight.airspeed import EQUIVALENT, TRUE, with_true_airspeed
from stoop.flight.apply_mapping import Mapped
from stoop.flight.faults import Fault, contradiction, recorded_faults, rest_faults
from stoop.flight.flight import AirData, Flight, Gridded, flight_name, on_circle, with_attitude
from stoop.flight.pose import pose_alone, with_motion, without_jumps
from stoop.flight.repeated_readings import at_own_rates
from stoop.logs import Recording
from stoop.logs.netcdf import AIR, FORMAT, STREAM

SUSPECT_CLOCK: Final = 5.0  #: Hz; body rates are hardly ever logged more slowly
SLOW_RATES: Final = 25.0  #: Hz; body rates below this do not show the fast modes
NOTICES: Final = "notices"  #: attribute; files of older versions hold sentences as "notes"


def load_flight(path: str | Path, mapping: str | Path | None = None, rate: float | None = None) -> Flight:
    """Read a log and lay its channels on one uniform grid.

    Channels faster than the grid are low-passed first (zero phase, per contiguous stretch). Nothing is
    interpolated across gaps. Without a vane, V, alpha and beta are reconstructed from the velocity over
    ground, the attitude and an estimated steady wind.

    Parameters
    ----------
    path : see `stoop.logs.read`
    mapping : TOML file, see `stoop.flight.mapping`; None looks beside the log, else takes the ready one
    rate : Hz, of the grid; None takes that of the fastest channel, in tens from 50 to 100 Hz. A flight written by stoop
        keeps the rate it was written with

    Raises
    ------
    LogError
        When the log cannot be read.
    FlightError
        When it holds no known variable, or degrees where radians belong.
    """
    if not isinstance(path, str | Path):
        raise FlightError(
            f"the path of a log is expected, not a {type(path).__name__}; give a table straight to stoop.fit or stoop.look"
        )
    path = Path(path)
    return of_recording(path, *Mapped.read(path, Path(mapping) if mapping is not None else None), rate)


def of_recording(
    path: Path, recording: Recording, mapped: Mapped | None, rate: float | None = None
) -> Flight:
    """Lay the mapped channels of a recording on one uniform grid; see `load` and `Mapped.read`."""
    if mapped is None:
        return _restore(recording, flight_name(path))
    cleaned = [gridding.drop_outliers(group) for group in mapped.channels]
    if pose_alone({name for group in mapped.channels for name in group.values}):
        tracked = [(without_jumps(group), found) for group, found in cleaned]
        cleaned = [(kept, [*found, *lost]) for (kept, lost), found in tracked]
    apart = [at_own_rates(group) for group, _ in cleaned]
    channels = [one for groups, _ in apart for one in groups]
    grid, data, sources = gridding.grid_channels(channels, rate, str(path))
    rate = grid.rate
    # an attitude whose parts came from several files is completed; its rate is that of the slowest
    parts = [sources[name] for name in (*EULER, *QUATERNION) if name in sources]
    whole = with_attitude(data)
    sources |= {name: min(parts, key=lambda part: part.rate) for name in whole.keys() - data.keys()}
    data = {name: whole[name] for name in VARIABLES if name in whole}
    failed: list[Notice] = []  # of detectors
    recorded = attempt(failed, [], recorded_faults, channels)
    airspeed: list[Notice] = []
    if EQUIVALENT in data and not {TRUE, "V"} & data.keys():
        data, airspeed = with_true_airspeed(data, sources[EQUIVALENT].source)
        sources[TRUE] = sources[EQUIVALENT]
    if {EQUIVALENT, TRUE} <= data.keys():
        recorded = [replace(f, variable=TRUE) if f.variable == EQUIVALENT else f for f in recorded]
    # a mapping is judged in flight: on the ground estimators hold zeros, and sensors stand still
    gridded = Flight(flight_name(path), path, Gridded(grid.time, data), rate, sources)
    up = attempt(failed, np.ones(grid.time.size, dtype=bool), Flight.in_flight, gridded)
    flown = [up[(grid.time >= fault.start) & (grid.time <= fault.stop)].any() for fault in recorded]
    pairs = [(fault, moving) for fault, moving in zip(recorded, flown, strict=True) if fault.variable in data]
    recorded = [fault for fault, moving in pairs if fault.kind != "stuck" or moving]
    of_mapping = _contradictions(gridded, up, channels, recorded, failed, mapped)
    faults = (*recorded, *attempt(failed, [], rest_faults, grid.time, data, rate), *of_mapping)
    attitude: list[Notice] = []
    if not any(fault.kind == "inconsistent" for fault in of_mapping):
        data, attitude = gridding.interpolate_by_rates(grid, data, sources, channels)
    # defects of topics that supply nothing do not matter to the user; a file's name writes a topic with _
    used = {name for s in sources.values() for name in (s.source, s.source.replace("/", "_"))}
    notices = [one for _, found in (*cleaned, *apart) for one in found]
    grave = ("corrupt", "truncated", "dropout")
    told = [d for d in recording.defects if d.kind in grave or any(topic in d.place for topic in used)]
    notices += [notice("log-defect", d.place, kind=d.kind, text=d.message) for d in told]
    notices += [*mapped.notices, *attitude, *airspeed]
    gaps = {source.source: source for source in sources.values() if source.gaps}
    if gaps:
        counts = tuple(f"{name} {s.gaps} (up to {s.longest_gap:.2f} s)" for name, s in gaps.items())
        notices.append(notice("gaps", counts=counts))
    notices += [fault.notice for fault in faults]
    common = (flight_name(path), path, Gridded(grid.time, data), rate, sources, tuple(notices), None, faults)
    flight = Flight(*common, mapped.unmapped, recording.parameters)
    flight = attempt(failed, flight, with_air, attempt(failed, flight, with_motion, flight))
    # what this record cannot show, whatever is fitted to it
    limits = []
    body_rates = {name: sources[name].rate for name in RATES if name in sources}
    slow = {name: known for name, known in body_rates.items() if 0.0 < known < SLOW_RATES}
    if slow:
        lowest = min(slow.values())
        code = "slow-rates-suspect-clock" if lowest < SUSPECT_CLOCK else "slow-rates"
        limits.append(notice(code, variables=tuple(slow), rate=lowest))
    explained = flight.air is not None and bool(flight.air.notices)  # the reconstruction knows better why
    if not {"V", "alpha", "beta"} & flight.names and not flight.carried_by_rotors() and not explained:
        limits.append(notice("no-air-data"))
    return flight.with_notices((*limits, *failed))


def load_several(
    paths: Sequence[str | Path], mapping: str | Path | None = None, beside: Sequence[Flight] = ()
) -> list[Flight]:
    """Read logs onto grids of one rate: that of the fastest of them and of the flights `beside` them; see `load`."""
    flights = [load_flight(path, mapping) for path in paths]
    rate = max((flight.rate for flight in (*flights, *beside)), default=0.0)
    pairs = zip(paths, flights, strict=True)
    return [one if one.rate == rate else load_flight(path, mapping, rate) for path, one in pairs]


def _contradictions(
    flight: Flight,
    up: BoolArray,
    channels: Sequence[gridding.Channels],
    faults: Sequence[Fault],
    failed: list[Notice],
    mapped: Mapped | None = None,
) -> tuple[Fault, ...]:
    """Return what packages find that contradicts units, signs and axes of a flight's columns, from samples in the air (`up`)."""
    judges, span = hooks("judge_mapping", list[Notice]), flight.time[[0, -1]].tolist()
    failed += [] if judges else [notice("mapping-not-judged")]
    found = (one for judge in judges for one in judge(flight, up, channels, faults, failed, mapped))
    return tuple(contradiction(one, *span) for one in found)


def with_contradictions(flight: Flight) -> Flight:
    """Return a flight made of columns with what contradicts their units, signs and axes, as `load` finds it in a log.

    Raises
    ------
    FlightError
        When angles or rates are in degrees.
    """
    failed: list[Notice] = []
    columns = {name: flight.column(name) for name in flight.sources}
    channels = [gridding.Channels("the table", flight.time, columns)]
    up = attempt(failed, np.ones(flight.time.size, dtype=bool), Flight.in_flight, flight)
    recorded = attempt(failed, [], recorded_faults, channels)
    faults = _contradictions(flight, up, channels, recorded, failed)
    notices = (*flight.notices, *(fault.notice for fault in faults), *failed)
    return replace(flight, data=vars(flight)["data"], faults=faults, notices=notices)


def save_flight(flight: Flight, path: str | Path) -> None:
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
    write_file(Path(path), flight_bytes(flight))


def flight_bytes(flight: Flight) -> bytes:
    """Return the content of the file that `save` writes."""
    from scipy.io import netcdf_file  # heavy, and only here

    faults = [{**fault.to_dict(), "notice": fault.notice.to_dict()} for fault in flight.faults]
    attributes = flight.attributes | {
        "stoop_format": FORMAT,
        "name": flight.name,
        "rate": flight.rate,
        "sources": json.dumps({name: asdict(source) for name, source in flight.sources.items()}),
        "notices": json.dumps([found.to_dict() for found in flight.notices]),
        "faults": json.dumps(faults),
    }
    traces: Mapping[str, FloatArray] = {}
    if flight.air is not None:
        air = {item.name: getattr(flight.air, item.name) for item in fields(AirData) if item.name != "traces"}
        air[NOTICES] = [found.to_dict() for found in flight.air.notices]
        attributes["air"] = json.dumps(air)
        traces = flight.air.traces
    content = io.BytesIO()
    file = netcdf_file(content, "w", version=2)

    def written(value: Any) -> Any:
        """Return an attribute as netCDF-3 has it."""
        return value.encode() if isinstance(value, str) else np.atleast_1d(np.asarray(value, np.float64))

    def add(name: str, dimension: str, values: FloatArray, said: Mapping[str, Any]) -> None:
        """Add a column with what is said of it."""
        variable = file.createVariable(name, np.dtype(np.float64), (dimension,))
        variable[:] = values
        for key, value in {**said, "_FillValue": np.nan}.items():
            setattr(variable, key, written(value))

    for key, value in attributes.items():
        setattr(file, key, written(value))
    file.createDimension("time", flight.time.size)
    for name in flight.channels:
        add(name, "time", flight.column(name), flight.texts(name))
    add("time", "time", flight.time, flight.texts("time"))
    if traces:
        file.createDimension(AIR, next(iter(traces.values())).size)
    for name, trace in traces.items():
        add(f"{AIR}_{name}", AIR, trace, {})
    file.flush()
    return content.getvalue()


def _restore(recording: Recording, name: str) -> Flight:
    """Make the flight of a recording that `save` wrote."""
    foreign = f"{recording.path}: holds what stoop did not write; write the flight again"
    stream = recording.streams[STREAM]
    data = {key: stream.columns[key] for key in VARIABLES if key in stream.columns}
    content: Mapping[str, Any] = recording.attributes
    try:
        rate = float(content["rate"])
        sources = {key: _source(entry) for key, entry in parse_json(content["sources"]).items()}
        notices = _notices({key: parse_json(content[key]) for key in (NOTICES, "notes") if key in content})
        faults = []
        for entry in parse_json(content["faults"]):
            sentence, known = str(entry.pop("message")), entry.pop("notice", None)
            of_file = notice("described-fault", entry["variable"], text=sentence)  # of an older version
            (found,) = _notices({NOTICES: [known]}) if known is not None else (of_file,)
            faults.append(Fault(**entry, notice=found))
        air = None
        if "air" in content:
            entries = parse_json(content["air"])
            told = _notices({key: entries.pop(key) for key in (NOTICES, "notes") if key in entries})
            items = entries.items()
            numbers: dict[str, Any] = {k: tuple(x) if isinstance(x, list) else x for k, x in items}
            traces = recording.streams.get(AIR)
            curves = {} if traces is None else {"time": traces.time, **traces.columns}
            air = AirData(**numbers, notices=told, traces=curves)
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError):
        raise LogError(foreign) from None
    uniform = rate > 0.0 and math.isfinite(rate)
    uniform = uniform and bool(np.all(np.abs(np.diff(stream.time) * rate - 1.0) < 1e-2))
    if not (uniform and data and set(data) <= set(sources)):
        raise LogError(foreign)
    # what was possible when it was written stays, also where a filter went beyond what was recorded
    data, dropped = gridding.drop_impossible(recording.path.name, data, MAX_NUMBER)
    columns = Gridded(stream.time, on_circle(data))
    return Flight(name, recording.path, columns, rate, sources, (*notices, *dropped), air, tuple(faults))


def _source(entry: Mapping[str, Any]) -> gridding.SourceRate:
    """Read how a variable was recorded."""
    return gridding.SourceRate(**{**entry, "readings": tuple(map(int, entry.get("readings", ())))})


def _notices(content: Mapping[str, Any]) -> tuple[Notice, ...]:
    """Read notices, or the sentences that older versions wrote."""
    if NOTICES in content:
        return tuple(Notice.from_dict(entry) for entry in content[NOTICES])
    return tuple(notice("untyped-flight-note", text=str(sentence)) for sentence in content["notes"])
