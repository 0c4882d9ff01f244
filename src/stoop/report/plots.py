"""Drawings as SVG text: scales, ticks, axes, curves; and plots of them: over one pair of axes, stacked, as contours.

Colors are classes of the style sheet. Series differ by color and dash, so that twenty can be distinguished on paper too;
their names stand in a list below the drawing, where no two can overlap.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from stoop.base.arrays import FloatArray, runs
from stoop.base.numbers import MAX_NUMBER, RAISED

COLUMNS: Final = 330  #: a denser curve is drawn as the least and the greatest value in so many columns
TENTHS: Final = 10.0  #: paths are whole tenths of a pixel: short text, and finer than the eye
MIN_VARIATION: Final = 1e-6  #: of a curve's size; what varies less is drawn flat
WIDTH: Final = 640.0  #: px of a plot
HEIGHT: Final = 300.0  #: px of the box of a plot
STRIP: Final = 84.0  #: px of the box of one strip
BETWEEN: Final = 32.0  #: px between strips, so that the lowest tick of one is clear of the name of the next
LEFT, RIGHT, TOP, FLOOR = 58.0, 14.0, 24.0, 40.0
LEVELS: Final = 14  #: of a contour plot
HUES: Final = 8  #: classes hue0, hue1, ... of the style sheet
DASHES: Final = 3
Kind = Literal["line", "steps", "points"]
ShadeKind = Literal["fitted", "predicted", "declined"]
TickText = Callable[[float, float], str]  #: label of a level, given the step between levels
Range = tuple[float, float]


@dataclass(frozen=True)
class Scale:
    """Map from data `low`..`high` to pixels `start`..`stop`, straight or logarithmic (NaN for what is not positive)."""

    low: float
    high: float
    start: float
    stop: float
    log: bool = False

    def __call__(self, values: npt.ArrayLike) -> FloatArray:
        """Return pixels (n,) of data (n,)."""
        given, low, high = np.asarray(values, dtype=np.float64), self.low, self.high
        if self.log:
            given = np.log10(np.where(given > 0.0, given, np.nan))
            low, high = math.log10(low), math.log10(high)
        with np.errstate(over="ignore"):  # what lies far outside is clipped
            return np.asarray(self.start + (given - low) / (high - low) * (self.stop - self.start))

    def at(self, value: float) -> float:
        """Return the pixel of one value."""
        return float(self(value))

    def labels(self, most: int, text: TickText | None = None) -> list[tuple[float, str]]:
        """Return values and labels of about `most` ticks."""
        if self.log:
            return [(value, decade_text(value)) for value in decade_ticks(self.low, self.high, most)]
        values = ticks(self.low, self.high, most)
        step = values[1] - values[0] if len(values) > 1 else abs(values[0]) if values and values[0] else 1.0
        return [(value, (text or tick_text)(value, step)) for value in values]


@dataclass(frozen=True)
class Box:
    """A rectangle of the drawing in px."""

    left: float
    top: float
    width: float
    height: float


@dataclass(frozen=True)
class Axes:
    """A box with its two scales."""

    box: Box
    x: Scale
    y: Scale

    @classmethod
    def around(cls, box: Box, x: Range, y: Range, log_x: bool = False, log_y: bool = False) -> Axes:
        """Return axes over the intervals `x` and `y`."""
        return cls(box, Scale(*x, 0.0, box.width, log_x), Scale(*y, box.height, 0.0, log_y))

    def curve(self, x: FloatArray, y: FloatArray, kind: str) -> Markup:
        """Return a curve clipped to the box; `kind` is its class."""
        return self.inside([path(self.x(x), self.y(y), kind)])

    def area(self, x: FloatArray, low: FloatArray, high: FloatArray, kind: str) -> Markup:
        """Return the area between two curves, clipped to the box; `kind` is its class."""
        shapes = []
        for first, last in runs(np.isfinite(x) & np.isfinite(low) & np.isfinite(high)).tolist():
            at = np.unique(np.linspace(first, last - 1, min(last - first, COLUMNS)).round().astype(int))
            edge = np.concatenate([self.y(low[at]), self.y(high[at])[::-1]])
            across = np.concatenate([self.x(x[at]), self.x(x[at])[::-1]])
            shapes.append(path(across, np.clip(edge, -self.box.height, 2.0 * self.box.height), kind))
        return self.inside(shapes)

    def inside(self, parts: Sequence[Markup]) -> Markup:
        """Return parts moved into the box, and cut at its edges."""
        box, content = self.box, Markup("").join(parts) or " "
        place = {"x": box.left, "y": box.top, "width": box.width, "height": box.height}
        return element("svg", content, **place, class_="clip")

    def frame(
        self, rows: int = 4, columns: int = 5, bottom_labels: bool = True, text: TickText | None = None
    ) -> list[Markup]:
        """Return grid lines and tick labels of both axes; `text` labels the levels of the y axis."""
        return [*self.levels(rows, text), *self.columns(self.x.labels(columns, plain_text), bottom_labels)]

    def levels(self, rows: int, text: TickText | None = None) -> list[Markup]:
        """Return the grid lines and labels of the y axis."""
        parts: list[Markup] = []
        for level, label in self.y.labels(rows, text):
            y = self.box.top + self.y.at(level)
            kind = "grid zero" if level == 0.0 else "grid"
            right = self.box.left + self.box.width
            parts.append(element("line", x1=self.box.left, x2=right, y1=y, y2=y, class_=kind))
            parts.append(element("text", label, x=self.box.left - 5, y=y + 3.5, class_="tick end"))
        return parts

    def columns(self, marked: Sequence[tuple[float, str]], labels: bool = True) -> list[Markup]:
        """Return the grid lines of the x axis at values, with their labels below the box."""
        parts: list[Markup] = []
        floor = self.box.top + self.box.height
        for value, label in marked:
            x = self.box.left + self.x.at(value)
            parts.append(element("line", x1=x, x2=x, y1=self.box.top, y2=floor, class_="grid"))
            if labels:
                parts.append(element("text", label, x=x, y=floor + 13, class_="tick mid"))
        return parts

    def hole(self, start: float, stop: float) -> Markup:
        """Return a shaded stretch of the x axis in which nothing was recorded."""
        left = self.box.left + self.x.at(start)
        width = max(self.x.at(stop) - self.x.at(start), 0.5)
        return element("rect", x=left, y=self.box.top, width=width, height=self.box.height, class_="hole")


def spanning(curves: Sequence[npt.ArrayLike], margin: float = 0.06) -> Range:
    """Return the least and greatest finite value with a margin; what varies by rounding alone counts as constant."""
    values = np.concatenate([np.ravel(np.asarray(c, dtype=np.float64)) for c in curves] or [np.zeros(1)])
    values = values[np.abs(values) <= MAX_NUMBER]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    size = max(abs(low), abs(high))
    room = margin * (high - low) if high - low > MIN_VARIATION * size else max(margin * size, 1e-6)
    return low - room, high + room


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return at most `most` + 1 round numbers between `low` and `high`."""
    rough = (high - low) / max(most, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = power * next((n for n in (1.0, 2.0, 5.0) if n * power >= rough * (1 - 1e-9)), 10.0)
    first = math.ceil(low / step - 1e-9)
    return [step * n for n in range(first, math.floor(high / step + 1e-9) + 1)]


def decade_ticks(low: float, high: float, most: int) -> list[float]:
    """Return about `most` ticks of a logarithmic axis: whole decades, with 2 and 5 between few of them."""
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    step = max(1, math.ceil((last - first) / max(most, 1)))
    factors = (1.0, 2.0, 5.0) if last - first < 2 else (1.0, 3.0) if 2 * (last - first) <= most else (1.0,)
    exponents = range(first - 1, last + 1) if step == 1 else range(first, last + 1, step)
    found = [factor * 10.0**exponent for exponent in exponents for factor in factors]
    inside = [value for value in found if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
    return inside if len(inside) > 1 else ticks(low, high, most)


def plain_text(value: float, step: float) -> str:
    """Return a tick's label as plain digits, with the decimals that the step needs."""
    decimals = max(0, -_decade(step)) if step > 0 else 0
    return f"{value + 0.0:.{decimals}f}".replace("-", "−") if abs(value) > step * 1e-6 else "0"


def tick_text(value: float, step: float) -> str:
    """Return a tick's label with the digits that the step needs; a power of ten where that is clearly shorter."""
    plain = plain_text(value, step)
    if not value or not step > 0 or 1e-4 < abs(value) < 1e5:
        return plain
    digits = max(0, _decade(abs(value)) - _decade(step))
    raised = f"{value:.{digits}e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
    return raised.replace("-", "−") if plain == "0" or len(raised) + 1 < len(plain) else plain


def decade_text(value: float) -> str:
    """Return the label of a tick of a logarithmic axis."""
    if 0.009 < value < 99_999.0:
        return f"{value:.10g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return ("" if mantissa == "1" else mantissa + "·") + "10" + str(int(exponent)).translate(RAISED)


def _decade(value: float) -> int:
    return math.floor(math.log10(value) + 1e-9)


def path(x: FloatArray, y: FloatArray, kind: str) -> Markup:
    """Return a curve through pixels (n,), broken where either is NaN; `kind` is its class."""
    strokes = ""
    for first, last in runs(np.isfinite(x) & np.isfinite(y)):
        u, v = x[first:last], y[first:last]
        if len(u) > 2 * COLUMNS:  # the extremes of each column, so that no peak is lost
            starts = np.linspace(0, len(u), COLUMNS, endpoint=False).astype(int)
            low, high = np.minimum.reduceat(v, starts), np.maximum.reduceat(v, starts)
            rising = v[starts] <= v[np.append(starts[1:], len(v)) - 1]
            pairs = np.where(rising[:, None], np.column_stack([low, high]), np.column_stack([high, low]))
            u, v = np.repeat(u[starts], 2), pairs.ravel()
        points = np.rint(TENTHS * np.column_stack([u, np.clip(v, -1e4, 1e4)])).astype(int)
        if len(points) == 1:
            points = np.array([points[0], [points[0, 0] + 1, points[0, 1]]])
        changed = np.concatenate([[True], np.any(np.diff(points, axis=0) != 0, axis=1)])
        strokes += "M" + " ".join(f"{a} {b}" for a, b in points[changed].tolist())
    return Markup('<path class="{}" transform="scale(.1)" d="{}"/>').format(kind, strokes)


def element(name: str, content: str = "", **attributes: str | float) -> Markup:
    """Return one element; numbers are rounded, text is escaped, ``class_`` is class, ``_`` is ``-``."""
    written = Markup("").join(
        Markup(' {}="{}"').format(key.rstrip("_").replace("_", "-"), _short(value))
        for key, value in attributes.items()
    )
    if not content and name != "text":
        return Markup("<{}{}/>").format(Markup(name), written)  # noqa: S704 (names are ours)
    return Markup("<{0}{1}>{2}</{0}>").format(Markup(name), written, content)  # noqa: S704 (names are ours)


def drawing(width: float, height: float, description: str, parts: Sequence[Markup]) -> Markup:
    """Return the whole drawing, with its description."""
    return Markup('<svg viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>').format(
        _short(width), _short(height), description, Markup("").join(parts)
    )


def _short(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.2f}".rstrip("0").rstrip(".")


@dataclass(frozen=True, eq=False)
class Series:
    """A named curve."""

    name: str  #: stands in the legend; series of one name share their looks
    x: FloatArray  #: (n,), NaN breaks the curve
    y: FloatArray
    kind: Kind = "line"  #: "line", "steps" (each value holds until the next x) or "points"


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
    kind: ShadeKind


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
    log_x, log_y : bool, logarithmic axes; what is not positive is left out
    x_range, y_range : (low, high), data units; by default, or where those are no interval, what the series span
    looks : mapping of name to number, optional
        Gives series the same color and dash, in several drawings or in one; by default in order of appearance.
    x_ticks : sequence of float, optional
        Where the x axis is labeled, for quantities that have few values; by default round numbers.
    """
    looks = looks or _looks([one.name for one in series])
    box = Box(LEFT, TOP, WIDTH - LEFT - RIGHT, HEIGHT)
    x_range = _proper(x_range) or _range([s.x for s in series], log_x)
    y_range = _proper(y_range) or _range([s.y for s in series], log_y)
    axes = Axes.around(box, x_range, y_range, log_x, log_y)
    marked = [(value, f"{value:g}") for value in x_ticks] or axes.x.labels(8, _label)
    parts = [*axes.levels(6, _label), *axes.columns(marked), *_titles(box, x_label, y_label)]
    parts.append(axes.inside([_drawn(one, looks[one.name], axes) for one in series]))
    keys = {one.name: (looks[one.name], one.kind) for one in series}
    return _framed(TOP + HEIGHT + FLOOR, description, parts, keys)


def stacked_plots(
    strips: Sequence[Strip], x_label: str, description: str, shades: Sequence[Shade] = ()
) -> Markup:
    """Return several plots, one below another, over one straight x axis, with one legend.

    `shades` are drawn behind the curves of every strip, one that is declined behind the others; named above the first.
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
        parts += _shaded(shades, axes, named=i == 0)
        # One level is no scale: ask for more ticks where there would be fewer than two.
        rows = next((n for n in range(3, 6) if len(axes.y.labels(n)) > 1), 3)
        parts += [*axes.levels(rows, _label), *axes.columns(axes.x.labels(10, _label), last)]
        parts += _titles(box, x_label if last else "", strip.label)
        parts.append(axes.inside([_drawn(one, looks[one.name], axes) for one in strip.series]))
    height = len(strips) * (STRIP + BETWEEN) - BETWEEN
    keys = {one.name: (looks[one.name], one.kind) for one in every}
    return _framed(TOP + height + FLOOR, description, parts, keys)


def contour_plot(
    x: FloatArray,
    y: FloatArray,
    values: FloatArray,
    trail: FloatArray | None,
    marks: Sequence[Mark],
    x_label: str,
    y_label: str,
    description: str,
    levels: FloatArray | None = None,
) -> Markup:
    """Return lines of equal value of `values` (ny, nx) over rising `x` (nx,) and `y` (ny,), with a path over them.

    `trail` (k, 2) are points joined in order, a dot at each; `levels` (l,) are by default spread so that each lies
    between equally many grid points.
    """
    box = Box(LEFT, TOP, WIDTH - LEFT - RIGHT, HEIGHT * 1.3)
    axes = Axes.around(box, (float(x[0]), float(x[-1])), (float(y[0]), float(y[-1])))
    wanted = contour_levels(values) if levels is None else levels
    inside = [contour_path(axes.x(x), axes.y(y), values, level, "contour") for level in wanted]
    if trail is not None:
        across, up = axes.x(trail[:, 0]), axes.y(trail[:, 1])
        dots = zip(across, up, strict=True)
        inside.append(path(across, up, "curve trail"))
        inside += [element("circle", cx=a, cy=b, r=2.0, class_="spot full hue1") for a, b in dots]
    looks = _looks(["path", *(mark.name for mark in marks)])
    inside += [_spot(axes.x.at(m.x), axes.y.at(m.y), looks[m.name], 5.0) for m in marks]
    ticks = [*axes.levels(6, _label), *axes.columns(axes.x.labels(8, _label))]
    keys: dict[str, tuple[int, Kind]] = {mark.name: (looks[mark.name], "points") for mark in marks}
    parts = [*ticks, *_titles(box, x_label, y_label), axes.inside(inside)]
    return _framed(TOP + box.height + FLOOR, description, parts, keys, fewest=1)


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


def _proper(wished: Range | None) -> Range | None:
    """Return a range where it is an interval between numbers that can be drawn."""
    return wished if wished and -MAX_NUMBER <= wished[0] < wished[1] <= MAX_NUMBER else None


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


def _shaded(shades: Sequence[Shade], axes: Axes, named: bool) -> list[Markup]:
    """Return the stretches, those declined behind the others, then the edges of all, so that covered ones show.

    A name above its stretch that would meet another is left out, first those of what is declined.
    """
    box, x = axes.box, axes.x
    ordered = sorted(shades, key=lambda one: one.kind != "declined")
    areas = []
    for one in ordered:
        left, width = x.at(one.start), max(x.at(one.stop) - x.at(one.start), 1.5)
        kind = f"shade {one.kind}"
        areas.append(element("rect", x=left, y=0.0, width=width, height=box.height, class_=kind))
    areas += [
        element("line", x1=x.at(end), x2=x.at(end), y1=0.0, y2=box.height, class_=f"brink {one.kind}")
        for one in ordered
        for end in (one.start, one.stop)
    ]
    parts, taken = [axes.inside(areas)], list[tuple[float, float]]()
    for one in sorted(shades, key=lambda s: (s.kind == "declined", s.start)) if named else ():
        place, half = box.left + 0.5 * (x.at(one.start) + x.at(one.stop)), 4.5 * len(one.name)
        if all(abs(place - other) >= half + wide for other, wide in taken):
            parts.append(element("text", one.name, x=place, y=box.top + 13, class_="shade-name mid"))
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


def _framed(
    height: float,
    description: str,
    parts: Sequence[Markup],
    keys: dict[str, tuple[int, Kind]],
    fewest: int = 2,
) -> Markup:
    """Return the drawing with its legend; a single series needs none."""
    framed = Markup('<div class="plot">{}</div>').format(drawing(WIDTH, height, description, parts))
    items = Markup("")
    for name, (look, kind) in keys.items() if len(keys) >= fewest else ():
        key = element("line", x1=0.0, x2=30.0, y1=5.0, y2=5.0, class_=f"series {_classes(look)}")
        key = _spot(15.0, 5.0, look, 3.5) if kind == "points" else key
        swatch = Markup('<svg viewBox="0 0 30 10" aria-hidden="true">{}</svg>').format(key)
        items += Markup("<li>{}{}</li>").format(swatch, name)
    return framed + Markup('<ul class="keys">{}</ul>').format(items) if items else framed
