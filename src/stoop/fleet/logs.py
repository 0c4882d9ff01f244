"""Figures of many logs: each log is a run of a campaign, so that one that was read is not read again.

A log is read again when it, its mapping, the vehicle or the method changed; a broken one costs its own row.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.csv_text import csv_text
from stoop.checks.vehicle import require_channels
from stoop.errors import StoopError
from stoop.fleet.headers import CLOCKS, Dated, contradictions, header
from stoop.fleet.table import LOGS, FigureTable, columns_of, of_frames, read_frame
from stoop.flight.apply_mapping import read_mapped
from stoop.flight.flight import flight_name
from stoop.flight.load import of_recording
from stoop.logs.csv_tables import mapping_beside
from stoop.parallel import Plan, Run, environment
from stoop.parallel.plan import Json
from stoop.parallel.store import forget
from stoop.parallel.worker import work_sources
from stoop.vehicle.builtin import BUILT_IN, resolve_vehicle
from stoop.workflow.outputs import file_hashes

WORK: Final = "stoop.fleet.logs:read"
SAID: Final = ("vehicle", "time")  #: of a flight, by the table of flights, else by its log
FIGURE: Final = ("figure", "value", "std_error", "parts", "unit")
STORES, ABSENT, DATES = "logs-*.sqlite", "absent.csv", "dates.csv"
ABSENTEES: Final = ("flight", "group", "reason")
DATED: Final = ("flight", "vehicle", "time", "end", "count")  #: by the logs


def is_table(path: Path) -> bool:
    """Tell whether a file is a table of figures, by its columns; a log may be CSV or Parquet, too."""
    return {"figure", "std_error"} <= set(columns_of(path))


def plan(logs: Sequence[Path], vehicle: str | None, mapping: Path | None) -> Plan:
    """Return the campaign that reads logs.

    Raises
    ------
    StoopError
        A log or another file is not there, a log stands there twice, or two logs have one name.
    """
    others = [] if mapping is None else [mapping]
    for path in (*logs, *others):
        if not path.exists():
            raise StoopError(f"{path}: there is no such file")
    for name, several in Counter(map(flight_name, logs)).items():
        if several > 1:
            raise StoopError(
                f"{several} logs are called {name}; rename them, flights go by the names of their logs"
            )
    if vehicle is not None:
        resolve_vehicle(vehicle)
        others += [Path(vehicle)] if vehicle not in BUILT_IN else []
    hashes = {path: _hash(path) for path in (*logs, *others)}
    twice = Counter(hashes[path] for path in logs)
    for path in logs:
        if twice[hashes[path]] > 1:
            same = next(one for one in logs if one != path and hashes[one] == hashes[path])
            raise StoopError(f"{path}: is the same log as {same}; leave one out")
    runs = []
    for path in logs:
        beside: list[Json] = [
            *(hashes[one] for one in others),
            *(_hash(one) for one in [mapping_beside(path)] if one.is_file()),
        ]
        given = {"vehicle": vehicle, "mapping": None if mapping is None else str(mapping)}
        arguments: dict[str, Json] = {"log": str(path), "content": hashes[path], **given, "beside": beside}
        key = hashlib.sha256(Run("log", WORK, arguments).text.encode()).hexdigest()
        runs.append(Run(key, WORK, arguments))
    return Plan("fleet", {}, tuple(runs))


def _hash(path: Path) -> str:
    return file_hashes([path]).popitem()[1]


def store_of(folder: Path) -> Path:
    """Return where the campaign is kept: a file for each state of the method; those of others are removed."""
    here = hashlib.sha256(repr(sorted({**environment(), **work_sources([WORK])}.items())).encode())
    own = folder / STORES.replace("*", here.hexdigest()[:16])
    for other in folder.glob(STORES):
        if other != own:
            forget(other)
    return own


def read(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Json]:
    """Return the figures of a log, and what its header says: a run of the campaign."""
    from stoop.fleet.log_figures import conditions, figures_of  # it needs all of stoop
    from stoop.fleet.vibration import vibration

    path, mapping, name = Path(arguments["log"]), arguments["mapping"], arguments["vehicle"]
    vehicle = None if name is None else resolve_vehicle(name)
    try:
        recording, mapped = read_mapped(path, None if mapping is None else Path(mapping), CLOCKS)
        said = header(recording)
        shaken = vibration([] if mapped is None else mapped.channels)
        flight = of_recording(path, recording, mapped)
        del recording, mapped  # of which the memory is needed
        if vehicle is not None and not {*vehicle.recorded} & flight.names:
            require_channels(vehicle, flight)
        found, absent = figures_of(flight, vehicle, shaken)
    except StoopError as error:
        return [{"figures": [], "absent": {"log": str(error).splitlines()[0]}, "header": {}}]
    rows: list[Json] = [[one.name, one.value, one.std_error, one.parts, one.unit] for one in found]
    known: dict[str, Json] = {"vehicle": said.vehicle, "software": said.software, "count": said.count}
    known |= dict(conditions(flight))
    if said.zero is not None:
        known |= {"time": said.zero + float(flight.time[0]), "end": said.zero + float(flight.time[-1])}
    return [{"figures": rows, "absent": dict(absent), "header": {k: x for k, x in known.items() if x}}]


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


def gathered(campaign: Plan, results: Mapping[str, Any], flights: Path | None, folder: Path) -> LogFigures:
    """Return the figures of the logs, with those of other logs that the store in a folder has.

    Raises
    ------
    StoopError
        No log gave a figure, or the table of flights is wrong.
    """
    import pandas as pd  # a worker needs none

    logs = {flight_name(Path(str(run.arguments["log"]))): results[run.key] for run in campaign.runs}
    given = {} if flights is None else _given(flights)
    said = {f: {**one["header"], **given.get(f, {})} for f, one in logs.items()}
    out = {
        flight: _unknown(lost, flight, flights, flight in given)
        for flight, one in said.items()
        if "log" not in logs[flight]["absent"] and (lost := [name for name in SAID if name not in one])
    }
    dates = _kept(folder / DATES, logs, DATED)
    dates += [
        (flight, *(one.get(name, "") for name in DATED[1:]))
        for flight, one in said.items()
        if {"end", "vehicle"} <= one.keys() and "time" not in given.get(flight, {})
    ]
    out |= contradictions(
        Dated(str(f), str(v), *(float(str(x or np.nan)) for x in numbers)) for f, v, *numbers in dates
    )
    own = {f: {k: x for k, x in one.items() if k not in DATED[3:]} for f, one in said.items()}
    rows = [
        {"flight": f, **own[f], **dict(zip(FIGURE, figure, strict=True))}
        for f, one in logs.items() if f not in out for figure in one["figures"]
    ]  # fmt: skip
    absent = [(flight, "flight", reason) for flight, reason in out.items()]
    absent += [(f, group, reason) for f, one in logs.items() for group, reason in one["absent"].items()]
    frames = [pd.DataFrame(rows)] if rows else []
    if (earlier := folder / LOGS).exists():
        old = read_frame(earlier, ())
        frames.insert(0, old[~old["flight"].isin({*logs, *out})])
    if not any(map(len, frames)):
        raise StoopError(f"no log gave a figure: {absent[0][0]}: {absent[0][2]}")
    kept = _kept(folder / ABSENT, {*logs, *out}, ABSENTEES)
    files = {ABSENT: _csv(ABSENTEES, [*kept, *absent]), DATES: _csv(DATED, dates)}
    return LogFigures(of_frames(str(flights or "the logs"), frames), absent, files)


def _given(flights: Path) -> dict[str, dict[str, Any]]:
    """Return what a table of flights tells of each; a field that is empty tells nothing."""
    import pandas as pd

    table = read_frame(flights, ("flight",))
    if len(twice := table["flight"][table["flight"].duplicated()]):
        raise StoopError(f"{flights}: flight {twice.iloc[0]} stands there twice; keep one row")
    rows = table.set_index("flight").to_dict("index")
    return {str(f): {str(k): x for k, x in row.items() if not pd.isna(x)} for f, row in rows.items()}


def _unknown(lost: Sequence[str], flight: str, flights: Path | None, there: bool) -> str:
    """Return what to do about a flight of which neither its log nor a table of flights tells vehicle or time."""
    what = " and ".join(lost)
    if flights is None:
        return f"the log does not tell its {what}; give a table of the flights with --flights"
    why = f"the row of flight {flight} has no {what}" if there else f"has no row of flight {flight}"
    return f"{flights}: {why}, and its log does not tell it; add {what}"


def _kept(path: Path, anew: Container[str], columns: Sequence[str]) -> list[tuple[object, ...]]:
    """Return the rows of an earlier table of the store but those of some flights."""
    if not path.exists():
        return []
    rows = csv.DictReader(io.StringIO(path.read_text("utf-8")))
    return [tuple(row.get(c) or "" for c in columns) for row in rows if row.get("flight") not in anew]


def _csv(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a table with all digits of its numbers."""
    return csv_text(columns, ([None if x is None else str(x) for x in row] for row in rows), "\n")
