"""Blackbox logs of Betaflight, INAV and Cleanflight: raw, from flash or card (.bbl, .bfl, .txt).

A file holds one log after another, one for each arming: lines of text (``H name:value``) that define the fields of its frames
and hold settings, then frames (`stoop.logs.blackbox_walk`). The logs of a file are put on one clock, in their order.

Streams are ``main`` (I and P frames), ``gps``, ``slow`` and ``home``; columns are called as in the log. What needs a setting to
be a physical quantity is converted (`stoop.logs.blackbox_units`); the rest stays as it was logged.

References
----------
.. [1] Betaflight, src/main/blackbox/blackbox.c, and INAV, the file of the same name: header and fields.
.. [2] Cleanflight, docs/development/Blackbox Internals.md: frames, encodings, predictors.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import MICROSECOND
from stoop.errors import LogError, one_line
from stoop.logs import blackbox_walk as frames
from stoop.logs.arrays import max_values
from stoop.logs.blackbox_units import Columns, Settings, physical
from stoop.logs.blackbox_walk import Bytes, Integers, walk
from stoop.logs.recording import Defect, Recording, Stream, add_stream, nothing_read

FIRST: Final = b"H Product:Blackbox"  #: begins each log
GOODBYE: Final = np.frombuffer(b"End of log\0", np.uint8)
STREAMS: Final = {frames.I: "main", frames.S: "slow", frames.G: "gps", frames.H: "home"}
LETTERS: Final = "IPSGH"  #: of the kinds of frames
ROWS: Final = 4096  #: that are decoded before they are put aside
SMALL: Final = 2**20  #: bytes times fields; a smaller log is read before the compiled walk is even loaded
PAUSE: Final = 10.0  #: s between two logs of a file, where their clocks do not tell


@dataclass(frozen=True)
class Limits:
    """What is read of a file, and kept."""

    logs: int = 200  #: of a file
    header: int = 2**18  #: bytes of the header of a log; those of firmwares have 10 KiB
    places: int = 10  #: damaged places that are listed one by one


LIMITS: Final = Limits()


@dataclass(frozen=True)
class Session:
    """One log of a file: its settings, and the numbers of its frames as they were logged."""

    settings: Settings
    names: Mapping[int, tuple[str, ...]]  #: kind of frame -> fields
    signs: Mapping[int, tuple[bool, ...]]
    rows: Mapping[int, Integers]  #: kind of frame -> (n, 1 + fields): time [us], fields
    defects: tuple[Defect, ...]


def parse_blackbox(path: Path, data: bytes, topics: frozenset[str] | None = None) -> Recording:
    """Read a blackbox log.

    Parameters
    ----------
    path : its name
    data : its content
    topics : names of the streams wanted; all are read, which costs nothing

    Returns
    -------
    Recording : streams ``main``, ``gps``, ``slow`` and ``home``, as far as they are there, on the clock of the flight controller

    Raises
    ------
    LogError
        When it is no such log, or nothing of it can be read.
    """
    begins = [one.start() for one in islice(re.finditer(re.escape(FIRST), data), LIMITS.logs + 1)]
    defects: list[Defect] = []
    if len(begins) > LIMITS.logs:
        defects.append(Defect("skipped", path.name, f"more than {LIMITS.logs} logs; the first ones are read"))
    if not begins:
        raise LogError(
            f"{path}: not a blackbox log, no line begins with {FIRST.decode()}; save it again from the flight controller"
        )
    if begins[0]:
        defects.append(Defect("corrupt", path.name, f"the first {begins[0]} bytes belong to no log"))
    ends = [*begins[1:], len(data)][: LIMITS.logs]
    room = max_values(path) if path.is_file() else 5_000_000 + 20 * len(data)
    sessions: list[Session] = []
    for number, (begin, end) in enumerate(zip(begins, ends, strict=False), 1):
        place = f"{path.name} log {number}" if len(ends) > 1 else path.name
        found = _session(data, begin, end, place, room)
        if isinstance(found, Defect):
            defects.append(found)
            continue
        sessions.append(found)
        defects += found.defects
        room -= sum(rows.size for rows in found.rows.values())
    return assemble(path, "blackbox", sessions, defects)


def assemble(path: Path, form: str, sessions: list[Session], defects: list[Defect]) -> Recording:
    """Put the logs of a file on one clock, and join their streams.

    Raises
    ------
    LogError
        When none holds a frame.
    """
    sessions = [one for one in sessions if frames.I in one.rows and len(one.rows[frames.I]) > 1]
    if not sessions:
        raise nothing_read(path, "no frame can be read", defects, "save it again from the flight controller")
    parts: dict[str, list[tuple[FloatArray, Columns]]] = {}
    units: dict[str, dict[str, str]] = {}
    before, listed = -np.inf, []
    for number, one in enumerate(sessions, 1):
        clock = one.rows[frames.I][:, 0]
        first, last = float(clock[0]) * MICROSECOND, float(clock.max()) * MICROSECOND
        shift = 0.0 if first > before else before + PAUSE - first
        if shift:
            message = f"its clock starts anew; log {number} is put {PAUSE:g} s after the one before"
            defects.append(Defect("time order", path.name, message))
        before = last + shift
        listed.append(f"{first + shift:.2f} to {before:.2f} s")
        for kind, rows in one.rows.items():
            raw = {
                name: rows[:, 1 + k].astype(np.int32 if one.signs[kind][k] else np.uint32)
                for k, name in enumerate(one.names[kind])
            }
            raw.pop("time", None)
            columns, known, assumed = physical(raw, one.settings, STREAMS[kind])
            time = np.asarray(rows[:, 0] * MICROSECOND + shift, dtype=np.float64)
            parts.setdefault(STREAMS[kind], []).append((time, columns))
            units.setdefault(STREAMS[kind], {}).update(known)
            defects += [Defect("assumed", f"{path.name} {STREAMS[kind]}", text) for text in assumed]
    streams: dict[str, Stream] = {}
    for name, found in parts.items():
        clock_of_all: FloatArray = np.concatenate([time for time, _ in found])
        if clock_of_all.size:
            add_stream(streams, defects, name, clock_of_all, _joined(found))
    first_settings = sessions[0].settings
    info = {key: first_settings.text(name) for key, name in INFO.items() if first_settings.text(name)}
    if len(sessions) > 1:
        info["logs"] = "\n".join(f"{k}: {span}" for k, span in enumerate(listed, 1))
    unique = tuple(dict.fromkeys(defects))
    kept = {name: columns for name, columns in units.items() if name in streams}
    return Recording(path, form, streams, unique, {}, first_settings.numbers(), info, kept)


INFO: Final = {
    "firmware": "Firmware revision",
    "firmware date": "Firmware date",
    "board": "Board information",
    "craft": "Craft name",
    "start": "Log start datetime",
}  #: key of `Recording.info` -> line of the header


def _joined(parts: list[tuple[FloatArray, Columns]]) -> Columns:
    """Return the columns of all logs of a file, one after the other; NaN where a log has no such field."""
    if len(parts) == 1:
        return parts[0][1]
    names = dict.fromkeys(name for _, columns in parts for name in columns)
    whole = [(columns, np.full(time.size, np.nan, np.float32)) for time, columns in parts]
    return {n: np.concatenate([columns.get(n, nothing) for columns, nothing in whole]) for n in names}


def _header(data: bytes, at: int, end: int) -> tuple[dict[str, str], int]:
    """Return name -> value of the lines of a header, and the place of the first frame."""
    lines: dict[str, str] = {}
    stop = min(end, at + LIMITS.header)
    while data[at : at + 2] == b"H " and (newline := data.find(b"\n", at, stop)) >= 0:
        name, _, value = data[at + 2 : newline].decode("latin-1").partition(":")
        lines.setdefault(one_line(name.strip()), one_line(value.strip()))
        at = newline + 1
    return lines, at


@dataclass(frozen=True)
class Definition:
    """The fields of all kinds of frames, and what their prediction needs."""

    names: Mapping[int, tuple[str, ...]]
    fields: Integers  #: (5, 4, most fields): number, predictors, encodings, signs
    setup: Integers


def define(lines: Mapping[str, str]) -> Definition | str:
    """Return the fields that a header defines, or what is wrong with it."""
    names: dict[int, tuple[str, ...]] = {}
    for kind in STREAMS:
        listed = lines.get(f"Field {LETTERS[kind]} name", "")
        names[kind] = tuple(x.strip() for x in listed.split(",")) if listed else ()
        if len(set(names[kind])) < len(names[kind]) or not all(names[kind]):
            return f"fields of {LETTERS[kind]} frames without a name, or with the same"
    width = max(len(own) for own in names.values())
    if "time" not in names[frames.I]:
        return "no field 'time' is defined"
    if width > frames.MAX_FIELDS:
        return f"more than {frames.MAX_FIELDS} fields"
    fields = np.zeros((5, 4, width), np.int64)
    for kind in range(5):
        wrong = _fill(fields[kind], kind, len(names[frames.I if kind == frames.P else kind]), lines)
        if wrong:
            return wrong
    predictors = fields[frames.G, 1]
    for k in range(1, width):  # of a pair of coordinates the second is longitude
        if predictors[k] == 7 and predictors[k - 1] == 7:
            predictors[k] = 12
    home = names[frames.H].index("GPS_home[0]") if "GPS_home[0]" in names[frames.H] else -1
    if home + 1 >= len(names[frames.H]):
        home = -1
    return Definition(names, fields, _setup(lines, names, home))


def _fill(own: Integers, kind: int, count: int, lines: Mapping[str, str]) -> str:
    """Set number, predictors, encodings and signs (4, fields) of a kind of frames; return what is wrong with them."""
    own[0, 0] = count
    rows = (1, "predictor", frames.PREDICTORS), (2, "encoding", frames.ENCODINGS), (3, "signed", None)
    for row, key, known in rows:
        letter = "I" if key == "signed" and kind == frames.P else LETTERS[kind]
        numbers = _whole_numbers(lines.get(f"Field {letter} {key}", ""))
        if len(numbers) != count:
            return f"{count} fields of {letter} frames, but {len(numbers)} values of {key}"
        if known is not None and not set(numbers) <= known:
            return f"an unknown {key} of {letter} frames"
        own[row, :count] = numbers
    return ""


def _setup(lines: Mapping[str, str], names: Mapping[int, tuple[str, ...]], home: int) -> Integers:
    """Return what the walk needs of the header."""

    def first(name: str, other: int) -> int:
        return next(iter(_whole_numbers(lines.get(name, ""))), other)

    def place(kind: int, name: str) -> int:
        return names[kind].index(name) if name in names[kind] else -1

    numerator, slash, denominator = lines.get("P interval", "1").partition("/")
    share = _whole_numbers(f"{numerator if slash else 1},{denominator if slash else numerator}")
    p_count, p_step = share if len(share) == 2 else [1, 1]
    p_step = min(max(p_step, 1), 2**16)
    setup = np.zeros(frames.SETUP, np.int64)
    setup[:] = (
        first("Data version", 1),
        first("minthrottle", 0),
        first("vbatref", 0),
        first("motorOutput", first("minthrottle", 0)),
        place(frames.I, "motor[0]"),
        place(frames.I, "loopIteration"),
        place(frames.I, "time"),
        place(frames.G, "time"),
        home,
        min(max(first("I interval", 32), 1), 2**16),
        min(max(p_count, 1), p_step),
        p_step,
    )
    return setup


def _whole_numbers(text: str) -> list[int]:
    """Return the whole numbers of a list, none where one is not or has more than 32 bits."""
    parts = [part.strip() for part in text.split(",")] if text else []
    if not all(len(part) < 12 and part.removeprefix("-").isdecimal() and part.isascii() for part in parts):
        return []
    numbers = [int(part) for part in parts]
    return numbers if all(-(2**31) <= x < 2**32 for x in numbers) else []


def _session(data: bytes, begin: int, end: int, place: str, room: int) -> Session | Defect:
    """Decode one log; a defect where its header cannot be used."""
    lines, start = _header(data, begin, end)
    known = define(lines)
    if isinstance(known, str):
        return Defect("skipped", place, f"its header cannot be used: {known}")
    width = known.fields.shape[2]
    content: Bytes = np.frombuffer(data, np.uint8, end - start, start)
    state, rows = np.zeros(frames.STATE, np.int64), np.zeros(5, np.int64)
    state[frames.CUT] = -1
    history, part = np.zeros((4, width), np.int64), np.zeros(8, np.int64)
    gaps, out = np.zeros((LIMITS.places, 2), np.int64), np.zeros((5, ROWS, width + 1), np.int64)
    kept: dict[int, list[Integers]] = {kind: [] for kind in STREAMS}
    step: Callable[..., int] = walk
    if content.size * width >= SMALL:  # a frame may be one letter
        from stoop.logs.compiled import blackbox

        step = blackbox().walk
    at, full = 0, False
    while at < content.size and not state[frames.ENDED] and not full:
        at = step(
            at, content, known.fields, known.setup, state, history, part, GOODBYE, gaps, rows, out
        )  # fmt: skip
        for kind, blocks in kept.items():
            blocks.append(out[kind, : rows[kind], : len(known.names[kind]) + 1].copy())
            room -= blocks[-1].size
        rows[:] = 0
        full = room < 0
    defects = _defects(place, state, gaps, start, content.size)
    if full:
        message = "more numbers than a log of this size holds; the rest was left out"
        defects.append(Defect("skipped", place, message))
    found = {kind: np.concatenate(blocks) for kind, blocks in kept.items() if blocks and known.names[kind]}
    signs = {kind: tuple(map(bool, known.fields[kind, 3].tolist())) for kind in STREAMS}
    return Session(Settings(lines), known.names, signs, found, tuple(defects))


def _defects(place: str, state: Integers, gaps: Integers, start: int, size: int) -> list[Defect]:
    """Return what was wrong with the frames of a log."""
    defects = []
    count = int(state[frames.GAPS])
    for first, last in gaps[:count].tolist():
        if last == size and state[frames.CUT] >= first:
            defects.append(Defect("truncated", place, f"the last frame, at byte {start + first}, is cut"))
        else:
            message = f"no frame at byte {start + first}; {last - first} bytes skipped"
            defects.append(Defect("corrupt", place, message))
    if count > len(gaps):
        message = f"{count - len(gaps)} more such places; {int(state[frames.GAP_BYTES])} bytes skipped in all"
        defects.append(Defect("corrupt", place, message))
    if lost := int(state[frames.UNUSABLE]):
        message = f"{lost} frames dropped: they build on a damaged one, or their time does not go on"
        defects.append(Defect("dropout", place, message))
    if lost := int(state[frames.NO_HOME]):
        message = f"{lost} GPS frames dropped: they come before the home position"
        defects.append(Defect("skipped", place, message))
    return defects
