"""The drawings of the report: curves of a channel, convergence, autocorrelation, correlation, intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.base.arrays import FloatArray
from stoop.base.numbers import RAISED
from stoop.report.axes import Axes, Box
from stoop.report.svg import Scale, drawing, element, spanning, tick_text

WIDTH: Final = 372.0  #: px of one panel; the page lays three side by side
LARGE: Final = 560.0  #: px of a panel of which two lie side by side
LEFT, RIGHT, FLOOR = 46.0, 6.0, 18.0
NAMED: Final = 40  #: rows up to which a correlation matrix shows its numbers
DARK: Final = 0.85  #: correlation above which a cell is dark enough for white digits
DIVERGED: Final = 3.0  #: a simulated curve may widen the axis to so many times the measured range


@dataclass(frozen=True, eq=False)
class Curves:
    """What one panel shows, in the units shown; (n,) each, NaN where there is none."""

    time: FloatArray
    measured: FloatArray
    simulated: FloatArray
    baseline: FloatArray | None = None

    @property
    def residual(self) -> FloatArray:
        """Measured minus simulated."""
        return self.measured - self.simulated


def channel_panel(curves: Curves, role: str, description: str) -> Markup:
    """Return measured against simulated, and their difference to the same scale per px below."""
    span = _time_span(curves.time)
    upper = Axes.around(Box(LEFT, 6.0, WIDTH - LEFT - RIGHT, 128.0), span, _range(curves))
    lower = Axes.around(Box(LEFT, 142.0, WIDTH - LEFT - RIGHT, 44.0), span, _symmetric(curves.residual))
    parts = [axes.hole(*gap) for gap in holes(curves.time) for axes in (upper, lower)]
    parts += upper.frame(bottom_labels=False, rows=5) + lower.frame(rows=4)
    parts.append(upper.curve(curves.time, curves.measured, "curve measured"))
    if curves.baseline is not None:
        parts.append(upper.curve(curves.time, curves.baseline, "curve baseline"))
    parts.append(upper.curve(curves.time, curves.simulated, f"curve {role}"))
    parts.append(lower.curve(curves.time, curves.residual, "curve residual"))
    return drawing(WIDTH, 186.0 + FLOOR, description, parts)


def plain_panel(
    time: FloatArray,
    curves: Sequence[tuple[str, FloatArray]],
    description: str,
    width: float = WIDTH,
    height: float = 76.0,
) -> Markup:
    """Return curves (n,) over one another, each with its class, the last on top."""
    span = _time_span(time)
    box = Box(LEFT, 6.0, width - LEFT - RIGHT, height)
    axes = Axes.around(box, span, spanning([values for _, values in curves]))
    parts = [axes.hole(*gap) for gap in holes(time)] + axes.frame(rows=round(height / 25.0))
    parts += [axes.curve(time, values, f"curve {kind}") for kind, values in curves]
    return drawing(width, height + 6.0 + FLOOR, description, parts)


def convergence_panel(history: FloatArray) -> Markup:
    """Return the best cost over the trajectories spent, from `history` (k, 2) with a finite row."""
    good = history[np.all(np.isfinite(history), axis=1)]
    spent, cost = good[:, 0], good[:, 1]
    decades = bool(cost.min() > 0.0 and cost.max() > 10.0 * cost.min())
    level: FloatArray = np.log10(cost) if decades else cost
    axes = Axes.around(
        Box(LEFT, 6.0, LARGE - LEFT - RIGHT, 150.0), spanning([spent], 0.02), spanning([level])
    )
    # The best cost stays until a better one is found: a staircase.
    stairs = axes.curve(np.repeat(spent, 2)[1:], np.repeat(level, 2)[:-1], "curve fit")
    frame = axes.frame(columns=8, text=_power_of_ten if decades else tick_text)
    words = f"Best cost against trajectories spent, from {cost[0]:.4g} to {cost[-1]:.4g}."
    return drawing(LARGE, 156.0 + FLOOR, words, [*frame, stairs])


def _power_of_ten(level: float, step: float) -> str:
    return tick_text(10.0**level, 10.0**level) if step < 1.0 else "10" + str(round(level)).translate(RAISED)


def autocorrelation_panel(values: FloatArray, period: float, samples: int, name: str) -> Markup:
    """Return the autocorrelation (lags + 1,) with the band in which 95 % of white residuals lie."""
    width, height = 220.0, 74.0
    axes = Axes.around(
        Box(30.0, 6.0, width - 36.0, height), (0.0, period * max(len(values) - 1, 1)), (-0.6, 1.05)
    )
    band = 1.96 / np.sqrt(max(samples, 1))
    top, bottom = axes.y.at(band), axes.y.at(-band)
    shade = element(
        "rect", x=30.0, y=6.0 + top, width=width - 36.0, height=max(bottom - top, 0.5), class_="band"
    )
    curve = axes.curve(period * np.arange(len(values), dtype=np.float64), values, "curve residual")
    parts = [shade, *axes.frame(rows=3, columns=3), curve]
    return drawing(width, height + 6.0 + FLOOR, f"Autocorrelation of the residuals of {name}.", parts)


@dataclass(frozen=True)
class ForestRow:
    """One row of the forest plot; NaN for what does not exist."""

    estimate: float
    lower: float
    upper: float
    start: float
    prior_lower: float
    prior_upper: float
    bounds: tuple[float, float]
    kind: str  #: class: "sure", "unsure" or "bound"


def forest_row(row: ForestRow, description: str) -> Markup:
    """Return estimate and interval over prior, starting value and bounds, on a scale of the row's own."""
    width, height = 260.0, 26.0
    middle = height / 2
    inner = [row.estimate, row.lower, row.upper, row.start, row.prior_lower, row.prior_upper]
    low, high = spanning([np.array(inner)], 0.08)
    shown = [edge for edge in row.bounds if low - 0.6 * (high - low) <= edge <= high + 0.6 * (high - low)]
    scale = Scale(*spanning([np.array([low, high, *shown])], 0.01), 4.0, width - 4.0)
    parts: list[Markup] = [element("line", x1=0.0, x2=width, y1=middle, y2=middle, class_="grid")]
    if scale.low < 0.0 < scale.high:
        parts.append(_tick(scale.at(0.0), 2.0, height - 2.0, "zeroline"))
    if np.isfinite([row.prior_lower, row.prior_upper]).all():
        left, right = scale.at(row.prior_lower), scale.at(row.prior_upper)
        parts.append(
            element("rect", x=left, y=middle - 7, width=right - left, height=14.0, rx=2.0, class_="prior")
        )
    parts += [_tick(scale.at(edge), 3.0, height - 3.0, "edge") for edge in shown]
    if np.isfinite(row.start):
        parts.append(_tick(scale.at(row.start), middle - 6, middle + 6, "start"))
    if np.isfinite([row.lower, row.upper]).all():
        left, right = scale.at(row.lower), scale.at(row.upper)
        parts.append(element("line", x1=left, x2=right, y1=middle, y2=middle, class_=f"interval {row.kind}"))
    parts.append(element("circle", cx=scale.at(row.estimate), cy=middle, r=4.0, class_=f"dot {row.kind}"))
    return drawing(width, height, description, parts)


def correlation_map(names: Sequence[str], matrix: FloatArray) -> Markup:
    """Return the lower triangle of a correlation matrix (k, k) as a map, blue below zero, red above."""
    size = max(9.0, min(24.0, 680.0 / max(len(names), 1)))
    room = 12.0 + 6.2 * max((len(name) for name in names), default=1)
    parts: list[Markup] = []
    for i, name in enumerate(names):
        y = i * size
        parts.append(element("text", name, x=room - 6, y=y + size / 2 + 3.5, class_="tick end"))
        parts += [_cell(room + j * size, y, size, float(matrix[i, j]), len(names)) for j in range(i)]
        parts.append(element("rect", x=room + y, y=y, width=size - 1, height=size - 1, class_="diagonal"))
        parts.append(_slanted(name, room + y + size / 2, len(names) * size + 8))
    side = len(names) * size
    words = "Correlation between the estimates; pairs above 0.9 are listed in the text."
    return drawing(room + side + 4, side + 0.8 * room + 14, words, parts)


def holes(time: FloatArray) -> list[tuple[float, float]]:
    """Return the stretches between segments of a joined time axis (n,)."""
    breaks = np.flatnonzero(np.isnan(time))
    inside = breaks[(breaks > 0) & (breaks < len(time) - 1)]
    return [(float(time[i - 1]), float(time[i + 1])) for i in inside]


def _cell(x: float, y: float, size: float, value: float, count: int) -> Markup:
    if not np.isfinite(value):
        return element("rect", x=x, y=y, width=size - 1, height=size - 1, class_="hole")
    sign = "above" if value > 0 else "below"
    square = element(
        "rect", x=x, y=y, width=size - 1, height=size - 1, class_=sign, fill_opacity=round(value**2, 3)
    )
    if abs(value) < 0.7 or count > NAMED or size < 16:
        return square
    number = f"{abs(value):.2f}".removeprefix("0") if abs(value) < 0.995 else "1.0"
    kind = "tick mid on-dark" if abs(value) > DARK else "tick mid on-light"
    return square + element("text", number, x=x + size / 2 - 0.5, y=y + size / 2 + 3, class_=kind)


def _slanted(name: str, x: float, y: float) -> Markup:
    return element("text", name, transform=f"translate({x:.1f} {y:.1f}) rotate(-50)", class_="tick end")


def _tick(x: float, top: float, bottom: float, kind: str) -> Markup:
    return element("line", x1=x, x2=x, y1=top, y2=bottom, class_=kind)


def _time_span(time: FloatArray) -> tuple[float, float]:
    finite = time[np.isfinite(time)]
    if finite.size < 2 or finite[0] == finite[-1]:
        return spanning([finite])
    return float(finite[0]), float(finite[-1])


def _range(curves: Curves) -> tuple[float, float]:
    """Return the interval of the y axis: a diverged simulation may not squash the measurements to a line."""
    known = [curves.measured] if np.isfinite(curves.measured).any() else [curves.simulated]
    low, high = spanning(known)
    reach = DIVERGED * (high - low)
    others = [curves.simulated] + ([curves.baseline] if curves.baseline is not None else [])
    return spanning(
        [np.array([low, high]), *(np.clip(other, low - reach, high + reach) for other in others)], 0.02
    )


def _symmetric(values: FloatArray) -> tuple[float, float]:
    low, high = spanning([values])
    reach = max(abs(low), abs(high))
    return -reach, reach
