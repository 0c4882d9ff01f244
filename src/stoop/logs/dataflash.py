"""ArduPilot DataFlash logs: self-describing messages, binary (.bin, read here) or as text (`stoop.logs.dataflash_text`).

A log defines its kinds of messages (FMT), their units (FMTU, UNIT, MULT), holds parameters (PARM) and texts (MSG, VER).
Each kind becomes a stream; where a unit of FMTU says that a column numbers the instance, each instance becomes one: "IMU",
"IMU/1". Values are scaled as the letters c, C, e, E and L of the format say; MULT only gives the unit its prefix, as ArduPilot
means it. The bytes are walked twice, in compiled code (`stoop.logs.dataflash_survey`); only what is wanted is copied.

References
----------
.. [1] ArduPilot, libraries/AP_Logger/LogStructure.h: letters of formats, units and multipliers.
"""

from __future__ import annotations

import math
import mmap
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, repeat
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.errors import listed, one_line
from stoop.logs.dataflash_survey import gather, survey
from stoop.logs.recording import (
    Defect,
    Numbers,
    Recording,
    Stream,
    add_stream,
    checked_size,
    nothing_read,
    unreadable,
)

TYPES: Final = {
    "a": "(32,)<i2", "b": "<i1", "B": "<u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4",
    "g": "<f2", "f": "<f4", "d": "<f8", "n": "S4", "N": "S16", "Z": "S64",
    "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "M": "<u1", "q": "<i8", "Q": "<u8",
}  #: letter of the format -> NumPy's name of the type  # fmt: skip
DIVISORS: Final = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}
TEXTS: Final = "nNZ"
BODY: Final = np.dtype(
    [("kind", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")]
)
PREFIXES: Final = {1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "u", 1e-9: "n"}
SPELLINGS: Final = {
    "m/s/s": "m/s2", "deg/s/s": "deg/s2", "rad/s/s": "rad/s2", "N.m": "N m", "Watt": "W",
    "degheading": "deg", "deglatitude": "deg", "deglongitude": "deg", "UNKNOWN": "", "instance": "",
}  #: unit as ArduPilot writes it -> as stoop does; the rest is the same  # fmt: skip
#: kinds without channels
DESCRIPTIVE: Final = frozenset({"FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG", "VER"})
FIRMWARE: Final = re.compile(r"\b(Ardu\w+|APM:?\w+|Blimp|AntennaTracker)\b.*\d+\.\d+")


@dataclass(frozen=True)
class Limits:
    """What is read of a log, and kept."""

    #: bytes, one more than the largest file of FAT32, the file system of an autopilot's card
    size: int = 2**32
    instances: int = 64  #: of one kind of messages; ArduPilot numbers 32 actuators at most
    parameters: int = 20_000  #: a vehicle has some 1500
    texts: int = 500  #: messages of the autopilot
    places: int = 10  #: damaged places that are listed one by one


LIMITS: Final = Limits()


@dataclass(frozen=True)
class Layout:
    """The layout of one kind of messages."""

    kind: int  #: id, the third byte of each message
    name: str  #: such as "IMU"
    letters: str  #: one for each column
    columns: tuple[str, ...]  #: names, without repetition
    scaled: frozenset[str]  #: columns whose letter has a divisor

    @property
    def row(self) -> np.dtype[Any]:
        """Type of a body; its fields are called 0, 1, 2."""
        return np.dtype([(str(i), TYPES[letter]) for i, letter in enumerate(self.letters)])

    def letter(self, column: str) -> str:
        """Return the letter of a column; empty if there is none."""
        return self.letters[self.columns.index(column)] if column in self.columns else ""

    def is_integer(self, column: str) -> bool:
        """Return whether there is such a column, and it holds one number."""
        return self.letter(column) not in {"", "a", *TEXTS}


def make_layout(kind: int, name: str, letters: str, columns: str) -> Layout | None:
    """Return the layout of a definition; None where it is invalid (damage, or letters that came later)."""
    names = tuple(columns.split(",")) if columns else ()
    plain = name.isascii() and name.isprintable() and name.strip() == name != "" and "/" not in name
    sound = 0 < len(names) == len(letters) == len(set(names)) and all(n.isprintable() and n for n in names)
    if not (plain and sound and set(letters) <= TYPES.keys()):
        return None
    scaled = frozenset(n for n, letter in zip(names, letters, strict=True) if letter in DIVISORS)
    return Layout(kind, name, letters, names, scaled)


def decoded(content: bytes) -> str:
    """Return the text before the first zero; bytes that are no UTF-8 are Latin, unprintable ones blanks."""
    written = bytes(content).split(b"\0", 1)[0]
    try:
        return one_line(written.decode())
    except UnicodeDecodeError:
        return one_line(written.decode("latin-1"))


@dataclass(frozen=True)
class Messages:
    """All messages of one kind, in the order of the log; `rows` (n,) are their bodies."""

    layout: Layout
    rows: npt.NDArray[Any]

    def texts(self, column: str) -> list[str]:
        """Return a column of text; empty if it holds none."""
        if self.layout.letter(column) not in {*TEXTS}:
            return []
        return [decoded(value) for value in self.rows[str(self.layout.columns.index(column))]]

    @cached_property
    def columns(self) -> Numbers:
        """Columns of numbers, those of a letter "a" as "name[0]", "name[1]"."""
        raw: dict[str, npt.NDArray[Any]] = {}
        for i, (name, letter) in enumerate(zip(self.layout.columns, self.layout.letters, strict=True)):
            if letter == "a":
                raw |= {f"{name}[{k}]": self.rows[str(i)][:, k] for k in range(32)}
            elif letter not in TEXTS:
                raw[name] = self.rows[str(i)]
        letters = zip(self.layout.columns, self.layout.letters, strict=True)
        return Numbers(raw, divisors={n: DIVISORS[x] for n, x in letters if x in DIVISORS})

    def numbers(self, column: str) -> FloatArray:
        """Return a column of numbers; empty if it holds none."""
        return self.columns[column] if column in self.columns else np.empty(0)


def read_dataflash(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .bin file.

    Parameters
    ----------
    path : the file
    topics : names of messages wanted, such as {"IMU", "ATT"}; None means all

    Raises
    ------
    LogError
        When it is empty, no DataFlash log, or holds no sample.
    """
    return parse_dataflash(path, _copy_private(path), topics)


def release_pages(content: bytes | memoryview, at: int) -> None:
    """Give back the pages of a private copy before a place in it, so that a log is not in memory twice."""
    memory = content.obj if isinstance(content, memoryview) else None
    whole = at // mmap.PAGESIZE * mmap.PAGESIZE
    if whole and isinstance(memory, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        memory.madvise(mmap.MADV_DONTNEED, 0, whole)


def _copy_private(path: Path) -> memoryview:
    """Return a copy of a file in memory of this process alone.

    A mapped file would end the process when another one truncates it, and would not be the same in both walks when it is
    written. The pages of the copy are given back one by one.
    """
    try:
        with path.open("rb") as file:
            size = checked_size(path, file, LIMITS.size)
            private = {"flags": mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS} if hasattr(mmap, "MAP_PRIVATE") else {}
            content = memoryview(mmap.mmap(-1, size, **private))  # lives as long as an array over it
            return content[: file.readinto(content)]
    except OSError as error:
        raise unreadable(path, error) from None


def parse_dataflash(
    path: Path, content: bytes | memoryview, topics: frozenset[str] | None = None
) -> Recording:
    """Read a log from memory; see `read_dataflash`."""
    data = np.frombuffer(content, np.uint8)
    found = survey(data)
    layouts, defects = _layouts(found.definitions, found.count, path.name)
    wanted = [k for k, layout in sorted(layouts.items()) if is_wanted(layout.name, topics)]
    blocks = gather(data, found, wanted, partial(release_pages, content))
    kinds = [Messages(layouts[k], block.reshape(-1).view(layouts[k].row)) for k, block in blocks.items()]
    for start, end in found.gaps[: LIMITS.places].tolist():
        message = f"{end - start} bytes are no message and were skipped"
        defects.append(Defect("corrupt", f"{path.name} byte {start}", message))
    if found.damaged > LIMITS.places:
        message = f"damaged in {found.damaged} places, {found.lost} bytes in all; the first {LIMITS.places} are listed"
        defects.append(Defect("corrupt", path.name, message))
    if found.cut >= 0:
        defects.append(Defect("truncated", f"{path.name} byte {found.cut}", "the last message is cut"))
    unknown = [f"{kind} ({count})" for kind, count in enumerate(found.unknown.tolist()) if count]
    if unknown:
        message = f"messages of undefined kinds skipped: {listed(unknown, 10)}"
        defects.append(Defect("skipped", path.name, message))
    names = sorted(layout.name for k, layout in layouts.items() if k not in wanted)
    return replace(assemble(path, kinds, defects), unread=dict.fromkeys(names, ()))


def _layouts(
    definitions: npt.NDArray[np.uint8], counts: npt.NDArray[np.int64], place: str
) -> tuple[dict[int, Layout], list[Defect]]:
    """Return the layouts that have messages; of several with one name, that with the most."""
    layouts: dict[int, Layout] = {}
    names: set[str] = set()
    defects = []
    for k in np.argsort(-counts, kind="stable").tolist():
        if k == 0 or not counts[k]:
            continue
        body = np.frombuffer(definitions[k].tobytes(), BODY)[0]
        name, letters, columns = (decoded(body[key]) for key in ("name", "format", "columns"))
        layout = make_layout(int(body["kind"]), name, letters, columns)
        if layout is None or layout.row.itemsize != int(body["length"]) - 3:
            message = f"{counts[k]} messages of kind {body['kind']} skipped: their definition is invalid"
            defects.append(Defect("skipped", place, message))
        elif layout.name in names:
            message = f"{counts[k]} messages skipped: they are defined otherwise than the rest"
            defects.append(Defect("skipped", layout.name, message))
        else:
            names.add(layout.name)
            layouts[k] = layout
    return layouts, defects


def is_wanted(name: str, topics: frozenset[str] | None) -> bool:
    """Return whether messages of this name are to be kept."""
    return topics is None or name in topics or name in DESCRIPTIVE


def assemble(path: Path, kinds: Sequence[Messages], defects: Sequence[Defect]) -> Recording:
    """Return streams, parameters, texts and units of all messages, whether they were bytes or text.

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
        for place, time, columns in _instances(kind, numbered.get(name), found):
            if add_stream(streams, found, place, time, columns):
                own = {c: u for c, u in stated.get(name, {}).items() if c in columns}
                units |= {place: own} if own else {}
    if not streams:
        remedy = "copy it again from the autopilot"
        raise nothing_read(path, "no message holds samples with a time", found, remedy)
    parameters: dict[str, float] = {}  # the first value of each: later ones were changed in flight
    if (stored := named.get("PARM")) is not None:
        for name, value in zip(stored.texts("Name"), stored.numbers("Value").tolist(), strict=False):
            if name and math.isfinite(value) and len(parameters) < LIMITS.parameters:
                parameters.setdefault(name, value)
    return Recording(path, "dataflash", streams, tuple(found), {}, parameters, _texts(named), units)


def _instances(
    kind: Messages, numbered: str | None, defects: list[Defect]
) -> Iterator[tuple[str, FloatArray, Numbers]]:
    """Yield name, time [s] and columns of each instance of one kind of messages; add what is wrong to the defects."""
    layout, rows = kind.layout, kind.rows
    if layout.name in DESCRIPTIVE or set(layout.letters) <= {*TEXTS} or not rows.size:
        return
    # Logs before 2014 count milliseconds; their GPS messages call so the time of the week, and the logger's "T".
    clock, period = "", 1e-3
    if layout.is_integer("TimeUS"):
        clock, period = "TimeUS", 1e-6
    elif layout.is_integer("TimeMS"):
        clock = "T" if "Week" in layout.columns and layout.is_integer("T") else "TimeMS"
    if not clock:
        defects.append(Defect("skipped", layout.name, f"{rows.size} messages skipped: they have no time"))
        return
    instances = {"": rows}
    if numbered is not None and layout.letter(numbered) not in {"", "a"}:
        numbers = rows[str(layout.columns.index(numbered))]
        marks, count = np.unique(numbers, return_counts=True)
        kept = np.sort(np.argsort(-count, kind="stable")[: LIMITS.instances])
        instances = {}
        for mark in marks[kept]:  # a number, or a text; the first has no name
            called = decoded(mark) if isinstance(mark, bytes) else f"{float(mark):g}" if mark else ""
            # NaN is one, too
            places = np.flatnonzero(numbers == mark if mark == mark else numbers != numbers)
            step = int(places[1] - places[0]) if places.size > 1 else 1
            even = bool(np.all(np.diff(places) == step))  # as instances mostly are: no copy is needed
            instances[called] = rows[places[0] :: step][: places.size] if even else rows[places]
        if marks.size > LIMITS.instances:
            message = f"{marks.size} instances; the {LIMITS.instances} with the most samples are kept"
            defects.append(Defect("skipped", layout.name, message))
    for number, part in instances.items():
        place = f"{layout.name}/{number}" if number else layout.name
        known = Messages(layout, part).columns
        raw = {name: x for name, x in known.raw.items() if name != clock}
        columns = Numbers(raw, divisors=known.divisors)
        if columns:
            yield place, known[clock] * period, columns


def _units(named: Mapping[str, Messages]) -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    """Return the unit of each column of each kind, and the column that numbers the instances, where there is one."""

    def by_mark(name: str, column: str) -> dict[str, Any]:
        """Return the character of a unit or multiplier -> its meaning."""
        if (kind := named.get(name)) is None:
            return {}
        values = kind.texts(column) if column == "Label" else kind.numbers(column).tolist()
        marks = zip(kind.numbers("Id").tolist(), values, strict=False)
        return {chr(int(mark)): value for mark, value in marks if 0.0 < mark < 128.0}

    labels, multipliers = by_mark("UNIT", "Label"), by_mark("MULT", "Mult")
    units: dict[str, dict[str, str]] = {}
    numbered: dict[str, str] = {}
    if (kind := named.get("FMTU")) is None:
        return units, numbered
    layouts = {float(other.layout.kind): other.layout for other in named.values()}
    marks = kind.texts("UnitIds"), chain(kind.texts("MultIds"), repeat(None))
    for number, unit_marks, multiplier_marks in zip(kind.numbers("FmtType").tolist(), *marks, strict=False):
        if (layout := layouts.get(number)) is None:
            continue
        padded = (multiplier_marks or "").ljust(len(unit_marks), "-")
        for column, mark, times in zip(layout.columns, unit_marks, padded, strict=False):
            label = labels.get(mark, "")
            unit = SPELLINGS.get(label, label)
            factor = 1.0 if column in layout.scaled else multipliers.get(times, 1.0)
            factor = float(f"{factor:.7g}")  # written as float, kept as double
            if unit and factor not in (0.0, 1.0):  # 0 and 1 mean none
                unit = PREFIXES[factor] + unit if factor in PREFIXES else f"{factor:.4g} {unit}"
            if unit and multiplier_marks is not None:  # of an unknown multiple it tells nothing
                units.setdefault(layout.name, {})[column] = unit
            if mark == "#":
                numbered.setdefault(layout.name, column)
    return units, numbered


def _texts(named: Mapping[str, Messages]) -> dict[str, str]:
    """Return version and firmware of the autopilot, and its messages, one to a line."""
    info: dict[str, str] = {}
    if (kind := named.get("VER")) is not None and kind.rows.size:
        first = Messages(kind.layout, kind.rows[:1])
        for column in kind.layout.columns:
            if column not in ("TimeUS", "TimeMS"):
                values = first.texts(column) or [f"{x:g}" for x in first.numbers(column)] or [""]
                info[f"VER.{column}"] = values[0]
    if (kind := named.get("MSG")) is not None:
        texts = Messages(kind.layout, kind.rows[: LIMITS.texts]).texts("Message")
        firmware = next((line for line in texts if FIRMWARE.search(line)), None)
        info |= {"firmware": firmware} if firmware else {}
        info["messages"] = "\n".join(texts)
    return info
