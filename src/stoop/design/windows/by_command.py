"""What windows tell when nothing is known of the vehicle: how strongly, and how independently, each axis moves.

Whatever the model is, the derivative of a rate depends on the rates and on the commands. What a window tells of such
numbers is the matrix of products of commands and rates: large where they move, singular where they move together, as
a closed loop makes them. Each is taken in units of what is usual in this flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.base.variables import RATES
from stoop.design.windows.candidates import Candidate
from stoop.design.windows.choice import Evidence
from stoop.flight import Flight
from stoop.flight.airborne import flying
from stoop.flight.maneuvers import MOTION, Axis, by_axis, commands, moving_average, usual_deviation

SMOOTH: Final = 0.2  #: s
SLOW: Final = 5.0  #: s; slower is trim
SPAN: Final = 8.0  #: s of usual flight that count as known before
STIRS: Final = 0.05  #: of the strongest; what moves less is not among what must be told apart
LEAST: Final = 0.02  #: of the largest excursion: no command is usually smaller than that


@dataclass(frozen=True, eq=False)
class Motion:
    """Commands and rates of a flight, less what is slow, in units of what is usual.

    Attributes
    ----------
    names : tuple of str
    axes : tuple of str
        Which axis each is of.
    values : (n, m)
        NaN where missing.
    """

    names: tuple[str, ...]
    axes: tuple[Axis, ...]
    values: FloatArray

    @classmethod
    def of(cls, flight: Flight) -> Motion | None:
        """Return those of a flight; None where no command or no rate was recorded."""
        told = by_axis(commands(flight))
        rates = {axis: name for axis, name in MOTION.items() if name in RATES and name in flight.data}
        if not told or not rates:
            return None
        columns = [*(c.u for c in told.values()), *(flight.column(name) for name in rates.values())]
        names = (*(f"{axis} command" for axis in told), *(f"{axis} rate" for axis in rates))
        x, up = np.column_stack(columns), flying(flight)
        x = moving_average(x, round(SMOOTH * flight.rate)) - moving_average(x, round(SLOW * flight.rate), 0.3)
        sizes = [_size(column, up) for column in x.T]
        return cls(names, (*told, *rates), x / np.array(sizes))

    def inside(self, flight: Flight, one: Candidate) -> FloatArray:
        """Return the complete samples (k, m) of a window, about their mean."""
        rows = self.values[(flight.time >= one.start) & (flight.time <= one.stop)]
        rows = rows[np.isfinite(rows).all(axis=1)]
        return rows - rows.mean(axis=0) if len(rows) else rows

    def strengths(self, flight: Flight, one: Candidate) -> Mapping[Axis, float]:
        """Return how many times the usual the command of each axis moves in a window."""
        rows = self.inside(flight, one)
        sizes = np.sqrt(np.mean(rows**2, axis=0)) if len(rows) else np.zeros(len(self.names))
        pairs = zip(self.axes, self.names, sizes, strict=True)
        return {axis: float(size) for axis, name, size in pairs if name.endswith("command")}

    def condition(self, flight: Flight, one: Candidate) -> float:
        """Return the condition number of the correlations of commands and rates: 1 is independent."""
        rows = self.inside(flight, one)
        if len(rows) <= len(self.names):
            return float("inf")
        size = np.sqrt(np.sum(rows**2, axis=0))
        moved = size > STIRS * float(size.max())
        if not moved.any():
            return float("inf")
        values = np.linalg.svd(rows[:, moved] / size[moved], compute_uv=False)
        return float((values[0] / max(values[-1], 1e-12)) ** 2)


def _size(x: FloatArray, up: NDArray[np.bool_]) -> float:
    """Return the usual size of a series; where it usually rests, a share of its largest excursion."""
    seen = x[up & np.isfinite(x)]
    largest = float(np.max(np.abs(seen))) if seen.size else 0.0
    return max(usual_deviation(x, up), LEAST * largest) or 1.0


def by_command(
    flights: Mapping[str, Flight], motions: Mapping[str, Motion], found: Sequence[Candidate]
) -> Evidence:
    """Return what windows tell of any vehicle that answers commands and rates linearly.

    All flights have the same commands.
    """
    told = []
    for one in found:
        flight = flights[one.flight]
        rows = motions[one.flight].inside(flight, one)
        told.append(rows.T @ rows / (SPAN * flight.rate))
    size = len(next(iter(motions.values())).names)
    return Evidence(np.eye(size), tuple(told))
