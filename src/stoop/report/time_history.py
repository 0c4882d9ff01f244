"""Time histories that a reader can zoom, read and cut windows from: Bokeh figures over stills for print and no scripts.

Data in: panels of strips (`series.Strip`) over one time axis. Data out: the markup of all panels, each a still picture and
a place for its figures; and their data as JSON, from which the page's script makes Bokeh figures when they are seen. Bokeh
is what PX4's Flight Review uses; `benchmarks/pages.py` compares it with plotly. Its models are made by BokehJS: in
Python a report of 120 strips takes 7 s.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final

import numpy as np
from markupsafe import Markup

from stoop.base.arrays import FloatArray, IntArray
from stoop.report.palette import light
from stoop.report.plots import MARKERS, NARROW, strip_pictures, swatch
from stoop.report.series import DASHES, Look, Range, Series, Shade, Strip, looks_of, spanning

BAND: Final = "95 % band"  #: name of the bands in the legend
#: of a time axis; a longer one is kept in blocks, whole within as many samples of shades
MAX_SAMPLES: Final = 25_000
MAX_BLOCKS: Final = 5_000
STILL_COLUMNS: Final = 240  #: of a still picture
RESPONSE_HEIGHT, RESIDUAL_HEIGHT = 128.0, 44.0  #: px of strips
SMALL: Final = 280.0  #: px of a still picture of a compact history
WIDE: Final = 880.0  #: px of a still picture that has a row of its own


@dataclass(frozen=True, eq=False)
class HistoryPanel:
    """Strips of one quantity, such as a response and its residual, with a heading."""

    title: str
    strips: tuple[Strip, ...]
    unit: str = ""
    meaning: str = ""
    note: str = ""
    name: str = ""  #: in a table of the data; by default the title
    description: str = ""  #: for who cannot see it


@dataclass(frozen=True, eq=False)
class TimeHistory:
    """Panels over one time axis, s; a part of a page.

    `window` is what stands before START:STOP on a command line, such as ``--maneuver`` or ``--maneuver flight@``; empty
    where no window can be taken. `shades` are stretches of time that stand out.
    """

    template: ClassVar = "history"
    panels: Sequence[HistoryPanel]
    window: str = ""
    shades: Sequence[Shade] = ()
    wide: bool = False  #: one panel a row
    compact: bool = False  #: small panels, several a row
    each: bool = False  #: whether each panel has a legend of its own: its curves are in no other

    @cached_property
    def series(self) -> list[Series]:
        """All curves."""
        return [one for panel in self.panels for strip in panel.strips for one in strip.series]

    @cached_property
    def looks(self) -> dict[str, Look]:
        """The look of each name."""
        return looks_of(self.series)

    @cached_property
    def span(self) -> Range:
        """The time axis without margins."""
        ends = [one.x[np.isfinite(one.x)] for one in self.series]
        ends = [x[[0, -1]] for x in ends if len(x)]
        return spanning(ends, 0.0)

    @property
    def keys(self) -> list[tuple[str, Markup]]:
        """Names of the legend with their keys; none where each panel has its own."""
        return [] if self.each else self._keys(self.series)

    def keys_of(self, panel: HistoryPanel) -> list[tuple[str, Markup]]:
        """Names of a panel's own legend with their keys; none for a single curve."""
        own = [one for strip in panel.strips for one in strip.series]
        return self._keys(own) if self.each and len(own) > 1 else []

    def _keys(self, series: Sequence[Series]) -> list[tuple[str, Markup]]:
        kinds = {one.name: one.kind for one in series}
        keys = [(name, swatch(kind, self.looks[name])) for name, kind in kinds.items()]
        banded = [one for one in series if one.half_width is not None]
        if banded:
            rectangle = Markup("<rect width='30' height='10' style='fill: var(--{})'/>")
            frame = Markup('<svg viewBox="0 0 30 10" aria-hidden="true">{}</svg>')
            keys.append((BAND, frame.format(rectangle.format(band_role(banded[0])))))
        return keys

    def stills(self) -> list[Markup]:
        """Return the picture of each panel."""
        strips = [[replace(strip, label="") for strip in panel.strips] for panel in self.panels]
        groups = [(own, one.description or one.title) for own, one in zip(strips, self.panels, strict=True)]
        width = WIDE if self.wide else SMALL if self.compact else NARROW
        columns = STILL_COLUMNS * (1 + self.wide)
        return strip_pictures(groups, self.looks, self.span, "", self.shades, width=width, columns=columns)

    def document(self) -> Markup:
        """Return what the script of the page draws, as JSON: tables of data, and the strips of each panel."""
        tables: dict[bytes, dict[str, str]] = {}
        panels = [[self._strip(panel, strip, tables) for strip in panel.strips] for panel in self.panels]
        shades = [
            {"start": s.start, "stop": s.stop, "color": light(s.kind),
             "edge": None if s.kind == "hole" else light(f"{s.kind}-edge")}
            for s in self.shades
        ]  # fmt: skip
        content = {"span": self.span, "shades": shades, "tables": list(tables.values()), "panels": panels}
        # Text in an element "script": no tag may begin in it.
        return Markup(json.dumps(content, allow_nan=False).replace("<", "\\u003c"))  # noqa: S704

    def _strip(
        self, panel: HistoryPanel, strip: Strip, tables: dict[bytes, dict[str, str]]
    ) -> dict[str, Any]:
        """Return a strip, whose data are put into `tables`: one for each distinct time axis, seven digits of every value.

        Columns are named as in the table that a reader may save: `measured p [deg/s]`; those of bands end in low and high.
        """
        unit, drawn = f" [{panel.unit}]" if panel.unit else "", []
        for one in strip.series:
            x, y, half = stepped(one) if one.kind == "steps" else (one.x, one.y, one.half_width)
            starts, key, look = blocks(x, self.shades), x.tobytes(), self.looks[one.name]
            at, (y, *halves) = in_blocks(x, [y] if half is None else [y, half], starts)
            table = tables.setdefault(key, {"t": _packed(at, np.float64)})
            column = f"{one.name} {panel.name or panel.title}{unit}"
            while column in table:
                column += " "
            table[column] = _packed(y, np.float32)
            dash, (marker, fill) = DASHES[look.turn], MARKERS[look.turn]
            curve = {
                "name": one.name, "table": list(tables).index(key), "column": column, "color": look.color,
                "width": one.width, "dash": [] if isinstance(dash, str) else list(dash[1]),
                "marker": {"o": "circle", "s": "square"}[marker] if one.kind == "points" else "",
                "filled": fill == "full",
            }  # fmt: skip
            for half in halves:
                low, high = f"{column} low", f"{column} high"
                table[low], table[high] = _packed(y - half, np.float32), _packed(y + half, np.float32)
                curve |= {"low": low, "high": high, "band": light(band_role(one)), "band_name": BAND}
            drawn.append(curve)
        shown = [one.y for one in strip.series] + ([np.zeros(1)] if strip.zero else [])
        return {"height": strip.height, "range": strip.y_range or spanning(shown, 0.05), "series": drawn}


def with_residual(
    curves: Sequence[Series], name: str, values: FloatArray, y_range: Range | None = None
) -> tuple[Strip, Strip]:
    """Return a strip of curves and one of their difference `values` (n,), about zero, below."""
    reach = max(map(abs, spanning([values])))
    residual = Series(name, curves[0].x, values, role="residual", width=1.0)
    responses = Strip("", tuple(curves), height=RESPONSE_HEIGHT, y_range=y_range)
    return responses, Strip("", (residual,), height=RESIDUAL_HEIGHT, y_range=(-reach, reach))


def holes(time: FloatArray) -> list[Range]:
    """Return the stretches between segments of a joined time axis (n,)."""
    breaks = np.flatnonzero(np.isnan(time))
    inside = breaks[(breaks > 0) & (breaks < len(time) - 1)]
    return [(float(time[i - 1]), float(time[i + 1])) for i in inside]


def _packed(values: FloatArray, kind: type[np.floating[Any]]) -> str:
    with np.errstate(over="ignore"):
        return base64.b64encode(values.astype(np.dtype(kind).newbyteorder("<")).tobytes()).decode()


def stepped(one: Series) -> tuple[FloatArray, FloatArray, None]:
    """Return the corners of a curve of which each value holds until the next."""
    return np.repeat(one.x, 2)[1:], np.repeat(one.y, 2)[:-1], None


def in_blocks(
    x: FloatArray, curves: Sequence[FloatArray], starts: IntArray
) -> tuple[FloatArray, list[FloatArray]]:
    """Return the times (2 b,) of first and middle of each block, and the least and greatest value of each curve there (2 b,).

    The two stand in the order in which the curve passes them.
    """
    if len(starts) == len(x):
        return x, [*curves]
    ends = np.append(starts[1:], len(x))
    at = np.asarray(x[np.column_stack([starts, (starts + ends) // 2]).ravel()])
    return at, [_coarse(values, starts, ends) for values in curves]


def blocks(x: FloatArray, shades: Sequence[Shade]) -> IntArray:
    """Return the first sample of each block (b,) of a time axis: all samples of a short one, and within shades."""
    if len(x) <= MAX_SAMPLES:
        return np.arange(len(x))
    full = np.zeros(len(x), dtype=bool)
    for one in shades:
        full |= (x >= one.start) & (x <= one.stop)
    full &= np.count_nonzero(full) <= MAX_SAMPLES
    full[:: -(-len(x) // MAX_BLOCKS)] = True
    return np.flatnonzero(full | np.roll(full, 1))


def _coarse(values: FloatArray, starts: IntArray, ends: IntArray) -> FloatArray:
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    falling = values[starts] > values[ends - 1]
    upper = np.tile([False, True], len(starts)) ^ np.repeat(falling, 2)
    return np.where(upper, np.repeat(high, 2), np.repeat(low, 2))


def band_role(one: Series) -> str:
    """Return the color of the band about a curve."""
    return "band-validation" if one.role == "validation" else "band-fit"
