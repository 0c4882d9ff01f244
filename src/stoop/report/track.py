"""The path of a flight: from above with a scale in m, and in space, where a reader can turn it."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from markupsafe import Markup

from stoop.base.arrays import FloatArray
from stoop.base.rotations import to_ground
from stoop.flight import Flight
from stoop.report.palette import light
from stoop.report.plots import HEIGHT, LEFT, RIGHT, WIDTH, canvas, plot, svg
from stoop.report.series import Range, Series

MAX_POINTS: Final = 3000
GLYPHS: Final = 40  #: attitudes drawn along the path
GLYPH: Final = 0.03  #: size of an aircraft, share of the extent of the path
AZIMUTH, ELEVATION = np.radians(35.0), np.radians(25.0)  #: from where the still looks
_FUSELAGE, _WING, _FIN = (
    [[1.0, 0, 0], [-0.7, 0, 0]],
    [[0, 0.9, 0], [0, -0.9, 0]],
    [[-0.7, 0, 0], [-0.7, 0, -0.4]],
)
#: as one line, body axes (nose, right, down)
AIRCRAFT: Final = np.array([*_FUSELAGE, [0, 0, 0], *_WING, [0, 0, 0], *_FIN])


@dataclass(frozen=True, eq=False)
class Track:
    """Path and attitude; a part of a page."""

    template: ClassVar = "track"
    time: FloatArray  #: (n,) s
    path: FloatArray  #: (n, 3) m: north, east, up
    attitude: FloatArray | None  #: (n, 4) quaternions from north-east-down to body axes, NaN where unknown

    @classmethod
    def of(cls, flight: Flight) -> Track | None:
        """Return the track of a flight; None where no position was recorded."""
        up = next((flight.column(name) for name in ("altitude", "height") if name in flight.names), None)
        if up is None and "pd" in flight.names:
            up = -flight.column("pd")
        if up is None or not {"pn", "pe"} <= flight.names:
            return None
        path = np.column_stack([flight.column("pn"), flight.column("pe"), up])
        there = np.flatnonzero(np.isfinite(path).all(axis=1))
        if len(there) < 2:
            return None
        there = there[np.unique(np.linspace(0, len(there) - 1, MAX_POINTS).astype(int))]
        names = ("q0", "q1", "q2", "q3")
        known = set(names) <= flight.names
        attitude = np.column_stack([flight.column(n)[there] for n in names]) if known else None
        return cls(flight.time[there], path[there], attitude)

    def from_above(self) -> Markup:
        """Return the path over north and east, one scale for both."""
        series = [
            Series("path", self.path[:, 1], self.path[:, 0], role="fit"),
            Series("start", self.path[:1, 1], self.path[:1, 0], "points", role="validation"),
            Series("end", self.path[-1:, 1], self.path[-1:, 0], "points", role="lag"),
        ]
        ratio = (WIDTH - LEFT - RIGHT) / HEIGHT
        extent = max(np.ptp(self.path[:, 1]) / ratio, np.ptp(self.path[:, 0]), 1.0) * 0.55

        def about(values: FloatArray, half: float) -> Range:
            middle = 0.5 * (float(values.min()) + float(values.max()))
            return middle - half, middle + half

        ranges = about(self.path[:, 1], extent * ratio), about(self.path[:, 0], extent)
        return plot(series, "east, m", "north, m", "Path from above", x_range=ranges[0], y_range=ranges[1])

    def still(self) -> Markup:
        """Return the path in space with its shadow on the ground and the attitude along it."""
        ground = self.path.copy()
        ground[:, 2] = self.path[:, 2].min()
        with canvas(WIDTH, [HEIGHT], floor=False, titles=False) as (figure, (axes,)):
            axes.set_aspect("equal", adjustable="datalim")
            axes.set_axis_off()
            axes.plot(*projected(ground).T, color=light("measured"), linewidth=1.0)
            axes.plot(*projected(self.path).T, color=light("fit"))
            for glyph in self.glyphs():
                axes.plot(*projected(glyph).T, color=light("ink"), linewidth=1.0)
            return svg(figure, "Path in space with its shadow on the ground")

    def glyphs(self) -> list[FloatArray]:
        """Return small aircraft (k, 3) along the path, north, east, up."""
        if self.attitude is None:
            return []
        size, out = GLYPH * float(np.ptp(self.path, axis=0).max()), []
        for i in np.linspace(0, len(self.path) - 1, min(GLYPHS, len(self.path))).astype(int):
            if np.isfinite(self.attitude[i]).all():
                turned = to_ground(self.attitude[i], AIRCRAFT)  # north, east, down
                out.append(self.path[i] + size * turned * (1.0, 1.0, -1.0))
        return out

    def document(self) -> Markup:
        """Return what the script of the page draws, as JSON."""
        rows = [self.time[:, None], self.path]
        rows.append(np.full((len(self.time), 4), np.nan) if self.attitude is None else self.attitude)
        packed = np.column_stack(rows).astype("<f8").tobytes()
        shown = {"data": base64.b64encode(packed).decode(), "aircraft": AIRCRAFT.tolist(), "size": GLYPH}
        return Markup(json.dumps({"columns": 8, **shown}))  # noqa: S704 (numbers)


def projected(points: FloatArray) -> FloatArray:
    """Return points (n, 3), north, east, up, as seen from far away in the direction of the still (n, 2)."""
    north, east, up = points.T
    right = east * np.cos(AZIMUTH) - north * np.sin(AZIMUTH)
    away = east * np.sin(AZIMUTH) + north * np.cos(AZIMUTH)
    return np.column_stack([right, up * np.cos(ELEVATION) + away * np.sin(ELEVATION)])
