"""Pages: sections of prose, tables and figures -> one HTML file that needs nothing else from the network or the disk.

Reports and studies are written in these parts. All text is shown as text: nothing in it becomes markup.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Final, Literal
from xml.etree import ElementTree as ET

from markupsafe import Markup, escape

from stoop.base.files import write_file
from stoop.base.text import printable
from stoop.report.palette import COLORS, variables
from stoop.report.series import Series as Series
from stoop.report.series import Shade as Shade
from stoop.report.series import Strip as Strip
from stoop.report.time_history import HistoryPanel as HistoryPanel
from stoop.report.time_history import TimeHistory as TimeHistory
from stoop.report.track import Track

if TYPE_CHECKING:
    from jinja2 import Environment

ITEM: Final = "- "  #: begins a line of a list
NUMERIC: Final = re.compile(r"[<>≤≥≈~±×]?\s?[−+-]?(\d|[.]\d|∞|nan\b|inf\b)")
WORD: Final = re.compile(r"[^\W\d_]{4,}")  #: a cell with a word in it is text, whatever it begins with
QUOTED: Final = re.compile(r"`([^`\n]+)`")
#: characters of a cell; longer ones may wrap (`td.wrap` of the style sheet is as wide)
MAX_UNWRAPPED: Final = 34
MAX_BESIDE: Final = 3  #: columns that a narrow page has room for
EMPTY: Final = ("", "–", "—", "-")
MATHML: Final = "http://www.w3.org/1998/Math/MathML"
# fmt: off
ELEMENTS: Final = frozenset((
    "math", "mrow", "mi", "mn", "mo", "ms", "mtext", "mspace", "msub", "msup", "msubsup", "munder", "mover",
    "munderover", "mfrac", "msqrt", "mroot", "mtable", "mtr", "mtd", "mstyle", "mpadded", "mphantom",
    "menclose",
))
ATTRIBUTES: Final = frozenset((
    "display", "mathvariant", "stretchy", "width", "height", "depth", "fence", "form", "separator", "lspace",
    "rspace", "accent", "accentunder", "columnalign", "rowspacing", "columnspacing", "linethickness",
    "displaystyle", "scriptlevel", "minsize", "maxsize", "movablelimits",
))
# fmt: on
Level = Literal["good", "caution", "bad"]


@dataclass(frozen=True)
class Prose:
    """Plain text: a blank line ends a paragraph, lines that begin with a dash are a list, `names` stand in backticks."""

    template: ClassVar = "prose"
    text: str
    muted: bool = False  #: an explanation, in the color of what stands aside

    @property
    def blocks(self) -> list[tuple[str, list[Markup]]]:
        """Paragraphs and lists: ("text", [paragraph]) or ("list", items)."""
        blocks: list[tuple[str, list[Markup]]] = []
        for piece in re.split(r"\n\s*\n", self.text.strip()):
            lines = [line.strip() for line in piece.splitlines()]
            for listed, group in groupby(lines, lambda line: line.startswith(ITEM)):
                found = list(group)
                texts = [line[len(ITEM) :] for line in found] if listed else [" ".join(found)]
                shown = []
                for text in texts:  # escaped; what stands in backticks is code, and has the odd places
                    parts = enumerate(QUOTED.split(text))
                    marked = (Markup("<code>{}</code>").format(p) if i % 2 else p for i, p in parts)
                    shown.append(Markup("").join(marked))
                blocks.append(("list" if listed else "text", shown))
        return blocks


@dataclass(frozen=True)
class Bullets:
    """A list; `kind` is its class: "points", "notes" or "warnings"."""

    template: ClassVar = "bullets"
    items: Sequence[object]
    kind: str = "points"


@dataclass(frozen=True)
class Code:
    """A command or other text that is shown as it stands."""

    template: ClassVar = "code"
    text: str


@dataclass(frozen=True)
class Table:
    """Ready texts; a column whose cells look like numbers is set flush right."""

    template: ClassVar = "table"
    caption: str
    head: tuple[str, ...]  #: one per column
    #: each as long as the head; the first cell names the row; one may be opened
    rows: tuple[tuple[str | Details, ...], ...]
    kinds: tuple[str, ...] = ()  #: class of each column ("n": flush right); by default as its cells look
    row_kinds: tuple[str, ...] = ()  #: class of each row, if any
    label: str = "Table"  #: for who cannot see it, where there is no caption

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Whether each column holds numbers, nothing but dashes between them."""
        columns = [[cell for cell in cells if cell not in EMPTY] for cells in self._columns]
        return tuple(
            bool(cells) and all(NUMERIC.match(cell) and not WORD.search(cell) for cell in cells)
            for cells in columns
        )

    @property
    def wraps(self) -> tuple[bool, ...]:
        """Whether each column holds text so long that it may go on in further lines."""
        return tuple(max(map(len, cells), default=0) > MAX_UNWRAPPED for cells in self._columns)

    @property
    def _columns(self) -> list[list[str]]:
        rows = [[one.summary if isinstance(one, Details) else one for one in row] for row in self.rows]
        return [[row[i] for row in rows] for i in range(len(self.head))]

    @property
    def classes(self) -> tuple[str, ...]:
        """Class of each column."""
        if self.kinds:
            return self.kinds
        pairs = zip(self.numeric, self.wraps, strict=True)
        return tuple("n" if numeric else "wrap" if wraps else "" for numeric, wraps in pairs)

    @property
    def folds(self) -> bool:
        """Whether a narrow page sets the last column below the others, for which there is no room beside them."""
        return "fold" in "".join(self.kinds[-1:]) or (
            not self.kinds and len(self.head) > MAX_BESIDE and self.wraps[-1] and sum(self.wraps) == 1
        )


@dataclass(frozen=True)
class Figure:
    """A drawing and what it shows."""

    template: ClassVar = "figure"
    caption: str
    drawing: Markup


@dataclass(frozen=True)
class Panel:
    """A small drawing with its heading; `meaning` may hold the key of its curves."""

    title: str
    drawing: Markup
    unit: str = ""
    meaning: str = ""
    note: str = ""


@dataclass(frozen=True)
class Panels:
    """Drawings side by side; `size` is "small", "large" or empty."""

    template: ClassVar = "panels"
    panels: Sequence[Panel]
    size: str = ""


@dataclass(frozen=True)
class Legend:
    """What curves and colors mean: class and text of each; classes of swatches begin with "swatch"."""

    template: ClassVar = "legend"
    items: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Heading:
    """A heading within a section, with a role ("fit", "validation") before it or none."""

    template: ClassVar = "heading"
    text: str
    chip: str = ""


@dataclass(frozen=True)
class Drawing:
    """Markup of our own that needs no caption: equations, a map; `kind` is the class of its frame."""

    template: ClassVar = "drawing"
    kind: str
    content: Markup
    label: str


@dataclass(frozen=True)
class Details:
    """Parts that the reader opens."""

    template: ClassVar = "details"
    summary: str
    parts: Sequence[Part]


Drawn = Figure | Panels | Legend | Drawing | TimeHistory | Track
Part = Prose | Bullets | Code | Table | Heading | Details | Drawn


@dataclass(frozen=True)
class Section:
    """A title and what stands below it, in order; `short` is its name in the list of sections."""

    title: str
    parts: Sequence[Part]
    short: str = ""
    folded: bool = False  #: whether the reader opens it


@dataclass(frozen=True)
class Verdict:
    """Whether the result is reliable, and why: what speaks against it and for it in lists of their own, or all in one."""

    level: Level
    headline: str
    sentences: tuple[str, ...] = ()
    against: tuple[str, ...] = ()
    supports: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sheet:
    """A page."""

    title: str
    lead: str  #: what the reader should know first; written as `Prose`
    sections: tuple[Section, ...]
    kind: str = "study"  #: what sort of page it is
    verdict: Verdict | None = None
    #: file of the templates that the page runs beside those of its plots; it can be read without
    script: str = ""


@dataclass(frozen=True, repr=False)
class Page:
    """A page that works offline; a notebook shows it, still, in a frame of its own."""

    content: Sheet

    def __repr__(self) -> str:
        """Return the title on one line."""
        return printable(f"<Page {self.content.title}: save(path) writes it, a notebook shows it>")

    def save(self, path: str | Path) -> Path:
        """Write the page as HTML, whole or not at all."""
        write_sheet(self.content, Path(path))
        return Path(path)

    def _repr_html_(self) -> str:
        content = escape(render_sheet(self.content, scripts=False))
        return f'<iframe srcdoc="{content}" width="100%" height="640" style="border:0"></iframe>'


def write_sheet(sheet: Sheet, path: Path) -> None:
    """Write the page whole or not at all; raises `OutputError`."""
    write_file(path, render_sheet(sheet))


def render_sheet(sheet: Sheet, scripts: bool = True) -> str:
    """Return the page as HTML; each section has a name that a link can point at, no two alike.

    Time histories are interactive with `scripts`; without, they are the still pictures that are printed.
    """
    names: list[str] = []
    for i, section in enumerate(sheet.sections):
        name = "-".join(re.findall(r"[a-z0-9]+", (section.short or section.title).lower()))
        name = name or f"section-{i + 1}"
        while name in names:
            name += f"-{i + 1}"
        names.append(name)
    sections = list(zip(sheet.sections, names, strict=True))
    live = scripts and any(_runs_scripts(section.parts) for section in sheet.sections)
    own = [_allowed(_template(sheet.script))] if scripts and sheet.script else []
    allowed = [*(_scripts() if live else []), *own]
    page = {"sheet": sheet, "lead": Prose(sheet.lead), "sections": sections, "scripts": allowed}
    return _environment().get_template("page.html").render(page, light=variables(False), dark=variables(True))


def _runs_scripts(parts: Sequence[Part]) -> bool:
    return any(
        isinstance(one, TimeHistory | Track) or (isinstance(one, Details) and _runs_scripts(one.parts))
        for one in parts
    )


@cache
def _scripts() -> list[tuple[Markup, str]]:
    """Return the scripts of interactive plots, each with the digest by which the page allows it."""
    colors = "|".join(f"{light}>{dark}" for light, dark in COLORS.values())
    scripts = files("bokeh") / "server" / "static" / "js"  # bokeh.resources takes long to import
    bokeh = [(scripts / name).read_text("utf-8") for name in ("bokeh.min.js", "bokeh-api.min.js")]
    return [*map(_allowed, (*bokeh, _template("figures.js").replace("COLORS", colors)))]


def _template(name: str) -> str:
    return (Path(__file__).parent / "templates" / name).read_text("utf-8")


def _allowed(text: str) -> tuple[Markup, str]:
    """Return a script of Bokeh's or ours with the digest by which a page allows it."""
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return Markup(text), f"'sha256-{digest}'"  # noqa: S704


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("stoop.report")
    return Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )


def mathml(latex: str, display: str = "inline") -> Markup:
    """Return `latex` as a MathML element; what cannot be rendered is shown as it was written.

    It may come from a file: nothing but mathematics gets into the page. `display` is "inline" or "block".
    """
    from latex2mathml.converter import convert  # it loads large tables

    try:
        # A bare & or < from the converter makes this fail, which is what should happen.
        root = ET.fromstring(convert(latex, display=display))  # noqa: S314 (made by us: has no DTD)
    except Exception:
        return Markup("<code>{}</code>").format(latex)
    return Markup(_serialized(root))  # noqa: S704 (every part is escaped below)


def _serialized(element: ET.Element) -> str:
    def text(given: str | None) -> str:
        return str(escape(given or ""))

    name = element.tag.removeprefix(f"{{{MATHML}}}")
    inside = text(element.text) + "".join(_serialized(child) + text(child.tail) for child in element)
    if name not in ELEMENTS:
        return inside
    kept = "".join(f' {key}="{text(value)}"' for key, value in element.items() if key in ATTRIBUTES)
    return f"<{name}{kept}>{inside}</{name}>"
