"""Blackbox logs that were decoded: the tables of blackbox_decode, and those that Blackbox Explorer exports.

Blackbox Explorer writes the settings as pairs of name and value before the header line, and the numbers as they were logged.
blackbox_decode writes no settings, units in parentheses behind the names of what it converts, and the rest as it was logged.

References
----------
.. [1] Betaflight, blackbox-tools, src/blackbox_decode.c.
.. [2] Betaflight, blackbox-log-viewer, src/csv-exporter.js.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.base.units import FACTORS, MICROSECOND, UNITS
from stoop.errors import LogError, one_line
from stoop.logs.blackbox import INFO
from stoop.logs.blackbox_units import Columns, Settings, physical
from stoop.logs.csv_tables import parse_table, unpack
from stoop.logs.recording import Defect, Recording, Stream, add_stream

MAX_SETTINGS: Final = 2**18  #: bytes before the header line
_START: Final = re.compile(rb'(^|\n)(?="?loopIteration"?, *"?time)')
_UNIT: Final = re.compile(r"(.+?) \(([^()]*)\)")
WANTED: Final = {
    "gyroADC": "deg/s", "gyroUnfilt": "deg/s", "accSmooth": "g", "vbatLatest": "V", "vbat": "V", "amperageLatest": "A",
    "amperage": "A", "baroAlt": "cm", "BaroAlt": "cm", "GPS_speed": "cm/s", "GPS_altitude": "m",
}  #: field without index -> unit that the mapping reads  # fmt: skip


def read_blackbox_csv(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a decoded blackbox log.

    Parameters
    ----------
    path : the file, plain or .gz
    topics : names of the streams wanted; all are read

    Returns
    -------
    Recording : streams ``main`` and, where there is GPS, ``gps``, as of the raw log

    Raises
    ------
    LogError
        When nothing of it can be read.
    """
    text, found = unpack(path)
    start = _START.search(text, 0, MAX_SETTINGS)
    if start is None:
        raise LogError(f"{path}: no header line that begins with loopIteration, time; export the log again")
    table, defects = parse_table(path, text[start.end() :], found)
    settings = Settings(_settings(text[: start.end()]))
    raw: Columns = {}
    stated: dict[str, tuple[FloatArray, str]] = {}
    for name, values in table.items():
        match = _UNIT.fullmatch(name)
        if match is None:
            raw[name] = values
        elif match[2] in FACTORS:
            stated[match[1]] = values, match[2]
    time = _clock(raw, stated)
    if time is None:
        raise LogError(f"{path}: the unit of its time is unknown; decode the log again with the time in us")
    listed = list(defects)
    streams: dict[str, Stream] = {}
    units: dict[str, dict[str, str]] = {}
    for stream in ("main", "gps"):
        rows, columns, units[stream], assumed = _columns(stream, raw, stated, settings)
        listed += [Defect("assumed", f"{path.name} {stream}", text) for text in assumed]
        if columns:
            add_stream(streams, listed, stream, time[rows], columns)
    if not streams:
        raise LogError(f"{path}: no sample with a time is left; decode the log again")
    info = {key: settings.text(name) for key, name in INFO.items() if settings.text(name)}
    return Recording(path, "blackbox-csv", streams, tuple(listed), {}, settings.numbers(), info, units)


def _columns(
    stream: str, raw: Columns, stated: Mapping[str, tuple[FloatArray, str]], settings: Settings
) -> tuple[npt.NDArray[np.intp], Columns, dict[str, str], list[str]]:
    """Return the rows (n,) of a stream, and of them what `physical` returns, with the columns that state their unit."""
    size = next((x.size for x in (*raw.values(), *(x for x, _ in stated.values()))), 0)
    rows = np.arange(size)
    own = {name: x for name, x in raw.items() if name.startswith("GPS_") == (stream == "gps")}
    if stream == "gps":
        rows, own = _fixes(own)
    columns, units, assumed = physical(own, settings, stream)
    for name, (values, unit) in stated.items():
        wanted = WANTED.get(name.partition("[")[0], unit)
        if name.startswith("GPS_") == (stream == "gps") and UNITS[unit].kind == UNITS[wanted].kind:
            columns[name], units[name] = values[rows] * (FACTORS[unit] / FACTORS[wanted]), wanted
    return rows, columns, units, assumed


def _settings(text: bytes) -> dict[str, str]:
    """Return name -> value of the lines before the header line."""
    rows = text.decode("utf-8-sig", "replace").splitlines()
    try:
        pairs = [row for row in csv.reader(rows) if len(row) > 1]
    except csv.Error:
        return {}
    return {one_line(row[0].strip()): one_line(",".join(row[1:])) for row in pairs}


def _clock(raw: Columns, stated: dict[str, tuple[FloatArray, str]]) -> FloatArray | None:
    """Take the time out of the columns, (n,) s; None where its unit is unknown."""
    if "time" in raw:
        return np.asarray(raw.pop("time") * MICROSECOND, dtype=np.float64)
    values, unit = stated.pop("time", (np.zeros(0), ""))
    return values * FACTORS[unit] if unit in ("s", "ms", "us") else None


def _fixes(columns: Columns) -> tuple[npt.NDArray[np.intp], Columns]:
    """Return the rows (n,) in which GPS tells anything new, and the columns there, coordinates as they are logged."""
    if not columns:
        return np.zeros(0, dtype=np.intp), {}
    whole = np.column_stack([*columns.values()])
    there = np.isfinite(whole).all(axis=1)
    new = np.ones(len(whole), dtype=bool)
    new[1:] = np.any(whole[1:] != whole[:-1], axis=1)
    rows = np.flatnonzero(new & there)
    kept = {name: x[rows] for name, x in columns.items()}
    for name in ("GPS_coord[0]", "GPS_coord[1]"):
        if name in kept and np.max(np.abs(kept[name]), initial=0.0) <= 180.0:  # degrees
            kept[name] = np.rint(kept[name] * 1e7)
    return rows, kept
