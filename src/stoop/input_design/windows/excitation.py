"""Information of windows without a vehicle: how strongly, and how independently, each axis is excited.

In any model the derivative of a rate depends on the rates and on the commands. The information about its coefficients is
the matrix of products of commands and rates: large where they move, singular where they move together, as in a closed
loop. Each signal is scaled by its usual size in this flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.base.variables import RATES
from stoop.flight import Flight
from stoop.flight.airborne import flying
from stoop.flight.maneuvers import MOTION, Axis, by_axis, commands, moving_average, usual_deviation
from stoop.input_design.windows.candidates import Candidate
from stoop.input_design.windows.selection import CandidateInformation

SMOOTH: Final = 0.2  #: s
SLOW: Final = 5.0  #: s; slower is trim
PRIOR_SPAN: Final = 8.0  #: s of usual flight that count as prior information
MIN_MOTION: Final = 0.05  #: of the strongest signal; weaker ones do not count for the condition number
MIN_USUAL: Final = 0.02  #: of the largest excursion: the least usual size of a signal


@dataclass(frozen=True, eq=False)
class Excitation:
    """Commands and rates of a flight without their slow part, in units of their usual size.

    Attributes
    ----------
    names : tuple of str
    axes : tuple of str
        Of each signal.
    values : (n, m)
        NaN where missing.
    """

    names: tuple[str, ...]
    axes: tuple[Axis, ...]
    values: FloatArray

    def only(self, names: Sequence[str]) -> Excitation:
        """Return some of the signals."""
        kept = [self.names.index(n) for n in names]
        return Excitation(tuple(names), tuple(self.axes[i] for i in kept), self.values[:, kept])

    @classmethod
    def of(cls, flight: Flight) -> Excitation | None:
        """Return those of a flight; None where no command or no rate was recorded."""
        by_command = by_axis(commands(flight))
        rates = {axis: name for axis, name in MOTION.items() if name in RATES and name in flight.data}
        if not by_command or not rates:
            return None
        columns = [*(c.u for c in by_command.values()), *(flight.column(name) for name in rates.values())]
        names = (*(f"{axis} command" for axis in by_command), *(f"{axis} rate" for axis in rates))
        x, up = np.column_stack(columns), flying(flight)
        x = moving_average(x, round(SMOOTH * flight.rate)) - moving_average(x, round(SLOW * flight.rate), 0.3)
        sizes = [_size(column, up) for column in x.T]
        return cls(names, (*by_command, *rates), x / np.array(sizes))

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
        moved = size > MIN_MOTION * float(size.max())
        if not moved.any():
            return float("inf")
        values = np.linalg.svd(rows[:, moved] / size[moved], compute_uv=False)
        return float((values[0] / max(values[-1], 1e-12)) ** 2)


def _size(x: FloatArray, up: NDArray[np.bool_]) -> float:
    """Return the usual size of a series; where it usually rests, a share of its largest excursion."""
    seen = x[up & np.isfinite(x)]
    largest = float(np.max(np.abs(seen))) if seen.size else 0.0
    return max(usual_deviation(x, up), MIN_USUAL * largest) or 1.0


def excitation_information(
    flights: Mapping[str, Flight], excitations: Mapping[str, Excitation], found: Sequence[Candidate]
) -> CandidateInformation:
    """Return the information of windows about any vehicle that responds linearly to commands and rates.

    All flights have the same commands.
    """
    out = []
    for one in found:
        flight = flights[one.flight]
        rows = excitations[one.flight].inside(flight, one)
        out.append(rows.T @ rows / (PRIOR_SPAN * flight.rate))
    size = len(next(iter(excitations.values())).names)
    return CandidateInformation(np.eye(size), tuple(out))
