"""The field's classic plot: estimates of one parameter with error bars, maneuver beside maneuver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.assess.covariance import NORMAL_95
from stoop.base.numbers import NOTHING, number, readable_unit, rounded_to_error, window
from stoop.report.axes import Axes, Box
from stoop.report.estimates import label
from stoop.report.svg import drawing, element, spanning
from stoop.results.result import Identification, ParameterEstimate, ParameterRepeatability

WIDTH, HEIGHT = 300.0, 110.0  #: px of the box and what stands beside it
LEFT, RIGHT, TOP, FLOOR = 46.0, 6.0, 6.0, 18.0
WORDS: Final = {"agree": "✓ agree", "scatter": "▲ scatter", "": NOTHING}


@dataclass(frozen=True)
class RepeatRow:
    """One parameter; texts as shown."""

    name: Markup
    unit: str
    singles: tuple[str, ...]
    mean: str
    joint: str
    chi: str
    verdict: str
    kind: str
    drawing: Markup


@dataclass(frozen=True)
class RepeatView:
    """All parameters that at least one maneuver can tell, and what the scatter says together."""

    maneuvers: tuple[str, ...]
    rows: tuple[RepeatRow, ...]
    words: str
    remarks: tuple[str, ...]


def repeat_view(identification: Identification) -> RepeatView | None:
    """Return table and plots; None where repeatability was not asked for."""
    found, maneuvers = identification.result.repeatability, identification.result.maneuvers
    if not found.maneuvers:
        return None
    titles = tuple(window(maneuvers[i].start, maneuvers[i].stop) for i in found.maneuvers)
    told = {n: p for n, p in found.parameters.items() if any(one.counted for one in p.singles)}
    rows = tuple(_row(identification, name, one) for name, one in told.items())
    return RepeatView(titles, rows, comparison(list(told.values())), found.remarks)


def comparison(parameters: Sequence[ParameterRepeatability]) -> str:
    """Return in words how many parameters can be compared, and how far they scatter."""
    compared = [one for one in parameters if one.verdict]
    if not compared:
        return "Too few maneuvers tell the same parameter when fitted alone, so nothing can be compared."
    wild = sum(one.verdict == "scatter" for one in compared)
    square, degrees = sum(one.chi_square for one in compared), sum(one.degrees for one in compared)
    ratio = math.sqrt(square / degrees)
    by_chance = (
        f"by chance about {0.05 * len(compared):.0f} would be"
        if len(compared) >= 20
        else "one in 20 is by chance"
    )
    return (
        f"{len(compared)} parameters can be told from two maneuvers or more; {wild} of them scatter more than their error "
        f"bars explain ({by_chance}). Over all of them the scatter is {ratio:.2f} times what the error bars say."
    )


def _row(identification: Identification, name: str, one: ParameterRepeatability) -> RepeatRow:
    joint = identification.result.parameters[name]
    return RepeatRow(
        name=label(identification, name),
        unit=readable_unit(joint.unit),
        singles=tuple(_pair(s.estimate, s.std_error) if s.counted else NOTHING for s in one.singles),
        mean=_pair(one.mean, one.std_error),
        joint=_pair(joint.estimate, joint.std_error),
        chi=f"{number(one.chi_square, 3)} / {one.degrees}" if one.verdict else NOTHING,
        verdict=WORDS[one.verdict] + (f" (p = {number(one.p_value, 2)})" if one.verdict else ""),
        kind={"agree": "better", "scatter": "worse"}.get(one.verdict, ""),
        drawing=_plot(name, one, joint),
    )


def _pair(value: float, error: float) -> str:
    return " ± ".join(rounded_to_error(value, error)) if math.isfinite(error) else number(value)


def _plot(name: str, one: ParameterRepeatability, joint: ParameterEstimate) -> Markup:
    """Return the estimates with 95 % intervals over their weighted mean (band); the joint fit stands last."""
    points = [(s.estimate, s.std_error, "sure" if s.counted else "unsure") for s in one.singles]
    points.append((joint.estimate, joint.std_error, "bound" if joint.at_bound else "joint"))
    shown = [(v, e, k) for v, e, k in points if k != "unsure" and math.isfinite(v)]
    ends = [v + sign * NORMAL_95 * np.nan_to_num(e) for v, e, _ in shown for sign in (-1.0, 1.0)]
    axes = Axes.around(
        Box(LEFT, TOP, WIDTH - LEFT - RIGHT, HEIGHT),
        (0.4, len(points) + 0.6),
        spanning([np.array(ends)], 0.08),
    )
    parts = [_band(axes, one), *axes.levels(4)]
    for i, (value, error, kind) in enumerate(points, 1):
        x = axes.box.left + axes.x.at(i)
        words = "joint" if i == len(points) else str(i)
        parts.append(element("text", words, x=x, y=TOP + HEIGHT + 13, class_="tick mid"))
        if kind != "unsure" and math.isfinite(value):
            parts.append(_bar(axes, x, value, error, kind))
    words = f"{name}: estimates with 95 % intervals of {len(points) - 1} maneuvers, their mean, and the joint fit."
    return drawing(WIDTH, TOP + HEIGHT + FLOOR, words, parts)


def _bar(axes: Axes, x: float, value: float, error: float, kind: str) -> Markup:
    middle = axes.box.top + axes.y.at(value)
    dot = element("circle", cx=x, cy=middle, r=4.0, class_=f"dot {kind}")
    if not math.isfinite(error):
        return dot
    top, bottom = (axes.box.top + axes.y.at(value + sign * NORMAL_95 * error) for sign in (1.0, -1.0))
    return element("line", x1=x, x2=x, y1=top, y2=bottom, class_=f"interval {kind}") + dot


def _band(axes: Axes, one: ParameterRepeatability) -> Markup:
    """Return the 95 % interval of the weighted mean."""
    if not math.isfinite(one.std_error):
        return Markup("")
    reach = NORMAL_95 * one.std_error
    top, bottom = axes.y.at(one.mean + reach), axes.y.at(one.mean - reach)
    height = max(bottom - top, 0.5)
    return element(
        "rect", x=axes.box.left, y=axes.box.top + top, width=axes.box.width, height=height, class_="band"
    )
