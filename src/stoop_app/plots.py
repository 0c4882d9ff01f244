"""Time histories of a flight: strips over one time axis, a cursor across them, and windows that are marked or brushed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import panel as pn
from bokeh.events import SelectionGeometry
from bokeh.models import (
    BoxAnnotation,
    BoxSelectTool,
    ColumnDataSource,
    CrosshairTool,
    HoverTool,
    PanTool,
    Range1d,
    Span,
    WheelZoomTool,
)
from bokeh.plotting import figure

from stoop import Flight, load_flight
from stoop.extend.arrays import FloatArray
from stoop.extend.reports import channel_panels, in_blocks, plots, sheet
from stoop.extend.text import factor_and_unit, number
from stoop.extend.variables import VARIABLES
from stoop_app.parts import button, escaped, html

MARKS: Final = {"fit": "fitted", "validate": "predicted", "": "declined"}  #: use of a window -> color
TEXT: Final = plots.light("tick")
#: figures are drawn for light paper; on dark paper their lightness is turned round, and hues stay
DARK: Final = "@media (prefers-color-scheme: dark) { :host { filter: invert(1) hue-rotate(180deg); } }"
NAMES: Final = (
    ".bk-btn-group { flex-wrap: wrap; } .bk-btn-group .bk-btn.bk-btn { border: 0; padding: 0 6px; font-size: 12px; "
    "background: none !important; box-shadow: none !important; } "
    ".bk-btn:not(.bk-active) { text-decoration: line-through; opacity: 0.5; }"
)  #: of the names above a strip
BUCKETS: Final = 1200  #: of which each keeps its smallest and its largest sample
HEIGHT, FIRST = 118, 24
DRAWN: Final = (280, 84)  #: width and height of a drawing of a running fit


@lru_cache(maxsize=4)
def read_flight(path: Path, changed: int) -> Flight:
    """Return a flight that stoop wrote; `changed` is the file's time, so that a new one is read again."""
    return load_flight(path)


def thinned(
    time: FloatArray, curves: Sequence[sheet.Series], start: float, stop: float
) -> dict[str, FloatArray]:
    """Return the samples between two times, of each bucket the smallest and the largest, so that no peak is lost."""
    first, behind = np.searchsorted(time, [start, stop], side="left")
    first, behind = max(int(first) - 1, 0), min(int(behind) + 1, len(time))
    size = math.ceil((behind - first) / BUCKETS)
    starts = np.arange(0, behind - first, size if size > 2 else 1)  # two samples need no bucket
    at, shown = in_blocks(time[first:behind], [one.y[first:behind] for one in curves], starts)
    return {"time": at, **dict(zip((one.name for one in curves), shown, strict=True))}


def calm(plot: Any) -> None:
    """Give a figure the looks of the pages' time histories."""
    plot.background_fill_alpha = plot.border_fill_alpha = 0.0
    plot.outline_line_color = None
    for axis in (*plot.xaxis, *plot.yaxis):
        axis.axis_line_color = axis.major_tick_line_color = axis.minor_tick_line_color = None
        axis.major_label_text_color = axis.axis_label_text_color = TEXT
        axis.axis_label_text_font_style = "normal"
    plot.grid.grid_line_color = plots.light("grid")
    plot.yaxis.ticker.desired_num_ticks = 4
    plot.min_border_left, plot.min_border_right = 58, 8


class Strips:
    """The strips of one flight as Bokeh figures, with windows marked; `brushed` is called with the span that was drawn."""

    def __init__(self, flight: Flight, brushed: Callable[[float, float], None] | None = None) -> None:
        self._time = flight.time
        found = channel_panels(flight)
        self._curves = [panel.strips[0].series for panel in found]
        start, stop = float(self._time[0]), float(self._time[-1])
        self._range = Range1d(start, stop, bounds=(start, stop))
        self._cursor = Span(dimension="height", line_color=TEXT, line_width=1)
        self._sources: list[Any] = []
        self._figures: list[Any] = []
        self._marks: list[list[BoxAnnotation]] = []  #: of each window, one in each figure
        shown: list[Any] = []
        for panel, curves in zip(found, self._curves, strict=True):
            plot = self._figure(panel, panel is found[-1], brushed)
            self._figures.append(plot)
            shown += [named(panel, dict(zip((one.name for one in curves), plot.renderers, strict=False)))]
            shown += [pn.pane.Bokeh(plot, sizing_mode="stretch_width", margin=0)]
        self._range.on_change("start", self._zoomed)
        self._range.on_change("end", self._zoomed)
        steer = {
            "◀": (-0.3, 1.0),
            "▶": (0.3, 1.0),
            "+": (0.0, 0.5),
            "−": (0.0, 2.0),
            "whole flight": (0.0, math.inf),
        }
        buttons = [button(name, partial(self._move, *by), margin=(0, 4, 4, 0)) for name, by in steer.items()]
        self.panel = pn.Column(pn.FlexBox(*buttons), *shown, sizing_mode="stretch_width", margin=0)

    def mark(self, windows: Iterable[tuple[float, float, str]]) -> None:
        """Mark windows: start, stop and use ("fit", "validate" or "")."""
        spans = list(windows)
        while len(self._marks) < len(spans):
            row = [BoxAnnotation(fill_alpha=0.25, level="underlay") for _ in self._figures]
            for plot, box in zip(self._figures, row, strict=True):
                plot.add_layout(box)
            self._marks.append(row)
        for i, row in enumerate(self._marks):  # one that is no longer needed is hidden
            start, stop, use = spans[i] if i < len(spans) else (0.0, 0.0, "")
            for box in row:
                edge = plots.light(f"{MARKS[use]}-edge")  # seen on light and on dark paper
                box.update(left=start, right=stop, fill_color=edge, line_color=edge, visible=i < len(spans))

    def _figure(
        self, panel: sheet.HistoryPanel, last: bool, brushed: Callable[[float, float], None] | None
    ) -> Any:
        curves = panel.strips[0].series
        drag = PanTool(dimensions="width") if brushed is None else BoxSelectTool(dimensions="width")
        wheel = WheelZoomTool(dimensions="width", modifiers="ctrl")  # without it the page scrolls
        plot = figure(
            height=HEIGHT + (FIRST if last else 0), sizing_mode="stretch_width", x_range=self._range,
            tools=[], min_border=2, toolbar_location=None, stylesheets=[DARK],
        )  # fmt: skip
        plot.add_tools(CrosshairTool(overlay=self._cursor), drag, wheel)
        plot.toolbar.active_drag, plot.toolbar.active_scroll = drag, wheel
        source = ColumnDataSource(thinned(self._time, curves, self._range.start, self._range.end))
        self._sources.append(source)
        lines = [
            plot.line("time", one.name, source=source, color=plots.light(one.role), line_width=one.width)
            for one in curves
        ]
        tips = [
            ("t", "@time{0.00} s"),
            *((one.name, f"@{{{one.name}}}{{0.000}} {panel.unit}") for one in curves),
        ]
        plot.add_tools(
            HoverTool(tooltips=tips, mode="vline", renderers=lines[:1], point_policy="follow_mouse")
        )
        if brushed is not None:

            def drawn(event: Any) -> None:
                if event.final and "x0" in event.geometry:
                    a, b = sorted((float(event.geometry["x0"]), float(event.geometry["x1"])))
                    brushed(max(a, float(self._time[0])), min(b, float(self._time[-1])))

            plot.on_event(SelectionGeometry, drawn)
        calm(plot)
        plot.xaxis.visible = last
        if last:
            plot.xaxis.axis_label = "s, the log's own clock"
        return plot

    def _move(self, shift: float, factor: float) -> None:
        """Move the view by a share of its width, and widen it."""
        low, high = float(self._time[0]), float(self._time[-1])
        width = self._range.end - self._range.start
        middle = 0.5 * (self._range.start + self._range.end) + shift * width
        half = 0.5 * min(width * factor, high - low)
        middle = min(max(middle, low + half), high - half)
        self._range.update(start=middle - half, end=middle + half)

    def _zoomed(self, attr: str, old: Any, new: Any) -> None:
        start, stop = float(self._range.start), float(self._range.end)
        for curves, source in zip(self._curves, self._sources, strict=True):
            source.data = thinned(self._time, curves, start, stop)


def named(panel: sheet.HistoryPanel, lines: Mapping[str, Any]) -> Any:
    """Return the line above a strip: what it shows, and the names of its curves, which a click hides."""
    colors = (
        f".bk-btn-group .bk-btn.bk-btn:nth-child({i}) {{ color: {plots.light(one.role)}; }}"
        for i, one in enumerate(panel.strips[0].series, 1)
    )
    names = pn.widgets.CheckButtonGroup(
        options=[*lines], value=[*lines], stylesheets=[NAMES, *colors, DARK], margin=0
    )

    def chosen(event: Any) -> None:
        for name, line in lines.items():
            line.visible = name in event.new

    names.param.watch(chosen, "value")
    unit = f" [{escaped(panel.unit)}]" if panel.unit else ""
    title = html(f"<b>{escaped(panel.title)}</b>{unit}", sizing_mode=None, margin=(0, 8, 0, 4))
    return pn.FlexBox(title, names, align_items="baseline", margin=(6, 0, 0, 0))


def drawn_curves(pieces: Sequence[dict[str, Any]]) -> str:
    """Return small drawings of measured and fitted curves, channel by channel, of the pieces of a progress file.

    They are markup, not figures: a page redraws them whole, twice a second, whatever the order in which its messages arrive.
    """
    out = []
    for name in pieces[0]["channels"] if pieces else ():
        factor, unit = factor_and_unit(VARIABLES[name].unit) if name in VARIABLES else (1.0, "")
        own = [piece["channels"][name] for piece in pieces]
        lines = {kind: [piece[kind] for piece in own] for kind in ("measured", "simulated")}
        out.append(_drawing(name, lines, partial(_amount, factor, unit)))
    return f'<div class="curves">{"".join(out)}</div>'


def drawn_costs(costs: Sequence[Sequence[float]]) -> str:
    """Return a small drawing of the cost of each improvement, on a logarithmic scale; it begins anew with new weights."""
    falling = [math.log10(cost) for _, cost in costs if cost > 0.0]
    shown = (
        _drawing("cost", {"simulated": [falling]}, lambda v: f"{number(10.0**v, 3)}")
        if len(falling) > 1
        else ""
    )
    return f'<div class="curves">{shown}</div>'


def _amount(factor: float, unit: str, value: float) -> str:
    return f"{number(factor * value, 3)} {unit}"


def _drawing(
    name: str, lines: Mapping[str, Sequence[Sequence[float | None]]], shown: Callable[[float], str]
) -> str:
    """Return curves of several kinds, each in pieces, over the numbers of their samples, with their span in words."""
    values = [v for kind in lines.values() for part in kind for v in part if v is not None]
    if not values:
        return ""
    low, high = min(values), max(values)
    scale = (DRAWN[1] - 4) / (high - low or 1.0)
    paths = ""
    for kind, parts in lines.items():
        step = DRAWN[0] / max(sum(map(len, parts)) - 1, 1)
        paths += f'<path class="{kind}" d="{_path(parts, step, low, scale)}"/>'
    label = f"<figcaption>{escaped(name)} <span>{escaped(shown(low))} to {escaped(shown(high))}</span></figcaption>"
    size = f'viewBox="0 0 {DRAWN[0]} {DRAWN[1]}" preserveAspectRatio="none" aria-hidden="true"'
    return f"<figure>{label}<svg {size}>{paths}</svg></figure>"


def _path(pieces: Sequence[Sequence[float | None]], step: float, low: float, scale: float) -> str:
    """Return the path of a curve with gaps, `low` at the bottom; of what is no number nothing is drawn."""
    words, i = [], 0
    for piece in pieces:
        pen = "M"
        for value in piece:
            if value is None:
                pen = "M"
            else:
                words.append(f"{pen}{step * i:.1f} {DRAWN[1] - 2 - scale * (value - low):.1f}")
                pen = "L"
            i += 1
    return "".join(words)
