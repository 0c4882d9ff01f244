"""Drawings of studies: curves over straight or logarithmic axes, contours, strips over one axis.

Series differ by color and dash, so that twenty are told apart on paper too; names stand in a list below the
drawing, where no two can overlap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from markupsafe import Markup

from stoop.base.arrays import FloatArray
from stoop.base.numbers import RAISED
from stoop.report.axes import Box
from stoop.report.contours import contour_levels, contour_path
from stoop.report.svg import (
    LogScale,
    Scale,
    decade_ticks,
    drawing,
    element,
    path,
    plain_text,
    spanning,
    tick_text,
    ticks,
)

WIDTH: Final = 640.0  #: px
HEIGHT: Final = 300.0  #: px of the box of a plot
STRIP: Final = 84.0  #: px of the box of one strip
BETWEEN: Final = 32.0  #: px between strips, so that the lowest tick of one is clear of the name of the next
LEFT, RIGHT, TOP, FLOOR = 58.0, 14.0, 24.0, 40.0
HUES: Final = 8  #: classes hue0, hue1, ... of the style sheet
DASHES: Final = 3
Kind = Literal["line", "steps", "points"]
Span = tuple[float, float]
AnyScale = Scale | LogScale


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
    """One of several plots over a common x axis: what it shows, with the unit, its series, and whether zero is in sight."""

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
    x_range: Span | None = None,
    y_range: Span | None = None,
    looks: Mapping[str, int] | None = None,
    x_ticks: Sequence[float] = (),
) -> Markup:
    """Return series over one pair of axes, the legend below.

    Parameters
    ----------
    series : sequence of Series
    x_label, y_label : str, with units
    description : str, the drawing in words, for who cannot see it
    log_x, log_y : bool, logarithmic axes; what is not positive is left out
    x_range, y_range : (low, high), data units; by default what the series span
    looks : mapping of name to number, optional
        Gives series the same color and dash, in several drawings or in one; by default in order of appearance.
    x_ticks : sequence of float, optional
        Where the x axis is labeled, for quantities that have few values; by default round numbers.
    """
    looks = looks or _looks([one.name for one in series])
    x = _axis([one.x for one in series], log_x, x_range, 0.0, WIDTH - LEFT - RIGHT)
    y = _axis([one.y for one in series], log_y, y_range, HEIGHT, 0.0)
    box = Box(LEFT, TOP, WIDTH - LEFT - RIGHT, HEIGHT)
    marked = [(x.at(value), f"{value:g}") for value in x_ticks] or _ticks(x, 8)
    parts = [*_levels(box, y, 6), *_columns(box, marked), *_labels(box, x_label, y_label)]
    parts += [_inside(box, [_drawn(one, looks[one.name], x, y) for one in series])]
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
    description : str, the drawing in words
    shades : sequence of Shade
        Drawn behind the curves of every strip, one that is declined behind the others; named above the first.
    """
    every = [one for strip in strips for one in strip.series]
    looks = _looks([one.name for one in every])
    x = _axis([one.x for one in every], False, None, 0.0, WIDTH - LEFT - RIGHT)
    parts: list[Markup] = []
    top = TOP
    for strip in strips:
        box = Box(LEFT, top, WIDTH - LEFT - RIGHT, STRIP)
        seen = [one.y for one in strip.series] + ([np.zeros(1)] if strip.zero else [])
        y = _axis(seen, False, None, STRIP, 0.0)
        parts.append(_inside(box, _shaded(shades, x, STRIP)))
        parts += _shade_names(shades, x, box) if strip is strips[0] else []
        parts += [*_levels(box, y, _enough(y, 3)), *_columns(box, _ticks(x, 10), strip is strips[-1])]
        parts += _labels(box, x_label if strip is strips[-1] else "", strip.label)
        parts.append(_inside(box, [_drawn(one, looks[one.name], x, y) for one in strip.series]))
        top += STRIP + BETWEEN
    whole = drawing(WIDTH, top - BETWEEN + FLOOR, description, parts)
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
    description : str, the drawing in words
    levels : (l,), optional
        By default spread so that each lies between equally many grid points.
    """
    box = Box(LEFT, TOP, WIDTH - LEFT - RIGHT, HEIGHT * 1.3)
    across = Scale(float(x[0]), float(x[-1]), 0.0, box.width)
    up = Scale(float(y[0]), float(y[-1]), box.height, 0.0)
    lines = [
        contour_path(across(x), up(y), values, level, "contour")
        for level in (contour_levels(values) if levels is None else levels)
    ]
    inside = [*lines, *([] if path is None else _trail(across(path[:, 0]), up(path[:, 1])))]
    looks = _looks(["path", *(mark.name for mark in marks)])
    inside += [_spot(across.at(m.x), up.at(m.y), looks[m.name], 5.0) for m in marks]
    parts = [*_levels(box, up, 6), *_columns(box, _ticks(across, 8)), *_labels(box, x_label, y_label)]
    whole = drawing(WIDTH, TOP + box.height + FLOOR, description, [*parts, _inside(box, inside)])
    return _with_keys(whole, {mark.name: (looks[mark.name], "points") for mark in marks}, fewest=1)


def _looks(names: Sequence[str]) -> dict[str, int]:
    """Return the number of each name's looks, in order of appearance."""
    return {name: i for i, name in enumerate(dict.fromkeys(names))}


def _classes(look: int) -> str:
    return f"hue{look % HUES} dash{look // HUES % DASHES}"


def _axis(curves: Sequence[FloatArray], log: bool, given: Span | None, start: float, stop: float) -> AnyScale:
    """Return a scale from pixel `start` to `stop` that holds all curves, or the range that was given."""
    if not log:
        low, high = given or spanning(curves, 0.04)
        return Scale(low, high, start, stop)
    if given is None:
        logs = [np.log10(np.where(curve > 0.0, curve, np.nan)) for curve in curves]
        low, high = (10.0**edge for edge in spanning(logs, 0.03))
    else:
        low, high = given
    return LogScale(low, high, start, stop)


def _ticks(scale: AnyScale, most: int) -> list[tuple[float, str]]:
    """Return pixels and texts."""
    if isinstance(scale, LogScale):
        return [(scale.at(value), _decade_text(value)) for value in decade_ticks(scale.low, scale.high, most)]
    values = ticks(scale.low, scale.high, most)
    step = values[1] - values[0] if len(values) > 1 else abs(scale.high - scale.low)
    text = tick_text if max(map(abs, values), default=0.0) >= 1e6 or step < 1e-4 else plain_text
    return [(scale.at(value), text(value, step)) for value in values]


def _decade_text(value: float) -> str:
    if 0.009 < value < 99_999.0:
        return f"{value:.10g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return ("" if mantissa == "1" else mantissa + "·") + "10" + str(int(exponent)).translate(RAISED)


def _enough(scale: AnyScale, most: int) -> int:
    """Return so many ticks, or a few more where those would be less than two: one level is no scale."""
    return next((n for n in range(most, 2 * most) if len(_ticks(scale, n)) > 1), most)


def _levels(box: Box, scale: AnyScale, most: int) -> list[Markup]:
    parts: list[Markup] = []
    for place, text in _ticks(scale, most):
        y = box.top + place
        parts.append(element("line", x1=box.left, x2=box.left + box.width, y1=y, y2=y, class_="grid"))
        parts.append(element("text", text, x=box.left - 6, y=y + 3.5, class_="tick end"))
    return parts


def _columns(box: Box, marked: Sequence[tuple[float, str]], labels: bool = True) -> list[Markup]:
    parts: list[Markup] = []
    floor = box.top + box.height
    for place, text in marked:
        x = box.left + place
        parts.append(element("line", x1=x, x2=x, y1=box.top, y2=floor, class_="grid"))
        if labels:
            parts.append(element("text", text, x=x, y=floor + 14, class_="tick mid"))
    return parts


def _labels(box: Box, x_label: str, y_label: str) -> list[Markup]:
    middle, floor = box.left + box.width / 2, box.top + box.height
    return [
        element("text", y_label, x=4.0, y=box.top - 9, class_="label"),
        element("text", x_label, x=middle, y=floor + 32, class_="label mid"),
    ]


def _inside(box: Box, parts: Sequence[Markup]) -> Markup:
    """Return parts moved into the box, and cut at its edges."""
    content = Markup("").join(parts) or " "
    return element("svg", content, x=box.left, y=box.top, width=box.width, height=box.height, class_="clip")


def _shaded(shades: Sequence[Shade], x: AnyScale, height: float) -> list[Markup]:
    """Return stretches whose colors never mix, and the edges of all of them, so that neighbors and covered ones show."""
    behind_first = sorted(shades, key=lambda one: one.kind != "declined")
    return [_shade(one, x, height) for one in behind_first] + [
        element("line", x1=x.at(end), x2=x.at(end), y1=0.0, y2=height, class_=f"brink {one.kind}")
        for one in behind_first
        for end in (one.start, one.stop)
    ]


def _shade(one: Shade, x: AnyScale, height: float) -> Markup:
    left, right = x.at(one.start), x.at(one.stop)
    return element(
        "rect", x=left, y=0.0, width=max(right - left, 1.5), height=height, class_=f"shade {one.kind}"
    )


def _shade_names(shades: Sequence[Shade], x: AnyScale, box: Box) -> list[Markup]:
    """Return the names above their stretches; those that would meet another are left out, first what is declined."""
    parts: list[Markup] = []
    taken: list[tuple[float, float]] = []
    for one in sorted(shades, key=lambda s: (s.kind == "declined", s.start)):
        place, half = box.left + 0.5 * (x.at(one.start) + x.at(one.stop)), 4.5 * len(one.name)
        if all(abs(place - other) >= half + wide for other, wide in taken):
            parts.append(element("text", one.name, x=place, y=box.top + 13, class_="shade-name mid"))
            taken.append((place, half))
    return parts


def _drawn(one: Series, look: int, x: AnyScale, y: AnyScale) -> Markup:
    across, up = x(one.x), y(one.y)
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
