"""Lines of equal value over a grid, as one path a level.

Every cell is cut into two triangles: a level crosses a triangle in one straight piece or not at all, so there
are no doubtful cases.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.base.arrays import FloatArray
from stoop.report.svg import TENTHS

LEVELS: Final = 14


def contour_levels(values: FloatArray, count: int = LEVELS) -> FloatArray:
    """Return `count` levels (count,) with equally many grid values between each; none where all are alike."""
    finite = values[np.isfinite(values)]
    if not finite.size or finite.min() == finite.max():
        return np.empty(0)
    levels: FloatArray = np.unique(np.quantile(finite, (np.arange(count) + 0.5) / count))
    return levels


def contour_path(x: FloatArray, y: FloatArray, values: FloatArray, level: float, kind: str) -> Markup:
    """Return the line on which `values` (ny, nx) over pixels `x` (nx,) and `y` (ny,) equal `level`."""
    pieces = np.rint(TENTHS * _pieces(x, y, values, level)).astype(int)
    strokes = "".join(f"M{a} {b}L{c} {d}" for a, b, c, d in pieces.tolist() if (a, b) != (c, d))
    return Markup(
        '<path class="{}" transform="scale(.1)" d="{}" vector-effect="non-scaling-stroke"/>'
    ).format(kind, strokes)


def _pieces(x: FloatArray, y: FloatArray, values: FloatArray, level: float) -> FloatArray:
    """Return straight pieces, (m, 4): x and y of both ends."""
    X, Y = np.meshgrid(x, y)
    points = np.stack([X, Y, values - level], axis=-1)
    a, b = points[:-1, :-1], points[:-1, 1:]
    c, d = points[1:, :-1], points[1:, 1:]
    corners = np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, d), (a, d, c))])
    corners = corners[np.isfinite(corners).all(axis=(1, 2))]
    above = corners[:, :, 2] > 0.0
    crossed = corners[(above.any(axis=1)) & ~above.all(axis=1)]
    return _cut(crossed)


def _cut(corners: FloatArray) -> FloatArray:
    """Return where zero cuts triangles (m, 3, 3) that it does cut: (m, 4)."""
    above = corners[:, :, 2] > 0.0
    # the corner that is alone on its side of the level
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
    rows = np.arange(len(corners))
    tip = corners[rows, alone]
    ends = [_between(tip, corners[rows, (alone + k) % 3]) for k in (1, 2)]
    return np.concatenate(ends, axis=1)


def _between(p: FloatArray, q: FloatArray) -> FloatArray:
    """Return x and y (m, 2) where the third coordinate vanishes between p and q, (m, 3) each."""
    share = p[:, 2] / (p[:, 2] - q[:, 2])
    place: FloatArray = p[:, :2] + share[:, None] * (q[:, :2] - p[:, :2])
    return place
