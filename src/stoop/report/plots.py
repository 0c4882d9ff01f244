"""Plots: curves over straight or logarithmic axes, contours, strips over one axis.

Series differ by color and dash, so that twenty can be distinguished on paper too; their names stand in a list below
the drawing, where no two can overlap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from markupsafe import Markup

from stoop.base.arrays import FloatArray
from stoop.report.svg import TENTHS, Axes, Box, Range, drawing, element, path, plain_text, spanning, tick_text

WIDTH: Final = 640.0  #: px
HEIGHT: Final = 300.0  #: px of the box of a plot
STRIP: Final = 84.0  #: px of the box of one strip
BETWEEN: Final = 32.0  #: px between strips, so that the lowest tick of one is clear of the name of the next
LEFT, RIGHT, TOP, FLOOR = 58.0, 14.0, 24.0, 40.0
LEVELS: Final = 14  #: of a contour plot
HUES: Final = 8  #: classes hue0, hue1, ... of the style sheet
DASHES: Final = 3
Kind = Literal["line", "steps", "points"]


@dataclass(frozen=True, eq=False)
class Series:
    """A named curve.

    Attributes
    ----------
    name : str
        Stands in the legend; series of one name share their looks.
    x, y : (n,), NaN breaks the curve
    kind : "line", "steps" (each value holds until the next x) or "points"
    """

    name: str
    x: FloatArray
    y: FloatArray
    kind: Kind = "line"


@dataclass(frozen=True, eq=False)
class Strip:
    """One of several plots over a common x axis: label with unit, series, and whether zero is shown."""

    label: str
    series: tuple[Series, ...]
    zero: bool = False


@dataclass(frozen=True)
class Shade:
    """A stretch of the x axis that stands out, with a short name above it; `kind` is its class."""

    start: float
    stop: float
    name: str
    kind: Literal["fitted", "predicted", "declined"]


@dataclass(frozen=True)
class Mark:
    """A named point of a contour plot."""

    name: str
    x: float
    y: float


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
    series : sequence of Series
    x_label, y_label : str, with units
    description : str, for screen readers
    log_x, log_y : bool, logarithmic axes; what is not positive is left out
    x_range, y_range : (low, high), data units; by default what the series span
    looks : mapping of name to number, optional
        Gives series the same color and dash, in several drawings or in one; by default in order of appearance.
    x_ticks : sequence of float, optional
        Where the x axis is labeled, for quantities that have few values; by default round numbers.
    """
    looks = looks or _looks([one.name for one in series])
    box = Box(LEFT, TOP, WIDTH - LEFT - RIGHT, HEIGHT)
    axes = Axes.around(
        box,
        x_range or _range([one.x for one in series], log_x),
        y_range or _range([one.y for one in series], log_y),
        log_x,
        log_y,
    )
    marked = [(value, f"{value:g}") for value in x_ticks] or axes.x.labels(8, _label)
    parts = [*axes.levels(6, _label), *axes.columns(marked), *_titles(box, x_label, y_label)]
    parts.append(axes.inside([_drawn(one, looks[one.name], axes) for one in series]))
    whole = drawing(WIDTH, TOP + HEIGHT + FLOOR, description, parts)
    return _with_keys(whole, {one.name: (looks[one.name], one.kind) for one in series})


def stacked_plots(
    strips: Sequence[Strip], x_label: str, description: str, shades: Sequence[Shade] = ()
) -> Markup:
    """Return several plots, one below another, over one straight x axis, with one legend.

    Parameters
    ----------
    strips : sequence of Strip
    x_label : str, with unit
    description : str, for screen readers
    shades : sequence of Shade
        Drawn behind the curves of every strip, one that is declined behind the others; named above the first.
    """
    every = [one for strip in strips for one in strip.series]
    looks = _looks([one.name for one in every])
    x_range = _range([one.x for one in every], log=False)
    parts: list[Markup] = []
    for i, strip in enumerate(strips):
        last = i == len(strips) - 1
        box = Box(LEFT, TOP + i * (STRIP + BETWEEN), WIDTH - LEFT - RIGHT, STRIP)
        shown = [one.y for one in strip.series] + ([np.zeros(1)] if strip.zero else [])
        axes = Axes.around(box, x_range, _range(shown, log=False))
        parts.append(axes.inside(_shaded(shades, axes)))
        parts += _shade_names(shades, axes) if i == 0 else []
        # One level is no scale: ask for more ticks where there would be fewer than two.
        rows = next((n for n in range(3, 6) if len(axes.y.labels(n)) > 1), 3)
        parts += [*axes.levels(rows, _label), *axes.columns(axes.x.labels(10, _label), last)]
        parts += _titles(box, x_label if last else "", strip.label)
        parts.append(axes.inside([_drawn(one, looks[one.name], axes) for one in strip.series]))
    height = len(strips) * (STRIP + BETWEEN) - BETWEEN
    whole = drawing(WIDTH, TOP + height + FLOOR, description, parts)
    return _with_keys(whole, {one.name: (looks[one.name], one.kind) for one in every})


def contour_plot(
    x: FloatArray,
    y: FloatArray,
    values: FloatArray,
    path: FloatArray | None,
    marks: Sequence[Mark],
    x_label: str,
    y_label: str,
    description: str,
    levels: FloatArray | None = None,
) -> Markup:
    """Return lines of equal value, with a path over them.

    Parameters
    ----------
    x, y : (nx,), (ny,), rising
    values : (ny, nx)
    path : (k, 2), optional
        Joined in order, a dot at each.
    marks : sequence of Mark
    x_label, y_label : str, with units
    description : str, for screen readers
    levels : (l,), optional
        By default spread so that each lies between equally many grid points.
    """
    box = Box(LEFT, TOP, WIDTH - LEFT - RIGHT, HEIGHT * 1.3)
    axes = Axes.around(box, (float(x[0]), float(x[-1])), (float(y[0]), float(y[-1])))
    inside = [
        contour_path(axes.x(x), axes.y(y), values, level, "contour")
        for level in (contour_levels(values) if levels is None else levels)
    ]
    if path is not None:
        inside += _trail(axes.x(path[:, 0]), axes.y(path[:, 1]))
    looks = _looks(["path", *(mark.name for mark in marks)])
    inside += [_spot(axes.x.at(m.x), axes.y.at(m.y), looks[m.name], 5.0) for m in marks]
    parts = [
        *axes.levels(6, _label),
        *axes.columns(axes.x.labels(8, _label)),
        *_titles(box, x_label, y_label),
    ]
    whole = drawing(WIDTH, TOP + box.height + FLOOR, description, [*parts, axes.inside(inside)])
    return _with_keys(whole, {mark.name: (looks[mark.name], "points") for mark in marks}, fewest=1)


def contour_levels(values: FloatArray, count: int = LEVELS) -> FloatArray:
    """Return `count` levels (count,) with equally many grid values between each; none where all are equal."""
    finite = values[np.isfinite(values)]
    if not finite.size or finite.min() == finite.max():
        return np.empty(0)
    levels: FloatArray = np.unique(np.quantile(finite, (np.arange(count) + 0.5) / count))
    return levels


def contour_path(x: FloatArray, y: FloatArray, values: FloatArray, level: float, kind: str) -> Markup:
    """Return the lines on which `values` (ny, nx) over pixels `x` (nx,) and `y` (ny,) equal `level`."""
    from contourpy import contour_generator

    lines = contour_generator(x, y, np.ma.masked_invalid(values)).lines(float(level))
    strokes = ""
    for line in lines:
        points = np.rint(TENTHS * np.asarray(line)).astype(int).tolist()
        strokes += "M" + "L".join(f"{a} {b}" for a, b in points)
    return Markup(
        '<path class="{}" transform="scale(.1)" d="{}" vector-effect="non-scaling-stroke"/>'
    ).format(kind, strokes)


def _looks(names: Sequence[str]) -> dict[str, int]:
    """Return the number of each name's looks, in order of appearance."""
    return {name: i for i, name in enumerate(dict.fromkeys(names))}


def _classes(look: int) -> str:
    return f"hue{look % HUES} dash{look // HUES % DASHES}"


def _range(curves: Sequence[FloatArray], log: bool) -> Range:
    """Return the range that holds all curves, with a margin."""
    if not log:
        return spanning(curves, 0.04)
    low, high = spanning([np.log10(np.where(curve > 0.0, curve, np.nan)) for curve in curves], 0.03)
    return 10.0**low, 10.0**high


def _label(value: float, step: float) -> str:
    """Return a tick's label: plain digits but for very large and very small ones."""
    return tick_text(value, step) if abs(value) >= 1e6 or step < 1e-4 else plain_text(value, step)


def _titles(box: Box, x_label: str, y_label: str) -> list[Markup]:
    middle, floor = box.left + box.width / 2, box.top + box.height
    return [
        element("text", y_label, x=4.0, y=box.top - 9, class_="label"),
        element("text", x_label, x=middle, y=floor + 32, class_="label mid"),
    ]


def _shaded(shades: Sequence[Shade], axes: Axes) -> list[Markup]:
    """Return the stretches, those declined behind the others, then the edges of all, so that covered ones show."""
    height, x = axes.box.height, axes.x
    ordered = sorted(shades, key=lambda one: one.kind != "declined")
    areas = []
    for one in ordered:
        left, width = x.at(one.start), max(x.at(one.stop) - x.at(one.start), 1.5)
        areas.append(element("rect", x=left, y=0.0, width=width, height=height, class_=f"shade {one.kind}"))
    return areas + [
        element("line", x1=x.at(end), x2=x.at(end), y1=0.0, y2=height, class_=f"brink {one.kind}")
        for one in ordered
        for end in (one.start, one.stop)
    ]


def _shade_names(shades: Sequence[Shade], axes: Axes) -> list[Markup]:
    """Return the names above their stretches; those that would meet another are left out, first what is declined."""
    parts: list[Markup] = []
    taken: list[tuple[float, float]] = []
    for one in sorted(shades, key=lambda s: (s.kind == "declined", s.start)):
        place = axes.box.left + 0.5 * (axes.x.at(one.start) + axes.x.at(one.stop))
        half = 4.5 * len(one.name)
        if all(abs(place - other) >= half + wide for other, wide in taken):
            parts.append(element("text", one.name, x=place, y=axes.box.top + 13, class_="shade-name mid"))
            taken.append((place, half))
    return parts


def _drawn(one: Series, look: int, axes: Axes) -> Markup:
    across, up = axes.x(one.x), axes.y(one.y)
    if one.kind == "points":
        there = np.flatnonzero(np.isfinite(across) & np.isfinite(up))
        return Markup("").join(_spot(across[i], up[i], look, 3.0) for i in there)
    if one.kind == "steps" and len(across):
        across, up = np.repeat(across, 2)[1:], np.repeat(up, 2)[:-1]
    return path(across, up, f"curve series {_classes(look)}")


def _spot(x: float, y: float, look: int, size: float) -> Markup:
    """Return a disc, a ring or a square: the second and third round of colors differ in shape too."""
    turn = look // HUES % DASHES
    kind = f"spot {'hollow' if turn == 1 else 'full'} {_classes(look)}"
    if turn == 2:
        return element("rect", x=x - size, y=y - size, width=2 * size, height=2 * size, class_=kind)
    return element("circle", cx=x, cy=y, r=size, class_=kind)


def _trail(x: FloatArray, y: FloatArray) -> list[Markup]:
    """Return a path with a dot at each of its points."""
    dots = [element("circle", cx=a, cy=b, r=2.0, class_="spot full hue1") for a, b in zip(x, y, strict=True)]
    return [path(x, y, "curve trail"), *dots]


def _with_keys(whole: Markup, keys: dict[str, tuple[int, Kind]], fewest: int = 2) -> Markup:
    """Return the drawing with its legend; a single series needs none."""
    framed = Markup('<div class="plot">{}</div>').format(whole)
    if len(keys) < fewest:
        return framed
    items = Markup("").join(
        Markup("<li>{}{}</li>").format(_swatch(look, kind), name) for name, (look, kind) in keys.items()
    )
    return framed + Markup('<ul class="keys">{}</ul>').format(items)


def _swatch(look: int, kind: Kind) -> Markup:
    if kind == "points":
        drawn = _spot(15.0, 5.0, look, 3.5)
    else:
        drawn = element("line", x1=0.0, x2=30.0, y1=5.0, y2=5.0, class_=f"series {_classes(look)}")
    return Markup('<svg viewBox="0 0 30 10" aria-hidden="true">{}</svg>').format(drawn)
