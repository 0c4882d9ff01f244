"""Pages of studies: prose, tables and figures in sections -> one HTML file that needs nothing else."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup

from stoop.base.files import write_text_atomic
from stoop.report.templating import environment

ITEM: Final = "- "  #: begins a line of a list
NUMERIC: Final = re.compile(r"[<>≤≥≈~±×]?\s?[−+-]?(\d|[.]\d|∞|nan\b|inf\b)")
WORD: Final = re.compile(r"[^\W\d_]{4,}")  #: a cell with a word in it is text, whatever it begins with
QUOTED: Final = re.compile(r"`([^`\n]+)`")
LONG: Final = (
    34  #: characters of a cell that may go on in the next line; `td.wrap` of the style sheet is as wide
)
BESIDE: Final = 3  #: columns that a narrow page has room for
EMPTY: Final = ("", "–", "—", "-")


@dataclass(frozen=True)
class Prose:
    """Plain text: a blank line ends a paragraph, lines that begin with ``- `` are a list, `names` stand in backticks."""

    text: str


@dataclass(frozen=True)
class Code:
    """A command or other text that is shown as it stands."""

    text: str


@dataclass(frozen=True)
class Table:
    """Ready texts; a column whose cells look like numbers is set flush right.

    Attributes
    ----------
    caption : str
    head : tuple of str, one per column
    rows : tuple of rows, each as long as the head; the first cell names the row
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Whether each column holds numbers, nothing but dashes between them."""
        return tuple(_numeric([row[i] for row in self.rows]) for i in range(len(self.head)))

    @property
    def wraps(self) -> tuple[bool, ...]:
        """Whether each column holds text so long that it may go on in further lines."""
        longest = [max((len(row[i]) for row in self.rows), default=0) for i in range(len(self.head))]
        return tuple(n > LONG for n in longest)

    @property
    def folds(self) -> bool:
        """Whether a narrow page sets the last column below the others, for which there is no room beside them."""
        return len(self.head) > BESIDE and self.wraps[-1] and sum(self.wraps) == 1


@dataclass(frozen=True)
class Figure:
    """A drawing of `stoop.report.plots` and what it shows."""

    caption: str
    drawing: Markup


@dataclass(frozen=True)
class Section:
    """A title and what stands below it, in order."""

    title: str
    parts: tuple[Prose | Code | Table | Figure, ...]


@dataclass(frozen=True)
class Sheet:
    """A page.

    Attributes
    ----------
    title : str
    lead : str
        What the reader should know first; written as `Prose`.
    sections : tuple of Section
    """

    title: str
    lead: str
    sections: tuple[Section, ...]


def write_sheet(sheet: Sheet, path: Path) -> None:
    """Write the page whole or not at all.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    write_text_atomic(path, render_sheet(sheet))


def render_sheet(sheet: Sheet) -> str:
    """Return the page as HTML; whatever text it holds is shown as text."""
    sections = [
        {"title": section.title, "anchor": anchor, "parts": [_part(part) for part in section.parts]}
        for section, anchor in zip(sheet.sections, _anchors(sheet), strict=True)
    ]
    template = environment().get_template("sheet.html")
    return template.render(sheet=sheet, lead=_blocks(sheet.lead), sections=sections)


def _part(part: Prose | Code | Table | Figure) -> tuple[str, Any]:
    if isinstance(part, Prose):
        return "prose", _blocks(part.text)
    if isinstance(part, Code):
        return "code", part.text
    return ("table" if isinstance(part, Table) else "figure"), part


def _blocks(text: str) -> list[tuple[str, list[Markup]]]:
    """Return paragraphs and lists: ("text", [paragraph]) or ("list", items)."""
    blocks: list[tuple[str, list[Markup]]] = []
    for piece in re.split(r"\n\s*\n", text.strip()):
        lines = [line.strip() for line in piece.splitlines()]
        for listed, group in groupby(lines, lambda line: line.startswith(ITEM)):
            found = list(group)
            said = [line[len(ITEM) :] for line in found] if listed else [" ".join(found)]
            blocks.append(("list" if listed else "text", [_with_names(line) for line in said]))
    return blocks


def _with_names(text: str) -> Markup:
    """Return the text, escaped, with what stands in backticks as code."""
    parts = QUOTED.split(text)  # what is quoted has odd places
    return Markup("").join(
        Markup("<code>{}</code>").format(part) if i % 2 else part for i, part in enumerate(parts)
    )


def _anchors(sheet: Sheet) -> list[str]:
    """Return one name per section that a link can point at, no two alike."""
    found: list[str] = []
    for i, section in enumerate(sheet.sections):
        name = "-".join(re.findall(r"[a-z0-9]+", section.title.lower())) or f"section-{i + 1}"
        while name in found:
            name += f"-{i + 1}"
        found.append(name)
    return found


def _numeric(cells: list[str]) -> bool:
    told = [cell for cell in cells if cell not in EMPTY]
    return bool(told) and all(NUMERIC.match(cell) and not WORD.search(cell) for cell in told)
