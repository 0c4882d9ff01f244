"""Stretches of a flight that could be fitted: whole, in the air, off the limits of motors and sensors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, run_slices
from stoop.base.variables import RATES
from stoop.flight import Flight, Maneuver, find_maneuvers
from stoop.flight.airborne import flying

LENGTHS: Final = (4.0, 8.0)  #: s of a window that nothing but its information speaks for
STRIDE: Final = 2.0  #: s from one such window to the next
SHORTEST: Final = 2.0  #: s
WHOLE: Final = 0.6  #: share of a window that must be usable; pieces between holes are fitted apart
NEAR: Final = 0.002  #: of its range, from which a command is at its limit
HELD: Final = 5  #: samples in a row there that make it saturated
LEVELS: Final = 20  #: different values of a command that is set by hand or by a plan, and limited by nothing
LIMITED: Final = ("motor_", "pwm_", "rotor_")  #: outputs that end at full power and at idle
FELT: Final = ("p", "q", "r", "ax", "ay", "az", "phi", "theta", "V", "alpha", "beta")


@dataclass(frozen=True)
class Candidate:
    """A stretch of a flight.

    Attributes
    ----------
    flight : name
    start, stop : s, on the log's own clock
    maneuver : what was found there by its activity, if anything was
    """

    flight: str
    start: float
    stop: float
    maneuver: Maneuver | None = None

    @property
    def seconds(self) -> float:
        """Length."""
        return self.stop - self.start

    def meets(self, other: Candidate) -> bool:
        """Whether they share samples."""
        return self.flight == other.flight and self.start < other.stop and other.start < self.stop


def candidates(flight: Flight, channels: Sequence[str]) -> list[Candidate]:
    """Return maneuvers, and windows of fixed lengths all along, as far as they can be used.

    Parameters
    ----------
    flight : Flight
    channels : commands that must be there
    """
    good = usable(flight, channels)
    maneuvers = [(m.start, m.stop, m) for m in find_maneuvers(flight)]
    every = (*maneuvers, *((a, b, None) for a, b in _tiles(flight, good)))
    found = (_cut(flight, good, *one) for one in every)
    return _apart(one for one in found if one is not None)


def usable(flight: Flight, channels: Sequence[str]) -> BoolArray:
    """Tell at which samples (n,) a window may lie: flying, commands there, nothing stuck or at its limit."""
    good = flying(flight)
    for name in (*channels, *(rate for rate in RATES if rate in flight.data)):
        good &= np.isfinite(flight.column(name))
    for name in channels:
        if name.startswith(LIMITED):
            good &= ~saturated(flight.column(name), flying(flight))
    for fault in flight.faults:
        if fault.kind == "stuck" and fault.variable in (*FELT, *channels):
            good &= (flight.time < fault.start) | (flight.time > fault.stop)
    return np.asarray(good)


def saturated(x: FloatArray, up: BoolArray) -> BoolArray:
    """Tell where a command (n,) is held by the end of its range while the vehicle flies.

    One that mostly rests at its lower end is off there, as the pusher of a quadplane; one of a few levels is a switch.
    """
    seen = x[up & np.isfinite(x)]
    out = np.zeros(x.size, dtype=bool)
    if np.unique(seen).size <= LEVELS:
        return out
    near = NEAR * float(np.ptp(seen))
    ends = [x >= seen.max() - near]
    if np.median(seen) > seen.min() + near:
        ends.append(x <= seen.min() + near)
    for held in ends:
        for run in run_slices(held & up):
            if run.stop - run.start >= HELD:
                out[run] = True
    return out


def _tiles(flight: Flight, good: BoolArray) -> Iterator[tuple[float, float]]:
    if not good.any():
        return
    time = flight.time[good]
    for length in LENGTHS:
        for start in np.arange(float(time[0]), max(float(time[-1]) - length, time[0]) + 1e-6, STRIDE):
            yield float(start), float(start + length)


def _cut(
    flight: Flight, good: BoolArray, start: float, stop: float, maneuver: Maneuver | None
) -> Candidate | None:
    """Cut what cannot be used off the ends; None where too little is left, or too much of it has holes."""
    inside = np.flatnonzero(good & (flight.time >= start - 1e-9) & (flight.time <= stop + 1e-9))
    if not inside.size:
        return None
    first, last = float(flight.time[inside[0]]), float(flight.time[inside[-1]])
    share = inside.size / (inside[-1] - inside[0] + 1)
    if last - first < SHORTEST or share < WHOLE:
        return None
    low, high = np.ceil(first * 10.0 - 1e-6) / 10.0, np.floor(last * 10.0 + 1e-6) / 10.0
    return Candidate(flight.name, float(low) + 0.0, float(high), maneuver)  # no -0.0


def _apart(found: Iterable[Candidate]) -> list[Candidate]:
    """Keep the first of windows that are the same."""
    out: dict[tuple[float, float], Candidate] = {}
    for one in found:
        out.setdefault((one.start, one.stop), one)
    return list(out.values())
