"""Tables of text: numbers aligned at their points, columns no wider than they need."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from stoop.cli.printable import printable

GAP = "  "
DIGITS = 4
MIN_WIDTH = 16  #: characters of a text that is cut


@dataclass(frozen=True)
class Column:
    """One column, ready to print.

    Attributes
    ----------
    head : what stands above
    cells : texts
    right : whether it is flush right, as numbers are
    wraps : whether cells may go on in the next line where the page is too narrow; others are cut
    """

    head: str
    cells: tuple[str, ...]
    right: bool = False
    wraps: bool = False

    @property
    def width(self) -> int:
        """Characters of its widest cell."""
        return max(map(len, (self.head, *self.cells)))

    def lines(self) -> list[str]:
        """Return the head and all cells, padded to one width."""
        return [t.rjust(self.width) if self.right else t.ljust(self.width) for t in (self.head, *self.cells)]


def words(head: str, cells: Iterable[str], wraps: bool = False) -> Column:
    """Make a column of text."""
    return Column(printable(head), tuple(map(printable, cells)), wraps=wraps)


def points(head: str, texts: Sequence[str]) -> Column:
    """Make a column of numbers already written, their points below each other."""
    return Column(printable(head), aligned(texts), right=True)


def numbers(head: str, values: Iterable[float]) -> Column:
    """Make a column of numbers with :data:`DIGITS` digits, their points below each other."""
    return points(head, [number(v) for v in values])


def fixed(head: str, values: Iterable[float], decimals: int) -> Column:
    """Make a column of numbers with so many decimals."""
    return points(head, [_fixed(v, decimals) for v in values])


def plain(columns: Sequence[Column]) -> str:
    """Return the table as text; no line ends in blanks."""
    return "\n".join(GAP.join(cells).rstrip() for cells in zip(*(c.lines() for c in columns), strict=True))


def number(value: float, digits: int = DIGITS) -> str:
    """Write a number with so many significant digits, without an exponent where that stays short."""
    if not math.isfinite(value):
        return "-" if math.isnan(value) else f"{value:g}"
    if value == 0.0:
        return "0"
    if not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits - 1}e}"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])  # of the rounded number
    return f"{value:.{max(digits - 1 - exponent, 0)}f}"


def alike(values: Sequence[float], digits: int = DIGITS) -> list[str]:
    """Write numbers with the decimals that the largest of them needs."""
    largest = max((abs(v) for v in values if math.isfinite(v)), default=0.0)
    if not (largest == 0.0 or 1e-4 <= largest < 1e7):
        return [number(v, digits) for v in values]
    decimals = len(number(largest, digits).partition(".")[2])
    return [_fixed(v, decimals) for v in values]


def aligned(texts: Sequence[str]) -> tuple[str, ...]:
    """Pad numbers on the right so that, flush right, their points stand below each other."""
    tails = [len(text) - _point(text) for text in texts]
    longest = max(tails, default=0)
    return tuple(text + " " * (longest - tail) for text, tail in zip(texts, tails, strict=True))


def _point(text: str) -> int:
    return text.index(".") if "." in text else len(text)


def _fixed(value: float, decimals: int) -> str:
    """Write a number with so many decimals; what rounds to zero has no sign."""
    return f"{value:z.{decimals}f}" if math.isfinite(value) else "-"


def fit(columns: Sequence[Column], width: int) -> list[Column]:
    """Make a table as narrow as the page at the cost of its last column, if that holds words.

    It goes on in further lines where it may, is cut otherwise, and left out where nothing useful remains.
    """
    *others, last = columns
    room = width - sum(column.width + len(GAP) for column in others)
    if last.right or last.width <= room or not others:
        return list(columns)
    if last.wraps:
        return _folded(others, last, max(room, MIN_WIDTH))
    if room < MIN_WIDTH:
        return others
    cells = (cell if len(cell) <= room else f"{cell[: room - 3]}..." for cell in last.cells)
    return [*others, replace(last, cells=tuple(cells))]


def _folded(others: Sequence[Column], last: Column, room: int) -> list[Column]:
    """Give each cell of the last column as many lines as it needs."""
    parts = [textwrap.wrap(cell, room) or [""] for cell in last.cells]
    padded = [replace(c, cells=_spread(c.cells, parts)) for c in others]
    return [*padded, replace(last, cells=tuple(line for lines in parts for line in lines))]


def _spread(cells: Sequence[str], parts: Sequence[Sequence[str]]) -> tuple[str, ...]:
    rows = ((cell, *[""] * (len(lines) - 1)) for cell, lines in zip(cells, parts, strict=True))
    return tuple(text for row in rows for text in row)


def blocks(label: Column, columns: Sequence[Column], width: int) -> list[list[Column]]:
    """Split a wide table into tables of at most ``width`` characters, each with the label first."""
    out: list[list[Column]] = []
    used = width + 1
    for column in columns:
        used += len(GAP) + column.width
        if used > width:
            out.append([label])
            used = label.width + len(GAP) + column.width
        out[-1].append(column)
    return out


def shown_unit(unit: str) -> str:
    """Return a unit as people write it: nothing where there is none."""
    return "" if unit == "1" else unit
