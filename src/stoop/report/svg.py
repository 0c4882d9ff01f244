"""Drawings as SVG text: scales, ticks, axes, curves. Colors are classes of the style sheet.

Own drawings rather than a plotting library's: each is a few kilobytes, scales with the page down to a phone, prints
sharply, carries its description for a screen reader, and costs milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from stoop.base.arrays import FloatArray, runs
from stoop.base.numbers import RAISED

COLUMNS: Final = 330  #: a denser curve is drawn as the least and the greatest value in so many columns
TENTHS: Final = 10.0  #: paths are whole tenths of a pixel: short text, and finer than the eye
MIN_VARIATION: Final = 1e-6  #: of a curve's size; what varies less is drawn flat
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

    def inside(self, parts: Sequence[Markup]) -> Markup:
        """Return parts moved into the box, and cut at its edges."""
        box, content = self.box, Markup("").join(parts) or " "
        return element(
            "svg", content, x=box.left, y=box.top, width=box.width, height=box.height, class_="clip"
        )

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
    values = values[np.isfinite(values)]
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
    strokes = "".join(_stroke(x[a:b], y[a:b]) for a, b in runs(np.isfinite(x) & np.isfinite(y)))
    return Markup('<path class="{}" transform="scale(.1)" d="{}"/>').format(kind, strokes)


def _stroke(x: FloatArray, y: FloatArray) -> str:
    """Return the commands of one unbroken curve; a dense one as the extremes of each column, so that no peak is lost."""
    if len(x) > 2 * COLUMNS:
        starts = np.linspace(0, len(x), COLUMNS, endpoint=False).astype(int)
        low, high = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
        rising = y[starts] <= y[np.append(starts[1:], len(y)) - 1]
        pairs = np.where(rising[:, None], np.column_stack([low, high]), np.column_stack([high, low]))
        x, y = np.repeat(x[starts], 2), pairs.ravel()
    points = np.rint(TENTHS * np.column_stack([x, np.clip(y, -1e4, 1e4)])).astype(int)
    if len(points) == 1:
        points = np.array([points[0], [points[0, 0] + 1, points[0, 1]]])
    changed = np.concatenate([[True], np.any(np.diff(points, axis=0) != 0, axis=1)])
    return "M" + " ".join(f"{a} {b}" for a, b in points[changed].tolist())


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
