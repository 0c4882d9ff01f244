"""Which pictures there are, and which of them have to be drawn again.

A picture is drawn once, in the colors of a light page; the same file in the colors of a dark page is the one with each
color replaced (:data:`PALETTES`), so that both have the same lines.
"""

from __future__ import annotations

import importlib
import io
import itertools
import pkgutil
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

import stoop
from pictures.sketch import PALETTES, STYLE
from stoop.base.files import write_files

FOLDER: Final = Path(__file__).parent
HELPERS: Final = ("registry", "sketch", "directives")
MAX_OVERLAP: Final = 1.0  #: px2 that the boxes of two texts may share
THEMES: Final = ("light", "dark")
_COLOR: Final = re.compile(r"#[0-9a-f]{6}")


@dataclass(frozen=True)
class Picture:
    """A picture: what it is called, what a reader who does not see it is told, and how it is drawn."""

    name: str
    alternative: str
    draw: Callable[[], Figure]
    module: str

    def files(self) -> tuple[str, ...]:
        """Return the names of its files, one for each theme."""
        return tuple(f"{self.name}-{theme}.svg" for theme in THEMES)


_PICTURES: dict[str, Picture] = {}


def picture(name: str, alternative: str = "") -> Callable[[Callable[[], Figure]], Callable[[], Figure]]:
    """Register the decorated function as what draws a picture; its docstring is for readers who do not see the picture."""

    def register(draw: Callable[[], Figure]) -> Callable[[], Figure]:
        text = " ".join((alternative or draw.__doc__ or "").split())
        if name in _PICTURES or not text:
            raise ValueError(
                f"picture '{name}': there is another of that name, or its function has no docstring"
            )
        _PICTURES[name] = Picture(name, text, draw, getattr(draw, "func", draw).__module__)
        return draw

    return register


@cache
def pictures() -> dict[str, Picture]:
    """Return all pictures by name, in the order of their modules."""
    for module in sorted(m.name for m in pkgutil.iter_modules([str(FOLDER)])):
        if module not in HELPERS:
            importlib.import_module(f"pictures.{module}")
    return dict(_PICTURES)


def outdated(folder: Path) -> list[Picture]:
    """Return the pictures whose files in a folder are missing, or older than what they are made of."""
    return [p for p in pictures().values() if not _age(folder / n for n in p.files()) > _changed(p.module)]


def draw(one: Picture, folder: Path) -> list[str]:
    """Draw a picture into a folder, one file for each theme; return the texts in it that overlap."""
    with rc_context(STYLE):
        figure = one.draw()
        FigureCanvasAgg(figure).draw()
        found = overlaps(figure)
        buffer = io.StringIO()
        with rc_context({"svg.hashsalt": one.name}):  # else identifiers differ from build to build
            figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    colors = dict(zip(PALETTES["light"].values(), PALETTES["dark"].values(), strict=True))
    strange = set(_COLOR.findall(text)) - set(colors)
    if strange:
        found.append(f"colors outside of the palette: {', '.join(sorted(strange))}")
    dark = _COLOR.sub(lambda m: colors.get(m[0], m[0]), text)
    write_files(folder, dict(zip(one.files(), (text, dark), strict=True)))
    return found


def overlaps(figure: Figure) -> list[str]:
    """Return which texts of a drawn figure lie on each other, or beyond its edge."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    texts = [*figure.texts, *itertools.chain.from_iterable(_texts(axes) for axes in figure.axes)]
    if figure._suptitle is not None:
        texts.append(figure._suptitle)
    boxes = [
        (t.get_text().replace("\n", " "), t.get_window_extent(renderer))
        for t in texts
        if t.get_text().strip()
    ]
    width, height = figure.bbox.width, figure.bbox.height
    found = [
        f"'{text}' is cut off"
        for text, b in boxes
        if b.x0 < -1.0 or b.y0 < -1.0 or b.x1 > width + 1.0 or b.y1 > height + 1.0
    ]
    for (one, a), (other, b) in itertools.combinations(boxes, 2):
        wide, high = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        if wide > 0.0 and high > 0.0 and wide * high > MAX_OVERLAP:
            found.append(f"'{one}' and '{other}' overlap")
    return found


def _texts(axes: Axes) -> Iterator[Text]:
    """Give the texts of a pair of axes that are drawn: of labels of ticks, those within its limits."""
    yield from axes.texts
    if axes.get_legend() is not None:
        yield from axes.get_legend().get_texts()
    if not axes.axison:
        return
    yield from (axes.title, axes._left_title, axes._right_title)
    for axis, across in ((axes.xaxis, 0), (axes.yaxis, 1)):
        if axis.get_visible():
            low, high = sorted(axes.get_xlim() if across == 0 else axes.get_ylim())
            slack = 1e-9 * (high - low)
            yield from (axis.label, axis.offsetText)
            for tick in axis.get_majorticklabels():
                if tick.get_visible() and low - slack <= tick.get_position()[across] <= high + slack:
                    yield tick


def _changed(module: str) -> float:
    """Return when the newest of the files that pictures of a module are made of was written."""
    own = FOLDER / f"{module.rpartition('.')[2]}.py"
    made_of: Iterator[Path] = iter([own, *(FOLDER / f"{h}.py" for h in HELPERS[:2])])
    if re.search(r"^\s*(from|import) stoop", own.read_text(encoding="utf-8"), re.MULTILINE):
        made_of = itertools.chain(made_of, _package())
    return max(p.stat().st_mtime for p in made_of)


@cache
def _package() -> tuple[Path, ...]:
    """Return the files of the package that may change what it computes."""
    root = Path(stoop.__file__).parent
    return tuple(p for p in root.rglob("*") if p.suffix in (".py", ".toml"))


def _age(files: Iterable[Path]) -> float:
    """Return when the oldest of some files was written, minus infinity where one is missing."""
    return min(p.stat().st_mtime if p.exists() else float("-inf") for p in files)
