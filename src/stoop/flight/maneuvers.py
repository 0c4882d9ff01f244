"""Candidate maneuvers: windows in which one control moved to and fro far more than it usually does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.flight.aloft import airborne, flying
from stoop.flight.commands import Axis, Command, commands
from stoop.flight.flight import Flight
from stoop.flight.segments import runs

__all__ = ["Axis", "Maneuver", "airborne", "find_maneuvers"]

WINDOW: Final = 2.0  #: s over which the activity of a control is judged
USUAL: Final = 4.0  #: times the median activity of the flight that is out of the usual
STRONGEST: Final = 0.25  #: of the strongest activity of this control
JOIN: Final = 1.5  #: s between two bursts that make one maneuver
LEAD, TAIL = 0.5, 1.0  #: s of calm kept before, and of response after
CALM: Final = 5.0  #: s beside a burst, from which the position of rest is taken
SWINGS: Final = 2  #: a doublet has two, a 3-2-1-1 four
HYSTERESIS: Final = 0.3  #: of the largest excursion


@dataclass(frozen=True)
class Maneuver:
    """A window worth fitting.

    Attributes
    ----------
    axis : about which the vehicle was excited
    variable : control channel that says so, or the outputs whose direction does
    start, stop : s, on the log's own clock
    amplitude : largest excursion from the mean, in the unit of the channel
    swings : how often the control went to one side
    strength : activity as a multiple of what is usual in this flight
    whole : share of the window in which the control was recorded, 0 to 1
    """

    axis: Axis
    variable: str
    start: float
    stop: float
    amplitude: float
    swings: int
    strength: float
    whole: float

    @property
    def window(self) -> str:
        """START:STOP, as the command line takes it."""
        return f"{self.start:g}:{self.stop:g}"


def find_maneuvers(flight: Flight) -> list[Maneuver]:
    """Look for maneuvers in the airborne part of a flight, in order of time.

    Where several controls were moved at a time (a mixed command, or crosstalk), the most unusual one names
    the axis.
    """
    up = flying(flight)
    found = [m for command in commands(flight) for m in _in_control(flight, command, up)]
    found.sort(key=lambda m: -m.strength)
    kept: list[Maneuver] = []
    for candidate in found:
        if all(_overlap(candidate, other) < 0.5 for other in kept):
            kept.append(candidate)
    return sorted(kept, key=lambda m: m.start)


def _in_control(flight: Flight, command: Command, up: npt.NDArray[np.bool_]) -> Iterator[Maneuver]:
    u = command.u
    activity = _activity(u, round(WINDOW * flight.rate))
    judged = activity[up & np.isfinite(activity)]
    if not judged.size or judged.max() == 0.0:
        return
    usual = float(np.median(judged))
    threshold = max(USUAL * usual, STRONGEST * float(judged.max()))
    busy = up & (np.nan_to_num(activity) > threshold)
    busy &= np.isfinite(u)
    for run in _joined(runs(busy), round(JOIN * flight.rate)):
        maneuver = _judged(
            flight, command, run, float(np.nanmax(activity[run])) / max(usual, 1e-3 * threshold)
        )
        if maneuver.swings >= SWINGS:
            yield maneuver


def _activity(u: FloatArray, width: int) -> FloatArray:
    """Return the running standard deviation over the samples that are there."""
    good = np.isfinite(u).astype(np.float64)
    x = np.where(good > 0.0, u - np.nanmean(u) if good.any() else 0.0, 0.0)
    box = np.ones(width)
    count, total, square = (np.convolve(series, box, mode="same")[: u.size] for series in (good, x, x * x))
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = square / count - (total / count) ** 2
    return np.where(count > 0.25 * width, np.sqrt(np.maximum(variance, 0.0)), np.nan)


def _joined(pieces: list[slice], nearest: int) -> list[slice]:
    joined: list[slice] = []
    for piece in pieces:
        if joined and piece.start - joined[-1].stop < nearest:
            joined[-1] = slice(joined[-1].start, piece.stop)
        else:
            joined.append(piece)
    return joined


def _judged(flight: Flight, command: Command, run: slice, strength: float) -> Maneuver:
    """Narrow the window to where the control moves, and count its swings."""
    t, u = flight.time[run], command.u[run]
    around = round(CALM * flight.rate)
    calm = float(np.nanmedian(command.u[max(run.start - around, 0) : run.stop + around]))
    swing = u - calm
    amplitude = float(np.nanmax(np.abs(swing)))
    moving = np.flatnonzero(np.nan_to_num(np.abs(swing)) > HYSTERESIS * amplitude)
    start = max(float(t[moving[0]]) - LEAD, float(flight.time[0]))
    stop = min(float(t[moving[-1]]) + TAIL, float(flight.time[-1]))
    start, stop = np.ceil(start * 10.0 - 1.0) / 10.0, np.floor(stop * 10.0 + 1.0) / 10.0
    inside = (flight.time >= start) & (flight.time <= stop)
    whole = float(np.mean(np.isfinite(command.u[inside])))
    swings = int(np.count_nonzero(np.diff(np.sign(swing[moving])))) + 1
    begin = float(max(start, flight.time[0])) + 0.0  # no -0.0
    return Maneuver(command.axis, command.variable, begin, float(stop), amplitude, swings, strength, whole)


def _overlap(a: Maneuver, b: Maneuver) -> float:
    shared = min(a.stop, b.stop) - max(a.start, b.start)
    return max(shared, 0.0) / min(a.stop - a.start, b.stop - b.start)
