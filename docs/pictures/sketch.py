"""What pictures are made of: colors, arrows, arcs, labels, boxes, and outlines of an airplane.

Sketches have no scale: one unit is some tenth of the drawing. Views are those of engineering drawings in body axes: from
the right with the nose to the right, from above with the nose up, from behind; turns that are positive then look as they
do on paper (from the right, nose up is counterclockwise).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, FancyArrowPatch, FancyBboxPatch, Polygon
from matplotlib.text import Text
from numpy.typing import ArrayLike

from stoop.base.arrays import FloatArray

Point = tuple[float, float]

#: color by purpose, on a light and on a dark page; no two purposes share a color, since one file is made from the other
PALETTES: Final[dict[str, dict[str, str]]] = {
    "light": {
        "ink": "#1f2328", "soft": "#57606a", "faint": "#c9d1d9", "paper": "#fefefe", "body": "#e9edf2",
        "edge": "#7d8792", "blue": "#0b62c4", "orange": "#bf4b08", "green": "#1a7f37", "violet": "#8250df",
        "red": "#cf222e", "teal": "#0d7d87", "pale blue": "#d3e5fb", "pale orange": "#fbe0cc", "pale green": "#d2efd9",
        "pale violet": "#e8dcfa", "pale gray": "#eff2f5",
    },
    "dark": {
        "ink": "#e6edf3", "soft": "#9ea7b3", "faint": "#3a424b", "paper": "#131417", "body": "#2b3139",
        "edge": "#8b949e", "blue": "#6cb6ff", "orange": "#ff9c5b", "green": "#57d364", "violet": "#c297ff",
        "red": "#ff7b72", "teal": "#4cc9d3", "pale blue": "#153659", "pale orange": "#552f17", "pale green": "#163f22",
        "pale violet": "#3a2a5c", "pale gray": "#20252b",
    },
}  # fmt: skip
COLORS: Final = PALETTES["light"]
INK, SOFT, FAINT, PAPER, BODY, EDGE = (COLORS[n] for n in ("ink", "soft", "faint", "paper", "body", "edge"))
BLUE, ORANGE, GREEN, VIOLET, RED, TEAL = (
    COLORS[n] for n in ("blue", "orange", "green", "violet", "red", "teal")
)
PALE_BLUE, PALE_ORANGE, PALE_GREEN, PALE_VIOLET, PALE_GRAY = (
    COLORS[f"pale {n}"] for n in ("blue", "orange", "green", "violet", "gray")
)
CYCLE: Final = (BLUE, ORANGE, GREEN, VIOLET, RED, TEAL)
WIDTH: Final = 6.6  #: inches: as wide as the text of a page

STYLE: Final[dict[str, Any]] = {
    "font.family": "DejaVu Sans", "font.size": 10.5, "mathtext.fontset": "dejavusans", "svg.fonttype": "path",
    "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": SOFT, "axes.titlecolor": INK,
    "xtick.color": SOFT, "ytick.color": SOFT, "xtick.labelcolor": SOFT, "ytick.labelcolor": SOFT,
    "axes.titlesize": 11.0, "axes.labelsize": 10.5, "xtick.labelsize": 9.5, "ytick.labelsize": 9.5,
    "legend.fontsize": 9.5, "legend.frameon": False, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.color": FAINT, "grid.linewidth": 0.6, "lines.linewidth": 1.7, "axes.axisbelow": True,
    "axes.facecolor": "none", "figure.facecolor": "none", "savefig.facecolor": "none",
    "hatch.color": SOFT, "hatch.linewidth": 0.7, "patch.edgecolor": EDGE, "axes.titlelocation": "left",
}  # fmt: skip


def plots(rows: int = 1, columns: int = 1, height: float = 2.6, width: float = WIDTH, **how: Any) -> Any:
    """Return a figure and its axes, for curves; `how` is that of :meth:`Figure.subplots`."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **how)


@dataclass(frozen=True)
class Sketch:
    """A drawing without axes, in which one unit is as long to the right as it is upward."""

    axes: Axes

    def arrow(
        self,
        start: Point,
        end: Point,
        text: str = "",
        color: str = INK,
        at: Point | None = None,
        width: float = 1.8,
        both: bool = False,
        head: float = 13.0,
        dashed: bool = False,
        **how: Any,
    ) -> None:
        """Draw an arrow, and its text beyond the tip or at a place."""
        self.axes.add_patch(
            FancyArrowPatch(
                start, end, arrowstyle="<|-|>" if both else "-|>", mutation_scale=head, color=color, linewidth=width,
                shrinkA=0.0, shrinkB=0.0, linestyle=(0, (4, 2.5)) if dashed else "solid", zorder=4.0,
            )
        )  # fmt: skip
        if text:
            along = np.subtract(end, start) / max(float(np.hypot(*np.subtract(end, start))), 1e-9)
            place = at or (end[0] + 0.32 * along[0], end[1] + 0.32 * along[1])
            self.text(place, text, color, **how)

    def arc(
        self,
        center: Point,
        radius: float,
        begin: float,
        end: float,
        text: str = "",
        color: str = INK,
        at: Point | None = None,
        width: float = 1.8,
        head: bool = True,
        ratio: float = 1.0,
        **how: Any,
    ) -> None:
        """Draw an arc between angles, degrees counterclockwise from the right, with an arrow at its end."""
        angles = np.radians(np.linspace(begin, end, 60))
        x, y = center[0] + radius * np.cos(angles), center[1] + ratio * radius * np.sin(angles)
        self.curve(np.column_stack([x, y]), color, width, head)
        if text:
            middle = np.radians(0.5 * (begin + end))
            reach = radius + 0.35
            place = at or (center[0] + reach * np.cos(middle), center[1] + ratio * reach * np.sin(middle))
            self.text(place, text, color, **how)

    def curve(self, points: ArrayLike, color: str = INK, width: float = 1.8, head: bool = False) -> None:
        """Draw a curve through points (n, 2), with an arrow at its end."""
        path = np.asarray(points, dtype=float)
        cut = path[:-2] if head else path
        self.axes.plot(cut[:, 0], cut[:, 1], color=color, linewidth=width, solid_capstyle="butt", zorder=4.0)
        if head:
            self.axes.add_patch(
                FancyArrowPatch(
                    path[-4], path[-1], arrowstyle="-|>", mutation_scale=13.0, color=color, linewidth=0.0,
                    shrinkA=0.0, shrinkB=0.0, zorder=4.0,
                )
            )  # fmt: skip

    def line(
        self,
        points: Sequence[Point],
        color: str = SOFT,
        width: float = 1.0,
        dashed: bool = True,
        above: float = 3.0,
    ) -> None:
        """Draw a straight or broken line, thin and dashed unless said otherwise."""
        x, y = zip(*points, strict=True)
        style: Any = (0, (5, 3)) if dashed else "solid"
        self.axes.plot(x, y, color=color, linewidth=width, linestyle=style, zorder=above)

    def text(self, place: Point, text: str, color: str = INK, **how: Any) -> Text:
        """Write a text about a place."""
        how = {"ha": "center", "va": "center", "zorder": 6.0, **how}
        return self.axes.text(*place, text, color=color, **how)

    def shape(
        self,
        points: ArrayLike,
        fill: str = BODY,
        edge: str = EDGE,
        width: float = 1.1,
        at: Point = (0.0, 0.0),
        turn: float = 0.0,
        size: float = 1.0,
        above: float = 2.0,
    ) -> None:
        """Draw a polygon, enlarged, turned by degrees counterclockwise about its origin, and moved."""
        self.axes.add_patch(
            Polygon(
                placed(points, at, turn, size), closed=True, facecolor=fill, edgecolor=edge, linewidth=width,
                joinstyle="round", zorder=above,
            )
        )  # fmt: skip

    def ellipse(self, at: Point, width: float, height: float, turn: float = 0.0, **how: Any) -> None:
        """Draw an ellipse of some full width and height."""
        how = {"facecolor": BODY, "edgecolor": EDGE, "linewidth": 1.1, "zorder": 2.0, **how}
        self.axes.add_patch(Ellipse(at, width, height, angle=turn, **how))

    def dot(self, at: Point, color: str = INK, radius: float = 0.09) -> None:
        """Draw a point."""
        self.axes.add_patch(Circle(at, radius, facecolor=color, edgecolor="none", zorder=5.0))

    def center_of_gravity(self, at: Point, radius: float = 0.17) -> None:
        """Draw the symbol of a center of gravity."""
        self.axes.add_patch(Circle(at, radius, facecolor=PAPER, edgecolor=INK, linewidth=1.0, zorder=5.0))
        for quarter in (0.0, 180.0):
            angles = np.radians(np.linspace(quarter, quarter + 90.0, 20))
            wedge = np.column_stack([np.cos(angles), np.sin(angles)]) * radius
            self.shape(np.vstack([wedge, [0.0, 0.0]]), INK, "none", 0.0, at, above=5.1)

    def box(
        self, middle: Point, size: Point, text: str, fill: str = PALE_GRAY, edge: str = EDGE, **how: Any
    ) -> None:
        """Draw a rounded box with a text in it."""
        corner = (middle[0] - 0.5 * size[0], middle[1] - 0.5 * size[1])
        self.axes.add_patch(
            FancyBboxPatch(
                corner, *size, boxstyle="round,pad=0,rounding_size=0.18", facecolor=fill, edgecolor=edge,
                linewidth=1.1, zorder=2.0,
            )
        )  # fmt: skip
        self.text(middle, text, **how)

    def into_page(self, at: Point, color: str = INK, radius: float = 0.2) -> None:
        """Draw an axis that points away from the reader."""
        self.axes.add_patch(Circle(at, radius, facecolor=PAPER, edgecolor=color, linewidth=1.5, zorder=5.0))
        for sign in (1.0, -1.0):
            d = 0.7 * radius
            self.axes.plot(
                [at[0] - d, at[0] + d], [at[1] - sign * d, at[1] + sign * d], color=color, linewidth=1.3, zorder=5.1
            )  # fmt: skip

    def out_of_page(self, at: Point, color: str = INK, radius: float = 0.2) -> None:
        """Draw an axis that points to the reader."""
        self.axes.add_patch(Circle(at, radius, facecolor=PAPER, edgecolor=color, linewidth=1.5, zorder=5.0))
        self.dot(at, color, 0.33 * radius)

    def curved_body(self, points: ArrayLike, **how: Any) -> None:
        """Draw a closed outline, rounded through its points."""
        self.shape(rounded(points), **how)


def sketch(across: Point, up: Point, width: float = WIDTH) -> tuple[Figure, Sketch]:
    """Return an empty drawing that spans from..to, across and upward, and is `width` inches wide."""
    height = width * (up[1] - up[0]) / (across[1] - across[0])
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    return figure, _prepared(axes, across, up)


def panels(count: int, across: Point, up: Point, width: float = WIDTH) -> tuple[Figure, list[Sketch]]:
    """Return as many equal drawings side by side, together `width` inches wide."""
    share = 1.0 / count
    height = width * share * (up[1] - up[0]) / (across[1] - across[0])
    figure = Figure(figsize=(width, height))
    places = [figure.add_axes((i * share, 0.0, share, 1.0)) for i in range(count)]
    return figure, [_prepared(axes, across, up) for axes in places]


def _prepared(axes: Axes, across: Point, up: Point) -> Sketch:
    axes.set(xlim=across, ylim=up, aspect="equal")
    axes.set_axis_off()
    return Sketch(axes)


def placed(points: ArrayLike, at: Point = (0.0, 0.0), turn: float = 0.0, size: float = 1.0) -> FloatArray:
    """Return points (n, 2), enlarged, turned by degrees counterclockwise about the origin, and moved."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    out: FloatArray = size * np.asarray(points, dtype=float) @ np.array([[c, s], [-s, c]]) + np.asarray(at)
    return out


def rounded(points: ArrayLike, cuts: int = 3) -> FloatArray:
    """Return a closed polygon (n, 2) with its corners cut again and again (Chaikin's algorithm)."""
    path = np.asarray(points, dtype=float)
    for _ in range(cuts):
        following = np.roll(path, -1, axis=0)
        path = np.stack([0.75 * path + 0.25 * following, 0.25 * path + 0.75 * following], axis=1).reshape(
            -1, 2
        )
    return path


def airfoil(chord: float = 1.0, thickness: float = 0.12, points: int = 30) -> FloatArray:
    """Return the outline (n, 2) of a symmetric airfoil, leading edge at the origin, trailing edge to the left."""
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, points)))
    # thickness of the four-digit series with a closed trailing edge (Abbott and von Doenhoff, section 6.4)
    y = 5.0 * thickness * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    upper, lower = np.column_stack([-x, y]), np.column_stack([-x, -y])[::-1]
    return chord * np.vstack([upper, lower])


#: an airplane seen from the right, nose to the right: outline of the body, fin
SIDE_BODY: Final = np.array(
    [
        (4.3, -0.02), (3.9, 0.42), (2.6, 0.62), (2.0, 1.05), (0.9, 1.1), (-0.3, 0.72), (-3.0, 0.45), (-5.7, 0.3),
        (-5.9, 0.08), (-4.0, -0.12), (-1.0, -0.5), (2.0, -0.56), (3.8, -0.42),
    ]
)  # fmt: skip
SIDE_FIN: Final = np.array([(-4.3, 0.33), (-5.35, 1.95), (-6.15, 1.95), (-6.0, 0.2), (-5.4, 0.15)])
#: the same from above, nose up: body, right halves of wing and tail
TOP_BODY: Final = np.array(
    [(0.0, 4.3), (0.4, 3.8), (0.55, 2.4), (0.56, 0.3), (0.36, -2.5), (0.15, -5.6), (0.0, -5.9)]
)
TOP_WING: Final = np.array([(0.3, 1.45), (5.6, 1.05), (5.75, 0.75), (5.7, 0.0), (0.3, -0.25)])
TOP_TAIL: Final = np.array([(0.1, -4.5), (1.9, -4.75), (2.0, -5.0), (1.95, -5.55), (0.1, -5.6)])


def side_view(drawing: Sketch, at: Point = (0.0, 0.0), turn: float = 0.0, size: float = 1.0) -> None:
    """Draw an airplane from the right, nose to the right, nose up by degrees."""
    how = {"at": at, "turn": turn, "size": size}
    drawing.shape(SIDE_FIN, **how)
    drawing.shape(rounded(SIDE_BODY), **how)
    for chord, place in ((1.75, (1.35, 0.05)), (1.15, (-4.55, 0.35))):
        drawing.shape(airfoil(chord, 0.16) + place, PAPER, **how)


def top_view(drawing: Sketch, at: Point = (0.0, 0.0), turn: float = 0.0, size: float = 1.0) -> None:
    """Draw an airplane from above, nose up on the page, turned counterclockwise by degrees."""
    how = {"at": at, "turn": turn, "size": size}
    mirror = np.array([-1.0, 1.0])
    for part in (TOP_WING, TOP_TAIL):
        drawing.shape(part, **how)
        drawing.shape(part * mirror, **how)
    drawing.shape(rounded(np.vstack([TOP_BODY, (TOP_BODY * mirror)[::-1]]), 2), **how)


def rear_view(drawing: Sketch, at: Point = (0.0, 0.0), turn: float = 0.0, size: float = 1.0) -> None:
    """Draw an airplane from behind, turned counterclockwise by degrees."""
    how = {"at": at, "turn": turn, "size": size}
    wing = np.array([(0.4, -0.12), (5.7, 0.28), (5.75, 0.38), (5.6, 0.42), (0.4, 0.14)])
    tail = np.array([(0.1, 0.3), (2.0, 0.3), (2.0, 0.42), (0.1, 0.44)])
    mirror = np.array([-1.0, 1.0])
    for part in (wing, tail):
        drawing.shape(part, **how)
        drawing.shape(part * mirror, **how)
    drawing.shape([(-0.1, 0.3), (0.1, 0.3), (0.06, 1.95), (-0.06, 1.95)], **how)
    angles = np.linspace(0.0, 2.0 * np.pi, 60)
    drawing.shape(np.column_stack([0.6 * np.cos(angles), 0.06 + 0.62 * np.sin(angles)]), **how)


@dataclass(frozen=True)
class Projection:
    """Parallel projection of points (n, 3) in axes forward, right, down, seen from an azimuth and an elevation.

    Both in degrees: the azimuth is that of the viewer, to the right of the nose; the elevation is above the wings.
    """

    azimuth: float = 50.0
    elevation: float = 25.0

    def __call__(self, points: ArrayLike) -> FloatArray:
        """Return points (n, 2) of the drawing."""
        a, e = np.radians(self.azimuth), np.radians(self.elevation)
        viewer = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e)])
        up = np.array([np.sin(e) * np.cos(a), np.sin(e) * np.sin(a), np.cos(e)])
        up = -(np.array([0.0, 0.0, 1.0]) - viewer * viewer[2])
        up /= np.linalg.norm(up)
        right = np.cross(up, viewer)
        out: FloatArray = np.atleast_2d(np.asarray(points, dtype=float)) @ np.column_stack([right, up])
        return out

    def point(self, place: ArrayLike) -> Point:
        """Return the point of the drawing of one place (3,)."""
        x, y = self(place)[0]
        return float(x), float(y)
