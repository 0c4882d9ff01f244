"""Figures of many logs: each log is a run of a campaign, so that one that was read is not read again.

A log is read again when it, its mapping, the vehicle or the method changed; a broken one costs its own row.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pandas as pd

from stoop.errors import StoopError
from stoop.fleet.log_figures import figures_of
from stoop.fleet.table import FigureTable, columns_of, of_frames, read_frame
from stoop.flight.flight import flight_name
from stoop.flight.load import load
from stoop.logs.csv_tables import mapping_beside
from stoop.parallel import Plan, Run, environment
from stoop.parallel.plan import Json
from stoop.parallel.store import forget
from stoop.parallel.worker import work_sources
from stoop.vehicle.builtin import BUILT_IN, resolve_vehicle
from stoop.workflow.outputs import file_hashes

WORK: Final = "stoop.fleet.logs:read"
FLIGHTS: Final = ("flight", "vehicle", "time")  #: columns of a table of flights
STORES, ABSENT = "logs-*.sqlite", "absent.csv"


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
    """Return the figures of a log: a run of the campaign."""
    vehicle = arguments["vehicle"]
    try:
        flight = load(arguments["log"], arguments["mapping"])
        found, absent = figures_of(flight, None if vehicle is None else resolve_vehicle(vehicle))
    except StoopError as error:
        return [{"figures": [], "absent": {"log": str(error).splitlines()[0]}}]
    rows: list[Json] = [[one.name, one.value, one.std_error, one.part] for one in found]
    return [{"figures": rows, "absent": dict(absent)}]


def table_of(
    campaign: Plan, results: Mapping[str, Any], flights: Path, earlier: Path
) -> tuple[FigureTable, list[tuple[str, str, str]]]:
    """Return the figures of the logs, with those of other logs in an earlier table, and what is absent: flight, group, reason.

    Raises
    ------
    StoopError
        A log has no row in the table of flights, or no log gave a figure.
    """
    known = read_frame(flights, FLIGHTS).set_index("flight")
    rows, absent = [], []
    for run in campaign.runs:
        flight, one = flight_name(Path(str(run.arguments["log"]))), results[run.key]
        if flight not in known.index:
            raise StoopError(
                f"{flights}: has no row of flight {flight}; add it, with {' and '.join(FLIGHTS[1:])}"
            )
        rows += [(flight, *figure) for figure in one["figures"]]
        absent += [(flight, group, reason) for group, reason in one["absent"].items()]
    if not rows:
        raise StoopError(f"no log gave a figure: {absent[0][0]}: {absent[0][2]}")
    table = pd.DataFrame(rows, columns=["flight", "figure", "value", "std_error", "parts"])
    frames = [table.join(known, on="flight")]
    if earlier.exists():
        old = read_frame(earlier, ())
        frames.insert(0, old[~old["flight"].isin(set(table["flight"]))])
    return of_frames(str(flights), frames), absent


def absent_text(absent: Sequence[tuple[str, str, str]]) -> str:
    """Return the table of what the logs could not tell."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([("flight", "group", "reason"), *absent])
    return out.getvalue()
