"""Figures of many logs: each log is a run of a campaign, so that one that was read is not read again.

A log is read again when the content of it, its mapping or the vehicle, its mass, or the method changed; a broken one costs its
own row.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop import Flight, Vehicle, load_vehicle
from stoop.extend.campaigns import Plan, Run, environment, forget
from stoop.extend.errors import StoopError
from stoop.extend.files import csv_text, file_hashes
from stoop.extend.flights import ENDINGS, FlightMapping, Mapped, flight_name, of_recording
from stoop.extend.recordings import kind, mapping_beside
from stoop.extend.vehicles import BUILT_IN, require_channels
from stoop_fleet.headers import CLOCKS, Dated, contradictions, header
from stoop_fleet.table import LOGS, FigureTable, columns_of, of_frames, read_frame

WORK: Final = "stoop_fleet.logs:read"
SAID: Final = ("vehicle", "time")  #: of a flight, by the table of flights, else by its log
FIGURE: Final = ("figure", "value", "std_error", "parts", "unit")
STORES, ABSENT, DATES = "logs-*.sqlite", "absent.csv", "dates.csv"
ABSENTEES: Final = ("flight", "group", "reason")
DATED: Final = ("flight", "vehicle", "time", "end", "count", "content")  #: by the logs; hash of the log
MASS: Final = "mass"  #: kg, of a flight, by the table of flights
NO_CONDITIONS: Final = ("end", "count", MASS)


def is_table(path: Path) -> bool:
    """Tell whether a file is a table of figures, by its columns; a log may be CSV or Parquet, too."""
    return {"figure", "std_error"} <= set(columns_of(path))


@dataclass(frozen=True, eq=False)
class Reading:
    """How the logs of a command are read, by the names of their flights."""

    campaign: Plan
    runs: Mapping[str, Run]  #: of the campaign
    copies: Mapping[str, str]  #: flight without a run -> earlier one of the store, of which its log is a copy
    flights: Path | None  #: table of flights
    given: Mapping[str, Mapping[str, Any]]  #: what it tells of each


def plan(
    logs: Sequence[Path], vehicle: str | None, mapping: Path | None, flights: Path | None, folder: Path
) -> Reading:
    """Return how logs are read for the store in a folder.

    Raises
    ------
    StoopError
        A log or another file is not there, a log stands there twice, two logs have one name, or the table of flights is wrong.
    """
    _require_logs(logs, mapping)
    given = {} if flights is None else _given(flights)
    own = {flight_name(path): path for path in sorted(logs, key=flight_name)}
    contents = {flight: _hash(path) for flight, path in own.items()}
    copies = _copies(own, contents, folder)
    places: dict[str, Any] = {"mapping": None if mapping is None else str(mapping.absolute())}
    places["vehicle"] = vehicle if vehicle is None or vehicle in BUILT_IN else str(Path(vehicle).absolute())
    depends = [None if vehicle is None else _digest(load_vehicle(vehicle).text)]
    depends += [None if mapping is None else _hash(mapping)]
    runs = {}
    for flight in [one for one in own if one not in copies]:
        arguments: dict[str, Any] = {
            "content": contents[flight],
            "endings": [one for one in own[flight].suffixes if one.lower() in ENDINGS],
            "depends": [*depends, *map(_hash, _beside(own[flight], mapping))],
            "mass": None if vehicle is None else given.get(flight, {}).get(MASS),
        }
        key = Run("log", WORK, arguments).identity
        runs[flight] = Run(key, WORK, arguments, places={"log": str(own[flight].absolute()), **places})
    return Reading(Plan("fleet", {}, tuple(runs.values())), runs, copies, flights, given)


def _require_logs(logs: Sequence[Path], mapping: Path | None) -> None:
    """Refuse what is not there, folders of several logs, and logs of one name."""
    for path in (*logs, *filter(None, [mapping])):
        if not (path.is_file() or path.is_dir()):
            raise StoopError(f"{path}: there is no such file")
        if path.is_dir() and not _is_log(path, mapping):
            raise StoopError(
                f"{path}: a folder, and not of one log; name its logs, such as stoop fleet {path}/*.ulg"
            )
    for name, several in Counter(map(flight_name, logs)).items():
        if several > 1:
            raise StoopError(
                f"{several} logs are called {name}; rename them, flights go by the names of their logs"
            )


def _copies(logs: Mapping[str, Path], contents: Mapping[str, str], folder: Path) -> dict[str, str]:
    """Return the flights whose logs are those of earlier flights of other names, which are returned, too."""
    flown = {
        content: flight
        for flight, *_, content in _kept(folder / DATES, (), DATED)
        if content and contents.get(flight, content) == content
    }
    copies, first = dict[str, str](), dict[str, str]()
    for flight, content in contents.items():
        if (earlier := flown.get(content, flight)) != flight:
            copies[flight] = earlier
        elif (other := first.setdefault(content, flight)) != flight:
            raise StoopError(f"{logs[flight]}: is the same log as {logs[other]}; leave one out")
    return copies


def _is_log(folder: Path, mapping: Path | None) -> bool:
    """Tell whether the files of a folder are one log."""
    return mapping is not None or mapping_beside(folder).is_file() or bool(kind(folder))


def _beside(path: Path, mapping: Path | None) -> list[Path]:
    """Return the mapping beside a log, and the further files that its mapping names."""
    own = [one for one in [mapping_beside(path)] if one.is_file()]
    folder, names = path if path.is_dir() else path.parent, list[str]()
    with suppress(StoopError):  # reading the log reports it
        names = [
            name for one in [mapping, *own][:1] if one for name in FlightMapping.read(one).files.values()
        ]
    return [*own, *(file for name in names if (file := folder / Path(name).name).is_file())]


def _hash(path: Path) -> str:
    """Return the hash of a file or folder; of a bag all files count."""
    bag = path.is_dir() and kind(path) == "rosbag"
    return _digest("".join(file_hashes(sorted(path.iterdir()) if bag else [path]).values()))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def store_of(folder: Path) -> Path:
    """Return where the campaign is kept: a file for each state of the method; those of others are removed."""
    here = _digest(repr(sorted(environment([WORK]).items())))
    own = folder / STORES.replace("*", here[:16])
    for other in folder.glob(STORES):
        if other != own:
            forget(other)
    return own


def read(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Return the figures of a log, and what its header says: a run of the campaign."""
    from stoop_fleet.log_figures import conditions, figures_of  # it needs all of stoop
    from stoop_fleet.vibration import vibration

    paths = [("LOG", "log"), ("MAPPING", "mapping"), ("VEHICLE", "vehicle")]
    places = {word: Path(arguments[name]) for word, name in paths if arguments[name] is not None}
    try:
        vehicle = None if "VEHICLE" not in places else load_vehicle(places["VEHICLE"])
        if vehicle is not None and arguments["mass"] is not None:
            vehicle = vehicle.with_numbers({"mass.mass": {"value": arguments["mass"]}})
        recording, mapped = Mapped.read(places["LOG"], places.get("MAPPING"), CLOCKS)
        said = header(recording)
        shaken = vibration([] if mapped is None else mapped.channels)
        nowhere = Path("LOG")  # nothing depends on the name
        flight = of_recording(nowhere, replace(recording, path=nowhere), mapped)
        del recording, mapped  # of which the memory is needed
        if vehicle is not None:
            _require_own(vehicle, flight)
        found, absent = figures_of(flight, vehicle, shaken)
    except StoopError as error:
        return [{"figures": [], "absent": {"log": _nowhere(str(error), places)}, "header": {}}]
    rows: list[Any] = [[one.name, one.value, one.std_error, one.parts, one.unit] for one in found]
    known: dict[str, Any] = {"vehicle": said.vehicle, "software": said.software, "count": said.count}
    known |= dict(conditions(flight))
    if said.zero is not None:
        known |= {"time": said.zero + float(flight.time[0]), "end": said.zero + float(flight.time[-1])}
    reasons: dict[str, Any] = {group: _nowhere(reason, places) for group, reason in absent.items()}
    return [{"figures": rows, "absent": reasons, "header": {k: x for k, x in known.items() if x}}]


def _require_own(vehicle: Vehicle, flight: Flight) -> None:
    """Refuse a flight of another kind of vehicle: none of the inputs was recorded, or of some rotors only."""
    recorded = {n for n in vehicle.recorded if n in flight.names and np.isfinite(flight.column(n)).any()}
    rotors = {rotor.channel for rotor in vehicle.file.rotor.values()}
    if not recorded or set() < rotors & recorded < rotors:
        require_channels(vehicle, flight)


def _nowhere(message: str, places: Mapping[str, Path]) -> str:
    """Return the first line of a message without paths: the next time the files may lie elsewhere."""
    line = message.splitlines()[0]
    for name, path in places.items():
        for text in (str(path), *[path.name] * bool(path.suffix)):
            line = line.replace(text, name)
    return line.removeprefix("LOG: ")


@dataclass(frozen=True, eq=False)
class LogFigures:
    """Figures of all logs so far, and the files of a store that go with them.

    Attributes
    ----------
    absent : (flight, group, reason) of the logs of this command: what they cannot tell
    files : name -> text, of what no log could tell, and of when the logs say that they flew
    """

    table: FigureTable
    absent: Sequence[tuple[str, str, str]]
    files: Mapping[str, str]


def gathered(reading: Reading, results: Mapping[str, Any], folder: Path) -> LogFigures:
    """Return the figures of the logs, with those of other logs that the store in a folder has.

    Raises
    ------
    StoopError
        No log gave a figure.
    """
    import pandas as pd  # a worker needs none

    given, logs = reading.given, {flight: results[run.key] for flight, run in reading.runs.items()}
    said = {f: {**one["header"], **given.get(f, {})} for f, one in logs.items() if "log" not in one["absent"]}
    out = {f: f"is the same log as flight {other}; leave it out" for f, other in reading.copies.items()}
    out |= {
        flight: _unknown(lost, flight, reading.flights, flight in given)
        for flight, one in said.items()
        if (lost := [name for name in SAID if name not in one])
    }
    anew = {*logs, *out}
    dates = [
        _date(one, flight, "time" in given.get(flight, {}), str(reading.runs[flight].arguments["content"]))
        for flight, one in said.items()
        if flight not in out
    ]
    earlier = dict.fromkeys(_kept(folder / DATES, (), DATED))
    others = [row for row in earlier if row[0] not in anew]
    out |= contradictions(_dated([*others, *dates]), {row[0] for row in dates if row not in earlier})
    own = {f: {k: x for k, x in one.items() if k not in NO_CONDITIONS} for f, one in said.items()}
    rows = [
        {"flight": f, **own[f], **dict(zip(FIGURE, figure, strict=True))}
        for f, one in logs.items() if f not in out for figure in one["figures"]
    ]  # fmt: skip
    absent = [(flight, "flight", reason) for flight, reason in sorted(out.items())]
    absent += [(f, group, reason) for f, one in logs.items() for group, reason in one["absent"].items()]
    frames = [pd.DataFrame(rows)] if rows else []
    if (path := folder / LOGS).exists():
        old = read_frame(path, ())
        frames.insert(0, old[~old["flight"].isin(anew)])
    if not any(map(len, frames)):
        raise StoopError(f"no log gave a figure: {absent[0][0]}: {absent[0][2]}")
    kept = _kept(folder / ABSENT, anew, ABSENTEES)
    dates = [row for row in dates if row[0] not in out]
    files = {ABSENT: _csv(ABSENTEES, [*kept, *absent]), DATES: _csv(DATED, sorted([*others, *dates]))}
    return LogFigures(of_frames(str(reading.flights or "the logs"), frames), absent, files)


def _date(said: Mapping[str, Any], flight: str, given: bool, content: str) -> tuple[str, ...]:
    """Return what the store keeps of a flight: when it was by its log, if no table gave its time."""
    dated = ("" if given else str(said.get(name, "")) for name in DATED[2:5])
    return (flight, str(said["vehicle"]), *dated, content)


def _dated(dates: Iterable[Sequence[str]]) -> Iterator[Dated]:
    """Yield what is kept of the flights of which the log tells the time."""
    for flight, vehicle, *numbers, _ in dates:
        if numbers[0]:
            yield Dated(flight, vehicle, *(float(x or "nan") for x in numbers))


def _given(flights: Path) -> dict[str, dict[str, Any]]:
    """Return what a table of flights tells of each; a field that is empty tells nothing."""
    import pandas as pd

    table = read_frame(flights, ("flight",))
    if len(twice := table["flight"][table["flight"].duplicated()]):
        raise StoopError(f"{flights}: flight {twice.iloc[0]} stands there twice; keep one row")
    if MASS in table.columns:
        masses = pd.to_numeric(table[MASS], errors="coerce")
        for flight in table["flight"][table[MASS].notna() & ~((masses > 0.0) & (masses < np.inf))]:
            raise StoopError(
                f"{flights}: the mass of flight {flight} is no number above zero; write it in kg"
            )
        table[MASS] = masses.astype(float)
    rows = table.set_index("flight").to_dict("index")
    return {str(f): {str(k): x for k, x in row.items() if not pd.isna(x)} for f, row in rows.items()}


def _unknown(lost: Sequence[str], flight: str, flights: Path | None, there: bool) -> str:
    """Return what to do about a flight of which neither its log nor a table of flights tells vehicle or time."""
    what = " and ".join(lost)
    if flights is None:
        return f"the log does not tell its {what}; give a table of the flights with --flights"
    why = f"the row of flight {flight} has no {what}" if there else f"has no row of flight {flight}"
    return f"{flights.name}: {why}, and its log does not tell it; add {what}"


def _kept(path: Path, anew: Container[str], columns: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the rows of an earlier table of the store but those of some flights."""
    if not path.exists():
        return []
    rows = csv.DictReader(io.StringIO(path.read_text("utf-8")))
    return [tuple(row.get(c) or "" for c in columns) for row in rows if row.get("flight") not in anew]


def _csv(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a table with all digits of its numbers."""
    return csv_text(columns, ([None if x is None else str(x) for x in row] for row in rows), "\n")
