"""Drawings of the identification report: channels, convergence, autocorrelation, correlation, intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import FloatArray
from stoop.base.numbers import RAISED
from stoop.report.plots import Axes, Box, Range, Scale, drawing, element, spanning, tick_text
from stoop.results.result import ParameterEstimate
from stoop.results.uncertainty import Interval, ParameterRepeatability

WIDTH: Final = 372.0  #: px of one panel; the page lays three side by side
LARGE: Final = 560.0  #: px of a panel of which two lie side by side
LEFT, RIGHT, FLOOR = 46.0, 6.0, 18.0
MAX_REACH: Final = 3.0  #: a simulated curve may widen the axis to so many times the measured range
Ends = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Curves:
    """What one panel shows, in the units shown; (n,) each, NaN where there is none."""

    time: FloatArray
    measured: FloatArray
    simulated: FloatArray
    baseline: FloatArray | None = None
    deviation: FloatArray | None = None  #: of a prediction, standard deviation with noise


def channel_panel(curves: Curves, role: str, description: str) -> Markup:
    """Return measured against simulated, over the 95 % band of a prediction, and their difference below."""
    span, residual = _time_span(curves.time), curves.measured - curves.simulated
    reach = max(map(abs, spanning([residual])))
    # A diverged simulation may not flatten the measurements to a line.
    known = curves.measured if np.isfinite(curves.measured).any() else curves.simulated
    low, high = spanning([known])
    room = MAX_REACH * (high - low)
    others = [curves.simulated] + ([curves.baseline] if curves.baseline is not None else [])
    clipped = (np.clip(other, low - room, high + room) for other in others)
    values = spanning([np.array([low, high]), *clipped], 0.02)
    upper = Axes.around(Box(LEFT, 6.0, WIDTH - LEFT - RIGHT, 128.0), span, values)
    lower = Axes.around(Box(LEFT, 142.0, WIDTH - LEFT - RIGHT, 44.0), span, (-reach, reach))
    parts = [axes.hole(*gap) for gap in holes(curves.time) for axes in (upper, lower)]
    parts += upper.frame(bottom_labels=False, rows=5) + lower.frame(rows=4)
    if curves.deviation is not None:
        half = NORMAL_95 * curves.deviation
        parts.append(upper.area(curves.time, curves.simulated - half, curves.simulated + half, "band"))
        parts.append(lower.area(curves.time, -half, half, "band"))
    parts.append(upper.curve(curves.time, curves.measured, "curve measured"))
    if curves.baseline is not None:
        parts.append(upper.curve(curves.time, curves.baseline, "curve baseline"))
    parts.append(upper.curve(curves.time, curves.simulated, f"curve {role}"))
    parts.append(lower.curve(curves.time, residual, "curve residual"))
    return drawing(WIDTH, 186.0 + FLOOR, description, parts)


def plain_panel(
    time: FloatArray,
    curves: Sequence[tuple[str, FloatArray]],
    description: str,
    width: float = WIDTH,
    height: float = 76.0,
) -> Markup:
    """Return curves (n,) over one another, each with its class, the last on top."""
    axes = Axes.around(
        Box(LEFT, 6.0, width - LEFT - RIGHT, height),
        _time_span(time),
        spanning([values for _, values in curves]),
    )
    parts = [axes.hole(*gap) for gap in holes(time)] + axes.frame(rows=round(height / 25.0))
    parts += [axes.curve(time, values, f"curve {kind}") for kind, values in curves]
    return drawing(width, height + 6.0 + FLOOR, description, parts)


def convergence_panel(history: FloatArray) -> Markup | None:
    """Return the best cost over the trajectories, from `history` (k, 2); None without a finite row."""
    good = history[np.all(np.isfinite(history), axis=1)]
    if not len(good):
        return None
    spent, cost = good[:, 0], good[:, 1]
    decades = bool(cost.min() > 0.0 and cost.max() > 10.0 * cost.min())
    level: FloatArray = np.log10(cost) if decades else cost

    def power_of_ten(level: float, step: float) -> str:
        return (
            tick_text(10.0**level, 10.0**level) if step < 1.0 else "10" + str(round(level)).translate(RAISED)
        )

    box = Box(LEFT, 6.0, LARGE - LEFT - RIGHT, 150.0)
    axes = Axes.around(box, spanning([spent], 0.02), spanning([level]))
    # The best cost stays until a better one is found: a staircase.
    stairs = axes.curve(np.repeat(spent, 2)[1:], np.repeat(level, 2)[:-1], "curve fit")
    frame = axes.frame(columns=8, text=power_of_ten if decades else tick_text)
    description = f"Best cost against trajectories, from {cost[0]:.4g} to {cost[-1]:.4g}."
    return drawing(LARGE, 156.0 + FLOOR, description, [*frame, stairs])


def autocorrelation_panel(values: FloatArray, period: float, samples: int, name: str) -> Markup:
    """Return the autocorrelation (lags + 1,) with the band in which 95 % of white residuals lie."""
    width, height = 220.0, 74.0
    lags = period * np.arange(len(values), dtype=np.float64)
    axes = Axes.around(Box(30.0, 6.0, width - 36.0, height), (0.0, max(lags[-1], period)), (-0.6, 1.05))
    reach = NORMAL_95 / np.sqrt(max(samples, 1))
    parts = [
        _band(axes, -reach, reach),
        *axes.frame(rows=3, columns=3),
        axes.curve(lags, values, "curve residual"),
    ]
    return drawing(width, height + 6.0 + FLOOR, f"Autocorrelation of the residuals of {name}.", parts)


def _band(axes: Axes, low: float, high: float) -> Markup:
    """Return a shaded range of the y axis."""
    box, top, bottom = axes.box, axes.y.at(high), axes.y.at(low)
    height = max(bottom - top, 0.5)
    return element("rect", x=box.left, y=box.top + top, width=box.width, height=height, class_="band")


def forest_row(one: ParameterEstimate, drawn: Ends, kind: str, description: str) -> Markup:
    """Return estimate and interval over prior, starting value and bounds, on a scale of the row's own.

    `drawn` are the ends of the interval; `kind` is the class of interval and estimate: "sure", "unsure" or "bound".
    """
    width, height = 260.0, 26.0
    middle = height / 2
    prior = (one.prior_mean - NORMAL_95 * one.prior_std, one.prior_mean + NORMAL_95 * one.prior_std)
    low, high = spanning([np.array([one.estimate, *drawn, one.start, *prior])], 0.08)
    near = 0.6 * (high - low)
    bounds = [edge for edge in (one.bound_lower, one.bound_upper) if low - near <= edge <= high + near]
    scale = Scale(*spanning([np.array([low, high, *bounds])], 0.01), 4.0, width - 4.0)
    parts: list[Markup] = [element("line", x1=0.0, x2=width, y1=middle, y2=middle, class_="grid")]
    if scale.low < 0.0 < scale.high:
        parts.append(_tick(scale.at(0.0), 2.0, height - 2.0, "zeroline"))
    if np.isfinite(prior).all():
        left, right = map(scale.at, prior)
        wide = right - left
        parts.append(element("rect", x=left, y=middle - 7, width=wide, height=14.0, rx=2.0, class_="prior"))
    parts += [_tick(scale.at(edge), 3.0, height - 3.0, "edge") for edge in bounds]
    if np.isfinite(one.start):
        parts.append(_tick(scale.at(one.start), middle - 6, middle + 6, "start"))
    if np.isfinite(drawn).all():
        left, right = map(scale.at, drawn)
        parts.append(element("line", x1=left, x2=right, y1=middle, y2=middle, class_=f"interval {kind}"))
    parts.append(element("circle", cx=scale.at(one.estimate), cy=middle, r=4.0, class_=f"dot {kind}"))
    return drawing(width, height, description, parts)


def method_intervals(
    estimate: float, intervals: Sequence[tuple[str, Interval | None]], description: str
) -> Markup:
    """Return the estimate as a line and one interval per method, with its class; an open end runs to the edge."""
    width, step = 340.0, 9.0
    ends = [e for _, s in intervals if s is not None for e in (s.ci95_lower, s.ci95_upper)]
    scale = Scale(*spanning([np.array([estimate, *ends])], 0.08), 4.0, width - 4.0)
    height = step * len(intervals) + 4.0
    parts = [_tick(scale.at(estimate), 1.0, height - 1.0, "zeroline")]
    if scale.low < 0.0 < scale.high:
        parts.append(_tick(scale.at(0.0), 0.0, height, "grid zero"))
    for i, (kind, one) in enumerate(intervals):
        if one is None:
            continue
        y = 2.0 + step * (i + 0.5)
        known = np.isfinite([one.ci95_lower, one.ci95_upper])
        if known.any():
            left = scale.at(one.ci95_lower) if known[0] else 0.0
            right = scale.at(one.ci95_upper) if known[1] else width
            open_end = "" if known.all() else " open"
            parts.append(element("line", x1=left, x2=right, y1=y, y2=y, class_=f"interval {kind}{open_end}"))
        hollow = "" if known.any() else " nothing"
        parts.append(element("circle", cx=scale.at(estimate), cy=y, r=2.6, class_=f"dot {kind}{hollow}"))
    return drawing(width, height, description, parts)


def repeatability_panel(name: str, one: ParameterRepeatability, joint: ParameterEstimate) -> Markup:
    """Return the estimates of single maneuvers with 95 % intervals over their weighted mean (band), the joint fit last."""
    width, height, top = 300.0, 110.0, 6.0
    points = [(s.estimate, s.std_error, "sure" if s.counted else "unsure") for s in one.singles]
    points.append((joint.estimate, joint.std_error, "bound" if joint.at_bound else "joint"))
    shown = [(v, e) for v, e, kind in points if kind != "unsure" and math.isfinite(v)]
    ends = [v + sign * NORMAL_95 * np.nan_to_num(e) for v, e in shown for sign in (-1.0, 1.0)]
    box = Box(LEFT, top, width - LEFT - RIGHT, height)
    axes = Axes.around(box, (0.4, len(points) + 0.6), spanning([np.array(ends)], 0.08))
    reach = NORMAL_95 * one.std_error
    parts = [_band(axes, one.mean - reach, one.mean + reach)] if math.isfinite(reach) else []
    parts += axes.levels(4)
    for i, (value, error, kind) in enumerate(points, 1):
        x = box.left + axes.x.at(i)
        text = "joint" if i == len(points) else str(i)
        parts.append(element("text", text, x=x, y=top + height + 13, class_="tick mid"))
        if kind == "unsure" or not math.isfinite(value):
            continue
        if math.isfinite(error):
            high, low = (top + axes.y.at(value + sign * NORMAL_95 * error) for sign in (1.0, -1.0))
            parts.append(element("line", x1=x, x2=x, y1=high, y2=low, class_=f"interval {kind}"))
        parts.append(element("circle", cx=x, cy=top + axes.y.at(value), r=4.0, class_=f"dot {kind}"))
    description = f"{name}: estimates with 95 % intervals of {len(points) - 1} maneuvers, their mean, and the joint fit."
    return drawing(width, top + height + FLOOR, description, parts)


def correlation_map(names: Sequence[str], matrix: FloatArray) -> Markup:
    """Return the lower triangle of a correlation matrix (k, k) as a map, blue below zero, red above."""
    size = max(9.0, min(24.0, 680.0 / max(len(names), 1)))
    numbered = len(names) <= 40 and size >= 16
    room = 12.0 + 6.2 * max((len(name) for name in names), default=1)
    parts: list[Markup] = []
    for i, name in enumerate(names):
        y = i * size
        parts.append(element("text", name, x=room - 6, y=y + size / 2 + 3.5, class_="tick end"))
        for j, value in enumerate(map(float, matrix[i, :i])):
            x, known, strong = room + j * size, math.isfinite(value), abs(value) >= 0.7
            kind = ("above" if value > 0 else "below") if known else "hole"
            opacity, side = round(value**2, 3) if known else 1.0, size - 1
            cell = element("rect", x=x, y=y, width=side, height=side, class_=kind, fill_opacity=opacity)
            parts.append(cell)
            if known and strong and numbered:
                number = f"{abs(value):.2f}".removeprefix("0") if abs(value) < 0.995 else "1.0"
                kind = "tick mid on-dark" if abs(value) > 0.85 else "tick mid on-light"
                parts.append(element("text", number, x=x + size / 2 - 0.5, y=y + size / 2 + 3, class_=kind))
        parts.append(element("rect", x=room + y, y=y, width=size - 1, height=size - 1, class_="diagonal"))
        slant = f"translate({room + y + size / 2:.1f} {len(names) * size + 8:.1f}) rotate(-50)"
        parts.append(element("text", name, transform=slant, class_="tick end"))
    side = len(names) * size
    description = "Correlation between the estimates; pairs above 0.9 are listed in the text."
    return drawing(room + side + 4, side + 0.8 * room + 14, description, parts)


def holes(time: FloatArray) -> list[Range]:
    """Return the stretches between segments of a joined time axis (n,)."""
    breaks = np.flatnonzero(np.isnan(time))
    inside = breaks[(breaks > 0) & (breaks < len(time) - 1)]
    return [(float(time[i - 1]), float(time[i + 1])) for i in inside]


def _tick(x: float, top: float, bottom: float, kind: str) -> Markup:
    return element("line", x1=x, x2=x, y1=top, y2=bottom, class_=kind)


def _time_span(time: FloatArray) -> Range:
    finite = time[np.isfinite(time)]
    if finite.size < 2 or finite[0] == finite[-1]:
        return spanning([finite])
    return float(finite[0]), float(finite[-1])
