"""Drawings of the identification report: small ones inside tables, and plots of convergence, autocorrelation and spread."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import FloatArray
from stoop.report.palette import light
from stoop.report.plots import canvas, plot, svg
from stoop.report.series import Series, spanning
from stoop.report.svg import Scale, drawing, element
from stoop.results.result import ParameterEstimate
from stoop.results.uncertainty import Interval, ParameterRepeatability

SMALL: Final = 300.0  #: px of a plot of which several stand side by side
MIN_DECADES: Final = 1.0  #: a cost that falls further is drawn on a logarithmic axis
Ends = tuple[float, float]


def convergence_panel(history: FloatArray) -> Markup | None:
    """Return the best cost over the trajectories, from `history` (k, 2); None without a finite row."""
    good = history[np.all(np.isfinite(history), axis=1)]
    if not len(good):
        return None
    cost = good[:, 1]
    decades = bool(cost.min() > 0.0 and cost.max() > 10.0**MIN_DECADES * cost.min())
    description = f"Best cost against trajectories, from {cost[0]:.4g} to {cost[-1]:.4g}."
    best = Series("best cost", good[:, 0], cost, "steps")  # it stays until a better one is found
    return plot([best], "trajectories", "cost", description, log_y=decades)


def autocorrelation_panels(channels: Mapping[str, tuple[FloatArray, float, int]]) -> dict[str, Markup]:
    """Return the autocorrelation of each channel with the band in which 95 % of white residuals lie, drawn on the same axes.

    `channels` are name to values (lags + 1,), sample period in s, and number of samples.
    """
    pictures = {}
    with canvas(SMALL, [90.0], floor=False, titles=False) as (figure, (axes,)):
        axes.set_ylim(-0.6, 1.05)
        axes.locator_params(nbins=4)
        for name, (values, period, samples) in channels.items():
            lags = period * np.arange(len(values), dtype=np.float64)
            reach = NORMAL_95 / np.sqrt(max(samples, 1))
            band = axes.axhspan(-reach, reach, color=light("band-fit"), linewidth=0.0)
            (line,) = axes.plot(lags, values, color=light("residual"))
            axes.set_xlim(0.0, max(float(lags[-1]), period))
            pictures[name] = svg(figure, f"Autocorrelation of the residuals of {name}.")
            for artist in (band, line):
                artist.remove()
    return pictures


def repeatability_panel(name: str, one: ParameterRepeatability, joint: ParameterEstimate) -> Markup:
    """Return the estimates of single maneuvers with 95 % intervals over their weighted mean (band), the joint fit last."""
    points = [(s.estimate, s.std_error, "fit" if s.counted else "") for s in one.singles]
    points.append((joint.estimate, joint.std_error, "lag" if joint.at_bound else "ink"))
    shown = [(i, v, e, role) for i, (v, e, role) in enumerate(points, 1) if role and math.isfinite(v)]
    ends = [v + sign * NORMAL_95 * np.nan_to_num(e) for _, v, e, _ in shown for sign in (-1.0, 1.0)]
    reach = NORMAL_95 * one.std_error
    with canvas(SMALL, [110.0], floor=False, titles=False) as (figure, (axes,)):
        if math.isfinite(reach):
            axes.axhspan(one.mean - reach, one.mean + reach, color=light("band-fit"), linewidth=0.0)
        for i, value, error, role in shown:
            half = NORMAL_95 * error if math.isfinite(error) else None
            axes.errorbar(i, value, half, color=light(role), marker="o", markersize=6.0, linewidth=2.4)
        axes.set_xlim(0.4, len(points) + 0.6)
        axes.set_ylim(*spanning([np.array(ends)], 0.08))
        axes.set_xticks(range(1, len(points) + 1), [*map(str, range(1, len(points))), "joint"])
        axes.grid(visible=False, axis="x")
        axes.locator_params("y", nbins=5)
        several = f"of {len(points) - 1} maneuvers, their mean, and the joint fit"
        return svg(figure, f"{name}: estimates with 95 % intervals {several}.")


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


def interval_rows(intervals: Sequence[tuple[str, float, Interval | None]], description: str) -> Markup:
    """Return estimates with their intervals, one below the other, by class; a line marks an estimate that all have.

    An open end runs to the edge.
    """
    width, step = 340.0, 9.0
    estimates = [estimate for _, estimate, s in intervals if s is not None]
    ends = [e for _, _, s in intervals if s is not None for e in (s.ci95_lower, s.ci95_upper)]
    scale = Scale(*spanning([np.array([*estimates, *ends])], 0.08), 4.0, width - 4.0)
    height = step * len(intervals) + 4.0
    common = estimates[:1] if len(set(estimates)) == 1 else []
    parts = [_tick(scale.at(estimate), 1.0, height - 1.0, "zeroline") for estimate in common]
    if scale.low < 0.0 < scale.high:
        parts.append(_tick(scale.at(0.0), 0.0, height, "grid zero"))
    for i, (kind, estimate, one) in enumerate(intervals):
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


def share_row(shares: Mapping[str, float], description: str) -> Markup:
    """Return a bar that is stacked from shares, by class; a negative one is not drawn."""
    width, left, parts = 240.0, 0.0, list[Markup]()
    total = math.fsum(max(share, 0.0) for share in shares.values())
    for kind, share in shares.items():
        wide = width * max(share, 0.0) / total
        if wide > 0.0:
            parts.append(element("rect", x=left, y=1.0, width=wide, height=10.0, class_=kind))
        left += wide
    return drawing(width, 12.0, description, parts)


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


def _tick(x: float, top: float, bottom: float, kind: str) -> Markup:
    return element("line", x1=x, x2=x, y1=top, y2=bottom, class_=kind)
