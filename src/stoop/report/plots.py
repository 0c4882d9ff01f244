"""Plots as SVG text, drawn by Matplotlib: series over one pair of axes, stacked over a common x axis, densities.

Colors become variables of the style sheet. Series differ by color and dash, so that twenty can be distinguished on paper
too; their names stand in a list below the plot, where no two can overlap.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from markupsafe import Markup, escape

from stoop.base.arrays import FloatArray
from stoop.base.numbers import MAX_NUMBER, RAISED
from stoop.base.text import printable
from stoop.report.palette import as_variables
from stoop.report.palette import light as light
from stoop.report.series import DASHES, Kind, Look, Range, Series, Shade, Strip, looks_of, thinned
from stoop.report.series import spanning as spanning

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS: Final = 330  #: a denser curve is drawn as the least and the greatest value in so many columns
WIDTH: Final = 640.0  #: px of a plot
HEIGHT: Final = 300.0  #: px of its box
MARGIN: Final = 7.0  #: px around boxes without titles
BETWEEN: Final = 30.0  #: px between strips, so that the lowest tick of one is clear of the name of the next
LEFT, RIGHT, TOP, FLOOR = 58.0, 14.0, 24.0, 40.0  #: px around the boxes
NAMED: Final = 18.0  #: px from the lowest box to the name of the x axis, below its numbers
NARROW: Final = 420.0  #: px of a plot of which two or three lie side by side
MAP_QUANTILES: Final = (0.05, 0.995)  #: of what a heat map shows, which are darkest and brightest
MARKERS: Final = (("o", "full"), ("o", "none"), ("s", "full"))
STYLE: Final = {
    "svg.fonttype": "none", "svg.hashsalt": "stoop", "text.parse_math": False, "font.size": 11.0,
    "axes.spines.top": False, "axes.spines.right": False, "axes.spines.left": False, "axes.spines.bottom": False,
    "xtick.bottom": False, "ytick.left": False,
    "axes.grid": True, "axes.axisbelow": True, "axes.formatter.limits": (-4, 6), "axes.formatter.useoffset": False,
    "grid.linewidth": 1.0, "xtick.major.size": 0.0, "ytick.major.size": 0.0, "xtick.minor.size": 0.0,
    "ytick.minor.size": 0.0, "lines.linewidth": 1.5, "lines.solid_capstyle": "round", "hatch.linewidth": 1.0,
    "grid.color": light("grid"), "xtick.color": light("tick"), "ytick.color": light("tick"),
    "axes.labelcolor": light("tick"), "text.color": light("ink"), "xtick.labelsize": 10.5, "ytick.labelsize": 10.5,
}  # fmt: skip
#: what Matplotlib writes and a page need not hold
SURPLUS: Final = re.compile(
    r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->|(?<=<g) id=\"[^\"]*\"|font-family: [^;\"]*;? ?"
    r"| transform=\"rotate\(-0 [^\"]*\"|; stroke-linecap: round"
)
PLACES: Final = re.compile(r' (?:d|x|y)="[^"]*"')  #: attributes of which tenths of a pixel are enough
HUNDREDTHS: Final = re.compile(r"(?<=\.\d)\d+")


def plot(
    series: Sequence[Series],
    x_label: str,
    y_label: str,
    description: str,
    log_x: bool = False,
    log_y: bool = False,
    x_range: Range | None = None,
    y_range: Range | None = None,
    looks: Mapping[str, int] | None = None,
    x_ticks: Sequence[float] = (),
) -> Markup:
    """Return series over one pair of axes, the legend below.

    Parameters
    ----------
    log_x, log_y : bool, logarithmic axes; what is not positive is left out
    x_range, y_range : (low, high), data units; by default, or where those are no interval, what the series span
    looks : mapping of name to number, optional
        Gives series the same color and dash, in several drawings or in one; by default in order of appearance.
    x_ticks : sequence of float, optional
        Where the x axis is labeled, for quantities that have few values; by default round numbers.
    """
    chosen = looks_of(series, looks)
    with canvas(WIDTH, [HEIGHT]) as (figure, (axes,)):
        axes.set_xlim(_proper(x_range) or _range([s.x for s in series], log_x))
        axes.set_ylim(_proper(y_range) or _range([s.y for s in series], log_y))
        if log_x:
            _logarithmic(axes, "x")
        if log_y:
            _logarithmic(axes, "y")
        if x_ticks:
            axes.set_xticks(list(x_ticks), [f"{value:g}" for value in x_ticks])
        for one in series:
            _draw(axes, one, chosen[one.name])
        _label(axes, x_label, y_label)
        return _with_legend(svg(figure, description), series, chosen)


def stacked_plots(
    strips: Sequence[Strip], x_label: str, description: str, shades: Sequence[Shade] = ()
) -> Markup:
    """Return several plots, one below another, over one straight x axis, with one legend.

    `shades` are drawn behind the curves of every strip, one that is declined behind the others; named above the first.
    """
    every = [one for strip in strips for one in strip.series]
    looks = looks_of(every)
    x_range = _range([one.x for one in every], False)
    (picture,) = strip_pictures([(strips, description)], looks, x_range, x_label, shades)
    return _with_legend(picture, every, looks)


def strip_pictures(
    groups: Sequence[tuple[Sequence[Strip], str]],
    looks: Mapping[str, Look],
    x_range: Range,
    x_label: str,
    shades: Sequence[Shade] = (),
    *,
    width: float = WIDTH,
    columns: int = COLUMNS,
    log_x: bool = False,
) -> list[Markup]:
    """Return one picture without a legend for each group, strips with their description; `columns` limits points of a curve.

    Pictures of the same size are drawn on the same axes: to make these takes longer than to draw.
    """
    pictures: dict[int, Markup] = {}
    sizes = [tuple(strip.height for strip in strips) for strips, _ in groups]
    for size in dict.fromkeys(sizes):
        alike = [strips for (strips, _), own in zip(groups, sizes, strict=True) if own == size]
        titled = any(strip.label for strips in alike for strip in strips)
        with canvas(width, size, bool(x_label), titled) as (figure, all_axes):
            for axes in all_axes:
                axes.set_xlim(x_range)
                if log_x:
                    _logarithmic(axes, "x")
                axes.tick_params(labelbottom=axes is all_axes[-1])
                axes.locator_params("y", nbins=max(2, round(size[all_axes.index(axes)] / 22.0)))
                _shade(axes, shades, named=axes is all_axes[0])
            fixed = {id(artist) for axes in all_axes for artist in (*axes.lines, *axes.texts)}
            for number in (i for i, own in enumerate(sizes) if own == size):
                strips, description = groups[number]
                for axes, strip in zip(all_axes, strips, strict=True):
                    shown = [one.y for one in strip.series] + ([np.zeros(1)] if strip.zero else [])
                    axes.set_ylim(strip.y_range or _range(shown, log=False))
                    for one in strip.series:
                        _draw(axes, one, looks[one.name], columns)
                    _label(axes, x_label if axes is all_axes[-1] else "", strip.label)
                pictures[number] = svg(figure, description)
                for axes in all_axes:
                    for artist in (*axes.lines, *axes.texts, *axes.collections):
                        if id(artist) not in fixed:
                            artist.remove()
    return [pictures[i] for i in range(len(groups))]


def heat_maps(
    x: FloatArray, y: FloatArray, densities: Mapping[str, FloatArray], x_label: str, y_label: str
) -> list[Markup]:
    """Return a picture of each density, brighter by decades, all drawn on the same axes.

    Parameters
    ----------
    x, y : (nx,) and (ny,), evenly spaced
    densities : description of the picture -> (ny, nx), positive
    """
    ends, pictures = (float(x[0]), float(x[-1]), float(y[0]), float(y[-1])), list[Markup]()
    with np.errstate(divide="ignore", invalid="ignore"), canvas(NARROW, [130.0]) as (figure, (axes,)):
        axes.grid(visible=False)
        _label(axes, x_label, y_label)
        for description, density in densities.items():
            level = np.log10(density)
            known = level[np.isfinite(level)]
            low, high = np.quantile(known, MAP_QUANTILES) if known.size else (0.0, 1.0)
            laid: dict[str, Any] = {
                "aspect": "auto",
                "origin": "lower",
                "extent": ends,
                "interpolation": "nearest",
            }
            image = axes.imshow(level, "cividis", vmin=low, vmax=high, **laid)
            pictures.append(svg(figure, description))
            image.remove()
    return pictures


def fan_panel(
    x: FloatArray,
    estimate: FloatArray,
    bands: FloatArray,
    x_label: str,
    name: str,
    shaded: Sequence[Range] = (),
) -> Markup:
    """Return a curve (n,) over its 50 % and 95 % bands, and the median dashed.

    `bands` (5, n) are the percentiles 2.5, 25, 50, 75 and 97.5; `shaded` are stretches of the x axis that stand out.
    """
    with canvas(NARROW, [170.0], titles=False) as (figure, (axes,)):
        for start, stop in shaded:
            axes.axvspan(start, stop, color=light("fault"), linewidth=0.0, zorder=0.1)
        axes.fill_between(x, bands[0], bands[4], color=light("band-fit"), linewidth=0.0)
        axes.fill_between(x, bands[1], bands[3], color=light("band-half"), linewidth=0.0)
        axes.plot(x, bands[2], color=light("lag"), linestyle=DASHES[1], linewidth=1.4)
        axes.plot(x, estimate, color=light("fit"), linewidth=1.8)
        axes.set_xlim(float(x[0]), float(x[-1]))
        axes.set_ylim(*spanning([bands, estimate], 0.06))
        axes.locator_params("y", nbins=5)
        axes.set_xlabel(x_label, size=12.0)
        return svg(figure, f"{name} with its 50 % and 95 % bands.")


@contextmanager
def canvas(
    width: float, heights: Sequence[float], floor: bool = True, titles: bool = True
) -> Iterator[tuple[Figure, list[Axes]]]:
    """Give a figure of `width` px and one pair of axes for each height of a box, px, from top to bottom.

    With `floor` there is room for the name of the x axis, with `titles` for those of the boxes.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure as NewFigure

    top, between = (TOP, BETWEEN) if titles else (MARGIN, MARGIN)
    whole = top + sum(heights) + between * (len(heights) - 1) + (FLOOR if floor else 0.5 * FLOOR)
    with mpl.rc_context(STYLE), warnings.catch_warnings():  # type: ignore[arg-type]
        warnings.simplefilter("ignore")  # of letters that its font lacks: the browser has others
        figure = NewFigure(figsize=(width / 72.0, whole / 72.0), dpi=72.0)
        made, at = list[Any](), top
        for height in heights:
            size = (width - LEFT - RIGHT) / width, height / whole
            axes = figure.add_axes((LEFT / width, 1.0 - (at + height) / whole, *size))
            # where Matplotlib finds a place itself, it lays out all ticks once more
            axes.xaxis.set_label_coords(0.5, -NAMED / height)
            axes.yaxis.set_label_coords(0.0, 0.5)
            made.append(axes)
            at += height + between
        yield figure, made


def svg(figure: Figure, description: str) -> Markup:
    """Return a figure as an SVG element that the style sheet colors and the page's width scales."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    text = io.StringIO()
    figure.patch.set_visible(False)
    for axes in figure.axes:
        axes.patch.set_visible(False)
    FigureCanvasSVG(figure).print_svg(  # type: ignore[no-untyped-call]
        text, metadata={"Date": None, "Creator": None, "Format": None, "Type": None}
    )
    box, content = re.search(r'viewBox="([^"]*)"[^>]*>(.*)', text.getvalue(), re.DOTALL).groups()  # type: ignore[union-attr]
    content = SURPLUS.sub("", re.sub(r"\s*\n\s*", " ", content))
    content = PLACES.sub(lambda found: HUNDREDTHS.sub("", found.group()), content)
    label = escape(printable(description))
    head = f'<svg viewBox="{box}" xmlns:xlink="http://www.w3.org/1999/xlink" role="img" aria-label="{label}">'
    return Markup(head + as_variables(content).strip())  # noqa: S704 (Matplotlib escapes the texts in it)


def _draw(axes: Axes, one: Series, look: Look, columns: int = COLUMNS) -> None:
    x, y, half = thinned(one, columns)
    x, y = (np.where(np.abs(v) <= MAX_NUMBER, v, np.nan) for v in (x, y))
    if one.kind == "points":
        marker, fill = MARKERS[look.turn]
        face = look.color if fill == "full" else light("paper")
        axes.plot(x, y, linestyle="", marker=marker, markersize=6.0, color=look.color, markerfacecolor=face)
        return
    if half is not None:
        role = f"band-{one.role}" if one.role else "band-fit"
        axes.fill_between(x, y - half, y + half, color=light(role), linewidth=0.0)
    drawn = "steps-post" if one.kind == "steps" else "default"
    axes.plot(x, y, color=look.color, linestyle=DASHES[look.turn], linewidth=one.width, drawstyle=drawn)


def _shade(axes: Axes, shades: Sequence[Shade], named: bool) -> None:
    """Draw the stretches, those declined behind the others, and the edges of all, so that covered ones show."""
    for one in sorted(shades, key=lambda s: s.kind != "declined"):
        axes.axvspan(one.start, one.stop, color=light(one.kind), linewidth=0.0, zorder=0.1)
    for one in shades if len(shades) else ():
        if one.kind != "hole":
            dash = (0, (3, 3)) if one.kind == "declined" else "solid"
            for end in (one.start, one.stop):
                axes.axvline(end, color=light(f"{one.kind}-edge"), linewidth=1.0, linestyle=dash, zorder=0.2)
    for one in names_without_overlap(shades, axes) if named else ():
        middle = 0.5 * (one.start + one.stop)
        axes.annotate(
            printable(one.name), (middle, 1.0), (0, -12), xycoords=("data", "axes fraction"),
                      textcoords="offset points", ha="center", weight="bold", clip_on=True)  # fmt: skip


def names_without_overlap(shades: Sequence[Shade], axes: Axes) -> list[Shade]:
    """Return the stretches whose names meet no other; names of what is declined go first."""
    (low, high), width = axes.get_xlim(), axes.bbox.width
    kept, taken = list[Shade](), list[tuple[float, float]]()
    for one in sorted(shades, key=lambda s: (s.kind == "declined", s.start)):
        place, half = (0.5 * (one.start + one.stop) - low) / (high - low) * width, 4.5 * len(one.name)
        if one.name and all(abs(place - other) >= half + wide for other, wide in taken):
            kept.append(one)
            taken.append((place, half))
    return kept


def _label(axes: Axes, x_label: str, y_label: str) -> None:
    at, place = (4.0 - LEFT, 9.0), "axes fraction"
    axes.annotate(printable(y_label), (0.0, 1.0), at, place, "offset points", color=light("tick"), size=12.0)
    axes.set_xlabel(printable(x_label), size=12.0)


def _logarithmic(axes: Axes, which: Literal["x", "y"]) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axes.get_xlim() if which == "x" else axes.get_ylim()
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    few = np.log10(high / low) < 2.0
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=8))
    axis.set_major_formatter(FuncFormatter(lambda value, _: decade_text(value)))
    axis.set_minor_locator(NullLocator())


def decade_text(value: float) -> str:
    """Return the label of a tick of a logarithmic axis."""
    if 0.009 < value < 99_999.0:
        return f"{value:.10g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return ("" if mantissa == "1" else mantissa + "·") + "10" + str(int(exponent)).translate(RAISED)


def _proper(wished: Range | None) -> Range | None:
    """Return a range where it is an interval between numbers that can be drawn."""
    return wished if wished and -MAX_NUMBER <= wished[0] < wished[1] <= MAX_NUMBER else None


def _range(curves: Sequence[FloatArray], log: bool) -> Range:
    """Return the range that holds all curves, with a margin."""
    if not log:
        return spanning(curves, 0.04)
    drawn = [np.where((curve > 0.0) & (curve <= MAX_NUMBER), curve, np.nan) for curve in curves]
    low, high = spanning([np.log10(curve) for curve in drawn], 0.03)
    return 10.0**low, 10.0**high


def _with_legend(picture: Markup, series: Sequence[Series], looks: Mapping[str, Look]) -> Markup:
    """Return the picture with its legend; a single series needs none."""
    framed = Markup('<div class="plot">{}</div>').format(picture)
    items = Markup("")
    kinds = {one.name: one.kind for one in series}
    for name, kind in kinds.items() if len(kinds) > 1 else ():
        items += Markup("<li>{}{}</li>").format(swatch(kind, looks[name]), printable(name))
    return framed + Markup('<ul class="keys">{}</ul>').format(items) if items else framed


def swatch(kind: Kind, look: Look) -> Markup:
    """Return the key of a series in a legend."""
    color = as_variables(look.color)
    if kind == "points":
        marker, fill = MARKERS[look.turn]
        inside = color if fill == "full" else "var(--paper)"
        circle, square = "<circle cx='15' cy='5' r='3.5'", "<rect x='11.5' y='1.5' width='7' height='7'"
        key = f"{circle if marker == 'o' else square} style='fill: {inside}; stroke: {color}'/>"
    else:
        dash = DASHES[look.turn]
        dashes = "" if isinstance(dash, str) else f"; stroke-dasharray: {' '.join(map(str, dash[1]))}"
        key = f"<line x1='0' x2='30' y1='5' y2='5' style='stroke: {color}; stroke-width: 2{dashes}'/>"
    return Markup('<svg viewBox="0 0 30 10" aria-hidden="true">{}</svg>').format(Markup(key))  # noqa: S704 (ours)
