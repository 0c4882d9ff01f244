"""The table: one row per figure, what was asked beside what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes
    ----------
    part : of the benchmark
    figure : what is measured
    value : measured; None where it could not be
    unit : printed behind the value
    at_most, at_least : what is asked; neither where the figure is only reported
    note : anything a reader must know
    """

    part: str
    figure: str
    value: float | None
    unit: str = ""
    at_most: float | None = None
    at_least: float | None = None
    note: str = ""

    @property
    def asked(self) -> str:
        """What is asked, in words."""
        low, high = _short(self.at_least), _short(self.at_most)
        if low and high:
            return f"{low} to {high} {self.unit}".rstrip()
        if self.at_most == 0.0:
            return "0"
        sign = "<=" if high else ">="
        return f"{sign} {low or high} {self.unit}".rstrip() if low or high else ""

    @property
    def measured(self) -> str:
        """What was measured, in words."""
        return "not measured" if self.value is None else f"{_short(self.value)} {self.unit}".rstrip()

    @property
    def verdict(self) -> str:
        """``pass`` or ``falls short``; empty where nothing is asked or nothing was measured."""
        if self.value is None or (self.at_most is None and self.at_least is None):
            return ""
        reached = (self.at_most is None or self.value <= self.at_most) and (
            self.at_least is None or self.value >= self.at_least
        )
        return "pass" if reached else "falls short"

    def as_json(self) -> dict[str, Any]:
        """Return the row for a JSON file."""
        return asdict(self) | {"verdict": self.verdict}


def _short(value: float | None) -> str:
    """Write a number with three significant digits, whole numbers whole."""
    if value is None:
        return ""
    if float(value).is_integer() and abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.0f}" if 100 <= abs(value) < 1e6 else f"{value:.3g}"


def markdown(rows: Sequence[Row]) -> str:
    """Return the rows as a Markdown table, aligned so that it also reads well in a terminal."""
    cells = [["part", "figure", "asked", "measured", "", "note"]]
    cells += [[r.part, r.figure, r.asked, r.measured, r.verdict, r.note] for r in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [
        "| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |" for line in cells
    ]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)
