"""Small drawings as SVG text: elements, and a scale. Colors are classes of the style sheet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from markupsafe import Markup, escape

from stoop.base.arrays import FloatArray

Number = TypeVar("Number", float, FloatArray)


@dataclass(frozen=True)
class Scale:
    """Map from data `low`..`high` to pixels `start`..`stop`."""

    low: float
    high: float
    start: float
    stop: float

    def at(self, value: Number) -> Number:
        """Return the pixel of one value, or those of many."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.stop - self.start)


def element(name: str, content: str = "", **attributes: str | float) -> Markup:
    """Return one element; numbers are rounded, text is escaped, ``class_`` is class, ``_`` is ``-``."""
    names = {key: key.rstrip("_").replace("_", "-") for key in attributes}
    written = "".join(f' {names[key]}="{_short(value)}"' for key, value in attributes.items())
    if not content and name != "text":
        return Markup(f"<{name}{written}/>")  # noqa: S704 (values are escaped)
    return Markup(f"<{name}{written}>{escape(content)}</{name}>")  # noqa: S704 (values and content are escaped)


def drawing(width: float, height: float, description: str, parts: Sequence[Markup]) -> Markup:
    """Return the whole drawing, with its description."""
    return Markup('<svg viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>').format(
        _short(width), _short(height), description, Markup("").join(parts)
    )


def _short(value: str | float) -> str:
    """Return a number rounded, a text escaped."""
    return escape(value) if isinstance(value, str) else f"{value:.2f}".rstrip("0").rstrip(".")
