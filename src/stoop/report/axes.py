"""A frame with ticks, into which curves are drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from stoop.base.arrays import FloatArray
from stoop.report.svg import Scale, element, path, plain_text, tick_text, ticks


@dataclass(frozen=True)
class Box:
    """A rectangle of the drawing in px."""

    left: float
    top: float
    width: float
    height: float


@dataclass(frozen=True)
class Axes:
    """A box with its two scales."""

    box: Box
    x: Scale
    y: Scale

    @classmethod
    def around(cls, box: Box, x: tuple[float, float], y: tuple[float, float]) -> Axes:
        """Return axes over the intervals `x` and `y`."""
        across = Scale(*x, 0.0, box.width)
        return cls(box, across, Scale(*y, box.height, 0.0))

    def curve(self, x: FloatArray, y: FloatArray, kind: str) -> Markup:
        """Return a curve clipped to the box; `kind` is its class."""
        box = self.box
        drawn = path(self.x(x), self.y(y), kind)
        return element("svg", drawn, x=box.left, y=box.top, width=box.width, height=box.height, class_="clip")

    def frame(
        self,
        bottom_labels: bool = True,
        rows: int = 4,
        columns: int = 5,
        text: Callable[[float, float], str] = tick_text,
    ) -> list[Markup]:
        """Return grid lines and tick labels; `text` makes the label of a level of the y axis and its step."""
        return [*self.levels(rows, text), *self._times(columns, bottom_labels)]

    def levels(self, rows: int, text: Callable[[float, float], str] = tick_text) -> list[Markup]:
        """Return the grid lines and labels of the y axis alone."""
        box = self.box
        levels = ticks(self.y.low, self.y.high, rows)
        parts: list[Markup] = []
        for level in levels:
            y = box.top + self.y.at(level)
            parts.append(
                element("line", x1=box.left, x2=box.left + box.width, y1=y, y2=y, class_=_weight(level))
            )
            label = text(level, _step(levels))
            parts.append(element("text", label, x=box.left - 5, y=y + 3.5, class_="tick end"))
        return parts

    def _times(self, columns: int, labels: bool) -> list[Markup]:
        box = self.box
        places = ticks(self.x.low, self.x.high, columns)
        parts: list[Markup] = []
        for place in places:
            x = box.left + self.x.at(place)
            parts.append(element("line", x1=x, x2=x, y1=box.top, y2=box.top + box.height, class_="grid"))
            if labels:
                label = plain_text(place, _step(places))
                parts.append(element("text", label, x=x, y=box.top + box.height + 13, class_="tick mid"))
        return parts

    def hole(self, start: float, stop: float) -> Markup:
        """Return a shaded stretch from `start` to `stop` on the x axis: nothing was recorded there."""
        left, right = self.x.at(start), self.x.at(stop)
        return element(
            "rect",
            x=self.box.left + left,
            y=self.box.top,
            width=max(right - left, 0.5),
            height=self.box.height,
            class_="hole",
        )


def _step(levels: Sequence[float]) -> float:
    return levels[1] - levels[0] if len(levels) > 1 else abs(levels[0]) if levels and levels[0] else 1.0


def _weight(level: float) -> str:
    return "grid zero" if level == 0.0 else "grid"
