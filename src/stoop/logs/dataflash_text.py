"""ArduPilot DataFlash logs as text (.log): one message to a line, "IMU, 1234, 0.1, 0.2", defined by FMT lines.

Numbers are as they are meant: whoever wrote the text has scaled them. Lines are sorted by their name, and each name is parsed
as a table; a line with too few or too many cells is skipped and counted.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.errors import LogError, one_line
from stoop.logs.dataflash_content import assemble, is_wanted
from stoop.logs.dataflash_format import TEXTS, Layout, Messages, make_layout
from stoop.logs.recording import Defect, Recording, unreadable

MAX_BYTES: Final = 256 * 2**20  #: of text, twenty minutes of a busy log
MAX_LINE: Final = 1024
MAX_KINDS: Final = 256  #: ids of messages are bytes
FEW: Final = 50  #: lines that are parsed before the parser of tables is even prepared
_AGAIN: Final = "copy it again from the autopilot"


@dataclass
class _Lines:
    """Lines of one name: their cells, as one text, and what did not fit."""

    layout: Layout
    wanted: bool
    cells: list[bytes] = field(default_factory=list)
    misfits: int = 0
    unread: int = 0


def read_dataflash_text(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .log file.

    Parameters
    ----------
    path : the file
    topics : names of messages wanted; None means all

    Raises
    ------
    LogError
        When it is empty, no DataFlash log, larger than `MAX_BYTES`, or holds no sample.
    """
    try:
        with path.open("rb") as file:
            content = file.read(min(MAX_BYTES, os.fstat(file.fileno()).st_size) + 1)
    except OSError as error:
        raise unreadable(path, error) from None
    return parse_dataflash_text(path, content, topics)


def parse_dataflash_text(path: Path, content: bytes, topics: frozenset[str] | None = None) -> Recording:
    """Read a log from memory; see `read_dataflash_text`."""
    if not content:
        raise LogError(f"{path}: the log is empty; {_AGAIN}")
    if len(content) > MAX_BYTES:
        raise LogError(f"{path}: more than {MAX_BYTES >> 20} MiB of text; name the .bin file instead")
    kinds, defects = _sorted_lines(path.name, content, topics)
    messages = []
    for name, lines in kinds.items():
        if lines.wanted:
            found, met = _messages(name, lines)
            messages.append(found)
            defects += met
    names = sorted(name for name, lines in kinds.items() if lines.unread)
    return replace(assemble(path, messages, defects), unread=dict.fromkeys(names, ()))


def _sorted_lines(
    place: str, content: bytes, topics: frozenset[str] | None
) -> tuple[dict[str, _Lines], list[Defect]]:
    """Part the lines by name; FMT lines say what to expect."""
    kinds: dict[str, _Lines] = {}
    unknown: dict[bytes, int] = {}
    first: dict[bytes, int] = {}
    known: dict[bytes, _Lines] = {}
    for at, line in _lines(content):
        name, comma, rest = line.partition(b",")
        name = name.strip()
        if name == b"FMT":
            _define(rest, kinds, known, topics)
        elif not comma or name not in known:
            key = name if comma and len(unknown) < 100 else b""
            unknown[key] = unknown.get(key, 0) + 1
            first.setdefault(key, at)
        else:
            _take(known[name], rest)
    return kinds, _strangers(place, unknown, first)


def _lines(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Return each line that is not blank, and where it begins."""
    at = 0
    while at < len(content):
        end = content.find(b"\n", at)
        end = len(content) if end < 0 else end
        line = content[at : min(end, at + MAX_LINE)].strip()
        if line:
            yield at, line
        at = end + 1


def _define(
    rest: bytes,
    kinds: dict[str, _Lines],
    known: dict[bytes, _Lines],
    topics: frozenset[str] | None,
) -> None:
    """Take a definition in: id, length, name, letters, columns; the first of a name counts."""
    cells = [cell.decode("latin-1").strip() for cell in rest.split(b",", 4)]
    if (
        len(cells) < 5
        or not cells[0].isdecimal()
        or cells[2] in kinds
        or cells[2] == "FMT"
        or len(kinds) == MAX_KINDS
    ):
        return
    columns = ",".join(column.strip() for column in cells[4].split(","))
    layout = make_layout(int(cells[0][:9]), cells[2], cells[3], columns)
    if layout is not None:
        letters = "".join("Z" if letter in TEXTS else "d" for letter in layout.letters)
        lines = _Lines(replace(layout, letters=letters), is_wanted(layout.name, topics))
        kinds[layout.name] = known[layout.name.encode()] = lines


def _take(lines: _Lines, rest: bytes) -> None:
    """Keep the cells of a line that is wanted, if there is one for each column; a text at the end may hold commas."""
    if not lines.wanted:
        lines.unread += 1
        return
    least = len(lines.layout.columns) - 1
    commas = rest.count(b",")
    if commas == least or (commas > least and lines.layout.letters[-1] == "Z"):
        lines.cells.append(rest)
    else:
        lines.misfits += 1


def _strangers(place: str, unknown: dict[bytes, int], first: dict[bytes, int]) -> list[Defect]:
    defects = []
    if damaged := unknown.pop(b"", 0):
        message = f"{damaged} lines are no message and were skipped"
        defects.append(Defect("corrupt", f"{place} byte {first[b'']}", message))
    for name, count in list(unknown.items())[:10]:
        shown = one_line(name[:16].decode("latin-1"))
        message = f"{count} lines of the undefined kind '{shown}' skipped"
        defects.append(Defect("skipped", f"{place} byte {first[name]}", message))
    if len(unknown) > 10:
        defects.append(Defect("skipped", place, f"{len(unknown) - 10} more undefined kinds skipped"))
    return defects


def _messages(name: str, lines: _Lines) -> tuple[Messages, list[Defect]]:
    """Parse all lines of one name."""
    rows = np.zeros(len(lines.cells), lines.layout.row)
    lost = _fill_mixed(rows, lines) if "Z" in lines.layout.letters else _fill_numbers(rows, lines)
    defects = []
    if lines.misfits:
        message = f"{lines.misfits} lines skipped: they have too few or too many cells"
        defects.append(Defect("corrupt", name, message))
    if lost:
        defects.append(Defect("text", name, f"{lost} of {rows.size} cells of a column hold no number"))
    return Messages(lines.layout, rows), defects


def _fill_numbers(rows: npt.NDArray[Any], lines: _Lines) -> int:
    """Parse a table of numbers; return the cells without a number in the worst column."""
    if len(lines.cells) < FEW:
        return _fill_mixed(rows, lines)
    import pandas as pd  # heavy, and only here

    table = pd.read_csv(
        io.BytesIO(b"\n".join(lines.cells)), header=None, names=list(range(len(lines.layout.columns))),
        skipinitialspace=True, quoting=3, lineterminator="\n", low_memory=False,
        encoding="latin-1", skip_blank_lines=False, index_col=False,
    )  # fmt: skip
    if len(table) != rows.size:  # some byte ends a line for one but not for the other
        return _fill_mixed(rows, lines)
    worst = 0
    for i in range(len(lines.layout.columns)):
        numbers = pd.to_numeric(table[i], errors="coerce")
        worst = max(worst, int(numbers.isna().sum() - table[i].isna().sum()))
        rows[str(i)] = np.asarray(numbers, dtype=np.float64)
    return worst


def _fill_mixed(rows: npt.NDArray[Any], lines: _Lines) -> int:
    """Parse lines that hold texts among the numbers."""
    lost = 0
    for row, line in zip(rows, lines.cells, strict=True):
        cells = [cell.strip() for cell in line.split(b",", len(lines.layout.columns) - 1)]
        for i, (letter, cell) in enumerate(zip(lines.layout.letters, cells, strict=True)):
            value = cell if letter == "Z" else _number(cell)
            lost += value is None
            row[str(i)] = np.nan if value is None else value
    return lost


def _number(cell: bytes) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
