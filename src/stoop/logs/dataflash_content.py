"""What the messages of a DataFlash log mean, whether they were written as bytes or as text."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from stoop.errors import LogError
from stoop.logs.dataflash_format import TEXTS, Columns, Layout, Messages, text, unit
from stoop.logs.recording import Defect, Recording, Stream, clean_stream

MAX_INSTANCES: Final = 64  #: of one kind of messages; ArduPilot numbers 32 actuators at most
MAX_PARAMETERS: Final = 20_000
MAX_MESSAGES: Final = 500  #: texts that are kept
ABOUT: Final = frozenset({"FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG", "VER"})  #: not flown, but told
MICROSECONDS: Final = "TimeUS"
MILLISECONDS: Final = "TimeMS"
INSTANCE: Final = "#"  #: unit of a column that numbers the instance

_T = TypeVar("_T")
_Found = tuple[str, Stream | None, tuple[Defect, ...]]


def is_wanted(name: str, topics: frozenset[str] | None) -> bool:
    """Tell whether messages of this name are to be kept."""
    return topics is None or name in topics or name in ABOUT


def assemble(path: Path, kinds: Sequence[Messages], defects: Sequence[Defect]) -> Recording:
    """Make streams, parameters, texts and units of all messages.

    Raises
    ------
    LogError
        When none has samples with a time.
    """
    named = {kind.layout.name: kind for kind in kinds}
    stated, numbered = _units(named)
    streams: dict[str, Stream] = {}
    units: dict[str, Mapping[str, str]] = {}
    found = list(defects)
    for name, kind in named.items():
        for stream_name, stream, met in _streams(kind, numbered.get(name)) if name not in ABOUT else ():
            found.extend(met)
            if stream is not None and stream.time.size:
                streams[stream_name] = stream
                shown = {c: u for c, u in stated.get(name, {}).items() if c in stream.columns}
                units |= {stream_name: shown} if shown else {}
    if not streams:
        reason = f" ({found[0]})" if found else ""
        raise LogError(
            f"{path}: no message holds samples with a time{reason}; copy it again from the autopilot"
        )
    return Recording(path, "dataflash", streams, tuple(found), {}, _parameters(named), _texts(named), units)


def _streams(kind: Messages, numbered: str | None) -> Iterator[_Found]:
    """Return each instance of one kind of messages by its name."""
    name, (clock, period) = kind.layout.name, _clock(kind.layout)
    if set(kind.layout.letters) <= {*TEXTS} or not kind.rows.size:
        return
    if not clock:
        why = f"{kind.rows.size} messages skipped: they have no time"
        yield name, None, (Defect("skipped", name, why),)
        return
    instances, met = _instances(kind, numbered)
    if met is not None:
        yield name, None, (met,)
    for number, rows in instances.items():
        place = f"{name}/{number}" if number else name
        columns = Columns(kind.layout, rows, frozenset({clock}))
        if columns:
            time = Messages(kind.layout, rows).numbers(clock) * period
            yield place, *clean_stream(place, time, columns)


def _clock(layout: Layout) -> tuple[str, float]:
    """Return the column with the time, and its unit [s]; ("", 0) if there is none.

    Logs before 2014 count milliseconds; their GPS messages call so the time of the week, and the logger's "T".
    """
    if layout.letter(MICROSECONDS) not in {"", *TEXTS, "a"}:
        return MICROSECONDS, 1e-6
    if layout.letter(MILLISECONDS) in {"", *TEXTS, "a"}:
        return "", 0.0
    of_week = "Week" in layout.columns and layout.letter("T") not in {"", *TEXTS, "a"}
    return ("T" if of_week else MILLISECONDS), 1e-3


def _instances(kind: Messages, numbered: str | None) -> tuple[dict[str, npt.NDArray[Any]], Defect | None]:
    """Part messages by the column that numbers them; the first instance has no name of its own."""
    if numbered is None or kind.layout.letter(numbered) in {"", "a"}:
        return {"": kind.rows}, None
    numbers = kind.rows[str(kind.layout.columns.index(numbered))]
    marks, count = np.unique(numbers, return_counts=True)
    kept = np.sort(np.argsort(-count, kind="stable")[:MAX_INSTANCES])
    parts = {_mark(marks[k]): _part(kind.rows, numbers == marks[k]) for k in kept}
    if marks.size <= MAX_INSTANCES:
        return parts, None
    why = f"{marks.size} instances; the {MAX_INSTANCES} with the most samples are kept"
    return parts, Defect("skipped", kind.layout.name, why)


def _part(rows: npt.NDArray[Any], mine: npt.NDArray[np.bool_]) -> npt.NDArray[Any]:
    """Return some rows, without a copy where they follow each other at equal steps, as instances mostly do."""
    places = np.flatnonzero(mine)
    step = int(places[1] - places[0]) if places.size > 1 else 1
    if np.all(np.diff(places) == step):
        return rows[places[0] :: step][: places.size]
    return rows[places]


def _mark(value: Any) -> str:
    """Return the name of an instance: a number, or a text; none for the first."""
    if isinstance(value, bytes):
        return text(value)
    return f"{float(value):g}" if value else ""


def _units(named: Mapping[str, Messages]) -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    """Return the unit of each column of each kind, and the column that numbers the instances, where there is one."""
    labels = dict(_by_mark(named, "UNIT", lambda kind: kind.texts("Label")))
    multipliers = dict(_by_mark(named, "MULT", lambda kind: kind.numbers("Mult").tolist()))
    units: dict[str, dict[str, str]] = {}
    numbered: dict[str, str] = {}
    for layout, unit_marks, multiplier_marks in _format_units(named):
        padded = multiplier_marks.ljust(len(unit_marks), "-")
        for column, mark, times in zip(layout.columns, unit_marks, padded, strict=False):
            factor = 1.0 if column in layout.scaled else multipliers.get(times, 1.0)
            if stated := unit(labels.get(mark, ""), factor):
                units.setdefault(layout.name, {})[column] = stated
            if mark == INSTANCE:
                numbered.setdefault(layout.name, column)
    return units, numbered


def _by_mark(
    named: Mapping[str, Messages], name: str, values: Callable[[Messages], list[_T]]
) -> Iterator[tuple[str, _T]]:
    """Return the character that stands for a unit or multiplier, and what it stands for."""
    if (kind := named.get(name)) is None:
        return
    for mark, value in zip(kind.numbers("Id").tolist(), values(kind), strict=False):
        if 0.0 < mark < 128.0:
            yield chr(int(mark)), value


def _format_units(named: Mapping[str, Messages]) -> Iterator[tuple[Layout, str, str]]:
    """Return for each kind of messages a character for the unit and one for the multiplier of each column."""
    if (kind := named.get("FMTU")) is None:
        return
    layouts = {float(other.layout.kind): other.layout for other in named.values()}
    numbers, marks = kind.numbers("FmtType").tolist(), (kind.texts("UnitIds"), kind.texts("MultIds"))
    for number, units, multipliers in zip(numbers, *marks, strict=False):
        if number in layouts:
            yield layouts[number], units, multipliers


def _parameters(named: Mapping[str, Messages]) -> dict[str, float]:
    """Return the first value of each parameter: what is written later was changed on the way."""
    parameters: dict[str, float] = {}
    if (kind := named.get("PARM")) is not None:
        for name, value in zip(kind.texts("Name"), kind.numbers("Value").tolist(), strict=False):
            if name and math.isfinite(value) and len(parameters) < MAX_PARAMETERS:
                parameters.setdefault(name, value)
    return parameters


def _texts(named: Mapping[str, Messages]) -> dict[str, str]:
    """Return what the autopilot says of itself, and its messages, one to a line."""
    info: dict[str, str] = {}
    if (kind := named.get("VER")) is not None and kind.rows.size:
        first = Messages(kind.layout, kind.rows[:1])
        columns = [c for c in kind.layout.columns if c not in (MICROSECONDS, MILLISECONDS)]
        info |= {
            f"VER.{c}": str((first.texts(c) or [f"{v:g}" for v in first.numbers(c)] or [""])[0])
            for c in columns
        }
    if (kind := named.get("MSG")) is not None:
        said = Messages(kind.layout, kind.rows[:MAX_MESSAGES]).texts("Message")
        firmware = next((line for line in said if _FIRMWARE.search(line)), None)
        info |= {"firmware": firmware} if firmware else {}
        info["messages"] = "\n".join(said)
    return info


_FIRMWARE: Final = re.compile(r"\b(Ardu\w+|APM:?\w+|Blimp|AntennaTracker)\b.*\d+\.\d+")
