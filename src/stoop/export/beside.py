"""The mapping that lies beside a log: where a variable stands that the ready mapping does not look for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.flight.calibration import MAX_DEFLECTION, SURFACES

USUAL_TRAVEL: Final = 0.5  #: rad, of a surface to either side


@dataclass
class Beside:
    """Lines of a mapping.

    Attributes
    ----------
    extends : the ready mapping that reads the rest; empty where there is none
    clock : name of the column that holds the time in seconds; empty for that of the reader
    lines : of [variables]
    tables : after them
    """

    extends: str = ""
    clock: str = ""
    lines: list[str] = field(default_factory=list)
    tables: list[str] = field(default_factory=list)

    def name(self, variable: str, column: str, unit: str, stream: str = "", more: str = "") -> None:
        """Say where a variable stands."""
        where = f'stream = "{stream}", ' if stream else ""
        self.lines.append(f'{variable} = {{ {where}column = "{column}", unit = "{unit}"{more} }}')

    def calibrate(self, surface: str, output: str, low: float, high: float, travel: float) -> None:
        """Say how far an output moves a surface: -travel at the pulse or command `low`, travel at `high`."""
        points = f"[[{low:g}, {-travel:g}], [{high:g}, {travel:g}]]"
        self.tables.append(f"[calibration.{output}]\npoints = {points}\n")
        self.tables.append(f"[surface.{surface}]\nfrom = {{ {output} = 1.0 }}\n")

    def text(self) -> str:
        """Return the file; empty where the ready mapping does it all."""
        if not self.lines and not self.tables:
            return ""
        head = [f'extends = "{self.extends}"\n'] if self.extends else []
        head += [f'[time]\ncolumn = "{self.clock}"\nunit = "s"\n'] if self.clock else []
        lines = ["\n".join(["[variables]", *self.lines]) + "\n"] if self.lines else []
        return "\n".join([*head, *lines, *self.tables])


def surfaces(left: dict[str, FloatArray]) -> list[str]:
    """Return the surfaces among what is left."""
    return [name for name in SURFACES if name in left]


def travel(x: FloatArray) -> float:
    """Return how far a surface goes to either side, rad: the usual, or as far as it went."""
    most = float(np.nanmax(np.abs(x), initial=0.0))
    return min(max(USUAL_TRAVEL, math.ceil(10.0 * most) / 10.0), MAX_DEFLECTION)
