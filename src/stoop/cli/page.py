"""What verbs print on: rich on a terminal, plain text in a pipe, with the same words; numbers aligned at their points."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

from stoop.base.text import printable, printable_lines, show

if TYPE_CHECKING:
    from rich.console import Console

#: characters in a line of a pipe: nothing is wrapped or cut, so that programs can read it
UNLIMITED: Final = 10_000
GAP: Final = "  "
MIN_WIDTH: Final = 16  #: characters of a text that is cut


@dataclass(frozen=True)
class Column:
    """One column: numbers are flush right; long texts may go on in the next line (`wraps`) or are cut."""

    head: str
    cells: tuple[str, ...]
    right: bool = False
    wraps: bool = False

    @property
    def width(self) -> int:
        """Characters of its widest cell."""
        return max(map(len, (self.head, *self.cells)))


def words(head: str, cells: Iterable[str], wraps: bool = False) -> Column:
    """Make a column of text."""
    return Column(printable(head), tuple(map(printable, cells)), wraps=wraps)


def points(head: str, texts: Sequence[str]) -> Column:
    """Make a column of numbers already written, padded so that, flush right, their points stand below each other."""
    tails = [len(text) - (text.index(".") if "." in text else len(text)) for text in texts]
    longest = max(tails, default=0)
    cells = tuple(text + " " * (longest - tail) for text, tail in zip(texts, tails, strict=True))
    return Column(printable(head), cells, right=True)


def numbers(head: str, values: Iterable[float]) -> Column:
    """Make a column of numbers with four significant digits, their points below each other."""
    return points(head, [number(v) for v in values])


def fixed(head: str, values: Iterable[float], decimals: int) -> Column:
    """Make a column of numbers with so many decimals."""
    return points(head, [fixed_text(v, decimals) for v in values])


def column(head: str, cells: Iterable[Any], decimals: int | None = None, wraps: bool = False) -> Column:
    """Make a column of text, of numbers with so many decimals, or of numbers with four significant digits."""
    known = list(cells)
    if all(isinstance(cell, str) for cell in known):
        return words(head, known, wraps)
    return numbers(head, known) if decimals is None else fixed(head, known, decimals)


def number(value: float, digits: int = 4) -> str:
    """Write a number with so many significant digits, without an exponent where that stays short."""
    if not math.isfinite(value):
        return "-" if math.isnan(value) else f"{value:g}"
    if value == 0.0:
        return "0"
    text = f"{value:.{digits - 1}e}"
    exponent = int(text.partition("e")[2])  # of the rounded number
    return f"{value:.{max(digits - 1 - exponent, 0)}f}" if 1e-4 <= abs(value) < 1e7 else text


def fixed_text(value: float, decimals: int) -> str:
    """Write a number with so many decimals; what rounds to zero has no sign."""
    return f"{value:z.{decimals}f}" if math.isfinite(value) else "-"


def alike(values: Sequence[float], digits: int = 4) -> list[str]:
    """Write numbers with the decimals that the largest of them needs."""
    largest = max((abs(v) for v in values if math.isfinite(v)), default=0.0)
    if not (largest == 0.0 or 1e-4 <= largest < 1e7):
        return [number(v, digits) for v in values]
    decimals = len(number(largest, digits).partition(".")[2])
    return [fixed_text(v, decimals) for v in values]


def plain(columns: Sequence[Column]) -> str:
    """Return the table as text; no line ends in blanks."""
    texts = ((c, (c.head, *c.cells)) for c in columns)
    padded = [[t.rjust(c.width) if c.right else t.ljust(c.width) for t in own] for c, own in texts]
    return "\n".join(GAP.join(cells).rstrip() for cells in zip(*padded, strict=True))


def fit(columns: Sequence[Column], width: int) -> list[Column]:
    """Make a table as narrow as the page: a last column of words is wrapped, else cut, else left out."""
    *others, last = columns
    room = width - sum(column.width + len(GAP) for column in others)
    if last.right or last.width <= room or not others:
        return list(columns)
    if last.wraps:
        parts = [textwrap.wrap(cell, max(room, MIN_WIDTH)) or [""] for cell in last.cells]
        folded = []
        for c in others:
            cells = ((cell, *[""] * (len(lines) - 1)) for cell, lines in zip(c.cells, parts, strict=True))
            folded.append(replace(c, cells=tuple(chain.from_iterable(cells))))
        return [*folded, replace(last, cells=tuple(chain.from_iterable(parts)))]
    if room < MIN_WIDTH:
        return others
    cut = tuple(cell if len(cell) <= room else f"{cell[: room - 3]}..." for cell in last.cells)
    return [*others, replace(last, cells=cut)]


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


class Page:
    """Somewhere to print on: a terminal's console, where long lines wrap and tables fit, or plain text on stdout.

    Whatever is printed may come from a hostile file: it is made printable and never read as markup.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console
        self.width = UNLIMITED if console is None else console.width

    number = staticmethod(number)

    def heading(self, text: str) -> None:
        """Print a blank line and a heading."""
        self.line()
        self._print(printable(text), style="bold")

    def line(self, text: str = "") -> None:
        """Print one line, wrapped where the page is narrower."""
        self._print(printable(text))

    def command(self, start: str, command: Sequence[str]) -> None:
        """Print a command to copy, quoted for the shell and never broken into lines."""
        self._print(printable(f"{start}{shlex.join(command)}"), whole=True)

    def bullets(self, items: Iterable[object], heading: str = "") -> None:
        """Print a list, under a heading if it has any item; what does not fit goes on below the text, not the dash."""
        texts = [printable(str(item)) for item in items]
        if texts and heading:
            self.heading(heading)
        if self._console is None:
            for text in texts:
                show(f"- {text}")
            return
        from rich.table import Table
        from rich.text import Text

        grid = Table.grid(padding=(0, 1, 0, 0))
        for text in texts:
            grid.add_row("-", Text(text))
        self._console.print(grid)

    def table(self, *columns: Column) -> None:
        """Print a table; on a terminal a last column of words goes on below itself, is cut, or left out where it must."""
        head, _, rows = plain(fit(columns, self.width)).partition("\n")
        self._print(head, style="dim", whole=True)
        if rows:
            self._print(rows, whole=True)

    def text(self, lines: str) -> None:
        """Print lines that are laid out already."""
        self._print(lines, whole=True)

    def _print(self, text: str, style: str = "", whole: bool = False) -> None:
        if self._console is None:
            show(text)
            return
        from rich.text import Text

        self._console.print(Text(printable_lines(text), style=style), soft_wrap=whole)


def page() -> Page:
    """Return the page that fits the output."""
    if not sys.stdout.isatty() or os.environ.get("TERM") == "dumb":
        return Page()
    from rich.console import Console

    return Page(Console(markup=False, highlight=False, emoji=False))


def to_json(document: Mapping[str, Any], indent: int = 2) -> str:
    """Return strict JSON: a number that is not finite becomes null."""
    return json.dumps(_strict(document), indent=indent, allow_nan=False)


def _strict(value: Any) -> Any:
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    return [_strict(item) for item in value] if isinstance(value, list | tuple) else value
