"""ArduPilot DataFlash logs as text (.log): one message to a line, "IMU, 1234, 0.1, 0.2", defined by FMT lines.

Numbers are already scaled in the text. Lines are sorted by their name, and each name is parsed as a table; a line with
too few or too many cells is skipped and counted.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.errors import one_line
from stoop.logs.csv_tables import numbers, whole_lines
from stoop.logs.dataflash import TEXTS, Layout, Messages, assemble, decoded, is_wanted, make_layout
from stoop.logs.recording import Defect, Recording

MAX_LINE: Final = 1024
MAX_KINDS: Final = 256  #: ids of messages are bytes


@dataclass
class _Lines:
    """Lines of one name: the cells of those that fit, and counts of those that do not, or are not wanted."""

    layout: Layout
    wanted: bool
    cells: list[bytes] = field(default_factory=list)
    misfits: int = 0
    unread: int = 0

    def append(self, cells: bytes) -> None:
        """Add a line with one cell for each column; a text at the end may hold commas."""
        if not self.wanted:
            self.unread += 1
            return
        extra = cells.count(b",") - (len(self.layout.columns) - 1)
        if extra == 0 or (extra > 0 and self.layout.letters[-1] == "Z"):
            self.cells.append(cells)
        else:
            self.misfits += 1


def parse_dataflash_text(path: Path, content: bytes, topics: frozenset[str] | None = None) -> Recording:
    """Read a .log file.

    Parameters
    ----------
    path : its name
    content : its text
    topics : names of messages wanted; None means all

    Raises
    ------
    LogError
        When it is no DataFlash log, or holds no sample.
    """
    content, cut = whole_lines(content, path.name)
    kinds, defects = _by_name(path.name, content, topics)
    messages = []
    for name, lines in kinds.items():
        if not lines.wanted:
            continue
        rows = np.zeros(len(lines.cells), lines.layout.row)
        lost = _fill(rows, lines)
        messages.append(Messages(lines.layout, rows))
        if lines.misfits:
            message = f"{lines.misfits} lines skipped: they have too few or too many cells"
            defects.append(Defect("corrupt", name, message))
        if lost:
            defects.append(Defect("text", name, f"{lost} of {rows.size} cells of a column hold no number"))
    defects += cut
    names = sorted(name for name, lines in kinds.items() if lines.unread)
    return replace(assemble(path, messages, defects), unread=dict.fromkeys(names, ()))


def _by_name(
    place: str, content: bytes, topics: frozenset[str] | None
) -> tuple[dict[str, _Lines], list[Defect]]:
    """Sort the lines by name; the first FMT line of a name defines it."""
    kinds: dict[str, _Lines] = {}
    unknown: dict[bytes, int] = {}
    first: dict[bytes, int] = {}
    known: dict[bytes, _Lines] = {}
    for at, line in _lines(content):
        head, comma, rest = line.partition(b",")
        head = head.strip()
        if head == b"FMT":
            layout = _definition(rest)
            if layout is not None and layout.name not in kinds and len(kinds) < MAX_KINDS:
                lines = _Lines(layout, is_wanted(layout.name, topics))
                kinds[layout.name] = known[layout.name.encode()] = lines
        elif comma and head in known:
            known[head].append(rest)
        else:
            key = head if comma and len(unknown) < 100 else b""
            unknown[key] = unknown.get(key, 0) + 1
            first.setdefault(key, at)
    defects = []
    if damaged := unknown.pop(b"", 0):
        message = f"{damaged} lines are no message and were skipped"
        defects.append(Defect("corrupt", f"{place} byte {first[b'']}", message))
    for head, count in list(unknown.items())[:10]:
        message = f"{count} lines of the undefined kind '{one_line(head[:16].decode('latin-1'))}' skipped"
        defects.append(Defect("skipped", f"{place} byte {first[head]}", message))
    if len(unknown) > 10:
        defects.append(Defect("skipped", place, f"{len(unknown) - 10} more undefined kinds skipped"))
    return kinds, defects


def _lines(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield each line that is not blank, and where it begins."""
    at = 0
    while at < len(content):
        end = content.find(b"\n", at)
        end = len(content) if end < 0 else end
        if line := content[at : min(end, at + MAX_LINE)].strip():
            yield at, line
        at = end + 1


def _definition(rest: bytes) -> Layout | None:
    """Return the layout of a definition (id, length, name, letters, columns), whose numbers are all kept as double."""
    cells = [decoded(cell).strip() for cell in rest.split(b",", 4)]
    if len(cells) < 5 or not cells[0].isdecimal() or cells[2] == "FMT":
        return None
    columns = ",".join(column.strip() for column in cells[4].split(","))
    layout = make_layout(int(cells[0][:9]), cells[2], cells[3], columns)
    if layout is None:
        return None
    return replace(layout, letters="".join("Z" if letter in TEXTS else "d" for letter in layout.letters))


def _fill(rows: npt.NDArray[Any], lines: _Lines) -> int:
    """Parse the cells of lines into rows; return the cells without a number, of a table in the worst column."""
    layout, cells = lines.layout, lines.cells
    if "Z" not in layout.letters and len(cells) >= 50:  # fewer are parsed before pandas is imported
        import pandas as pd

        table = pd.read_csv(
            io.BytesIO(b"\n".join(cells)), header=None, names=list(range(len(layout.columns))),
            skipinitialspace=True, quoting=3, lineterminator="\n", low_memory=False,
            encoding="latin-1", skip_blank_lines=False, index_col=False,
        )  # fmt: skip
        if len(table) == rows.size:  # else some byte ends a line for pandas only
            worst = 0
            for i in range(len(layout.columns)):
                rows[str(i)] = values = numbers(table[i])
                worst = max(worst, int(np.isnan(values).sum() - table[i].isna().sum()))
            return worst
    lost = 0
    for row, line in zip(rows, cells, strict=True):
        parts = line.split(b",", len(layout.columns) - 1)
        for i, (letter, part) in enumerate(zip(layout.letters, parts, strict=True)):
            value: bytes | float = part.strip()
            if letter != "Z":
                try:
                    value = float(part.replace(b"_", b"x"))  # which Python skips, and pandas does not
                except ValueError:
                    value, lost = np.nan, lost + 1
            row[str(i)] = value
    return lost
