"""Curves and what stands with them in a plot: strips over a common axis, shaded stretches, marks, looks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray, runs
from stoop.base.numbers import MAX_NUMBER
from stoop.report.palette import light

MIN_VARIATION: Final = 1e-6  #: of a curve's size; what varies less is drawn flat
STRIP: Final = 84.0  #: px of the box of one strip
HUES: Final = 8
DASHES: Final = ("solid", (0, (7, 4)), (0, (2, 2.5)))
Kind = Literal["line", "steps", "points"]
ShadeKind = Literal["fitted", "predicted", "declined", "fault", "hole"]
#: of proposed windows, by their use
KINDS: Final[dict[str, ShadeKind]] = {"not used": "declined", "fit": "fitted", "predict": "predicted"}
Range = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Series:
    """A named curve."""

    name: str  #: stands in the legend; series of one name share their looks
    x: FloatArray  #: (n,), NaN breaks the curve
    y: FloatArray
    kind: Kind = "line"  #: "line", "steps" (each value holds until the next x) or "points"
    role: str = ""  #: color, one of `COLORS`; by default in order of appearance
    half_width: FloatArray | None = None  #: (n,), of a band about the curve
    width: float = 1.6  #: px


@dataclass(frozen=True, eq=False)
class Strip:
    """One of several plots over a common x axis: label with unit, series, and whether zero is shown."""

    label: str
    series: tuple[Series, ...]
    zero: bool = False
    height: float = STRIP  #: px
    y_range: Range | None = None


@dataclass(frozen=True)
class Shade:
    """A stretch of the x axis that stands out, with a short name above it."""

    start: float
    stop: float
    name: str
    kind: ShadeKind


@dataclass(frozen=True)
class Look:
    """Color and dash or marker of a series; its number counts the series that chose no role."""

    color: str
    turn: int = 0


def looks_of(series: Sequence[Series], given: Mapping[str, int] | None = None) -> dict[str, Look]:
    """Return the look of each name: that of its role, of its given number, or of its order of appearance."""
    names = dict.fromkeys(one.name for one in series if not one.role)
    numbers = given or {name: i for i, name in enumerate(names)}
    roles = {one.name: Look(light(one.role)) for one in series if one.role}
    turned = ((n, *divmod(numbers[n], HUES)) for n in names)
    return roles | {n: Look(light(f"hue{hue}"), turn % len(DASHES)) for n, turn, hue in turned}


def spanning(curves: Sequence[npt.ArrayLike], margin: float = 0.06) -> Range:
    """Return the least and greatest finite value with a margin; what varies by rounding alone counts as constant."""
    values = np.concatenate([np.ravel(np.asarray(c, dtype=np.float64)) for c in curves] or [np.zeros(1)])
    values = values[np.abs(values) <= MAX_NUMBER]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    size = max(abs(low), abs(high))
    room = margin * (high - low) if high - low > MIN_VARIATION * size else max(margin * size, 1e-6)
    return low - room, high + room


def thinned(one: Series, columns: int) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Return x, y and half width of a curve, of a dense one the extremes of each column, so that no peak is lost."""
    x, y, half = one.x, one.y, one.half_width
    if len(x) <= 2 * columns or one.kind == "points":
        return x, y, half
    block = -(-len(x) // columns)
    known = np.isfinite(x) & np.isfinite(y)
    ends = np.flatnonzero(np.diff(known, append=False))  # of pieces
    kept = [ends, ends + 1]  # and what breaks them
    for first, last in runs(known).tolist():
        whole = first + (last - first) // block * block
        starts, rows = np.arange(first, whole, block), y[first:whole].reshape(-1, block)
        extremes = (starts + rows.argmin(axis=1), starts + rows.argmax(axis=1))
        kept += [*extremes, np.arange(whole, last), np.array([first])]
    at = np.unique(np.concatenate(kept).astype(int))
    at = at[at < len(x)]
    return x[at], y[at], None if half is None else half[at]
