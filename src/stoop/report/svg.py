"""Small drawings as SVG text: scales, ticks, paths. Colors are classes, the style sheet owns them.

The page's own drawings rather than a plotting library's: each is a few kilobytes, scales and re-flows with
the page down to a phone, prints sharply, carries its description for a screen reader, and costs milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

FloatArray = npt.NDArray[np.float64]

COLUMNS: Final = 330  #: a denser curve is drawn as the least and the greatest value in so many columns
TENTHS: Final = 10.0  #: paths are whole tenths of a pixel: short text, and finer than the eye


@dataclass(frozen=True)
class Scale:
    """Straight map from data `low`..`high` to pixels `start`..`stop`."""

    low: float
    high: float
    start: float
    stop: float

    def __call__(self, values: npt.ArrayLike) -> FloatArray:
        """Return pixels (n,) of data (n,)."""
        share = (np.asarray(values, dtype=np.float64) - self.low) / (self.high - self.low)
        return self.start + share * (self.stop - self.start)

    def at(self, value: float) -> float:
        """Return the pixel of one value."""
        return float(self(value))


@dataclass(frozen=True)
class LogScale:
    """Map from data `low`..`high` to pixels `start`..`stop` by their logarithms; nothing for what is not positive."""

    low: float
    high: float
    start: float
    stop: float

    def __call__(self, values: npt.ArrayLike) -> FloatArray:
        """Return pixels (n,) of data (n,); NaN where there is no logarithm."""
        given = np.asarray(values, dtype=np.float64)
        levels = np.log10(np.where(given > 0.0, given, np.nan))
        straight = Scale(math.log10(self.low), math.log10(self.high), self.start, self.stop)
        return straight(levels)

    def at(self, value: float) -> float:
        """Return the pixel of one value."""
        return float(self(value))


CONSTANT = 1e-6  #: of a curve's size; what varies less is drawn flat


def spanning(curves: Sequence[npt.ArrayLike], margin: float = 0.06) -> tuple[float, float]:
    """Return the least and greatest finite value with a margin; what varies by rounding alone counts as constant."""
    values = np.concatenate(
        [np.ravel(np.asarray(curve, dtype=np.float64)) for curve in curves] or [np.zeros(1)]
    )
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    size = max(abs(low), abs(high))
    room = margin * (high - low) if high - low > CONSTANT * size else max(margin * size, 1e-6)
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
    raised = (
        f"{value:.{digits}e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e").replace("-", "−")
    )
    return raised if plain == "0" or len(raised) + 1 < len(plain) else plain


def _decade(value: float) -> int:
    return math.floor(math.log10(value) + 1e-9)


def path(x: FloatArray, y: FloatArray, kind: str) -> Markup:
    """Return a curve through pixels (n,), broken where either is NaN; `kind` is its class."""
    strokes = "".join(_stroke(x[run], y[run]) for run in _runs(np.isfinite(x) & np.isfinite(y)))
    return Markup('<path class="{}" transform="scale(.1)" d="{}"/>').format(kind, strokes)


def element(name: str, content: str = "", **attributes: str | float) -> Markup:
    """Return one element; numbers are rounded, text is escaped, ``class_`` is class, ``_`` is ``-``."""
    said = Markup("").join(
        Markup(' {}="{}"').format(key.rstrip("_").replace("_", "-"), _short(value))
        for key, value in attributes.items()
    )
    if not content and name != "text":
        return Markup("<{}{}/>").format(Markup(name), said)  # noqa: S704 (names are ours)
    return Markup("<{0}{1}>{2}</{0}>").format(Markup(name), said, content)  # noqa: S704 (names are ours)


def drawing(width: float, height: float, description: str, parts: Sequence[Markup]) -> Markup:
    """Return the whole drawing, with what it shows in words."""
    return Markup('<svg viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>').format(
        _short(width), _short(height), description, Markup("").join(parts)
    )


def _short(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.2f}".rstrip("0").rstrip(".")


def _runs(present: npt.NDArray[np.bool_]) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], present, [False]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _stroke(x: FloatArray, y: FloatArray) -> str:
    if len(x) > 2 * COLUMNS:
        x, y = _thinned(x, y)
    points = np.rint(TENTHS * np.column_stack([x, np.clip(y, -1e4, 1e4)])).astype(int)
    if len(points) == 1:
        points = np.array([points[0], [points[0, 0] + 1, points[0, 1]]])
    changed = np.concatenate([[True], np.any(np.diff(points, axis=0) != 0, axis=1)])
    return "M" + " ".join(f"{a} {b}" for a, b in points[changed].tolist())


def _thinned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least and greatest value of each of `COLUMNS` columns, so that no peak is lost."""
    starts = np.linspace(0, len(x), COLUMNS, endpoint=False).astype(int)
    low, high = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
    rising = y[starts] <= y[np.append(starts[1:], len(y)) - 1]
    pairs = np.where(rising[:, None], np.column_stack([low, high]), np.column_stack([high, low]))
    return np.repeat(x[starts], 2), pairs.ravel()
