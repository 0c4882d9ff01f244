"""Windows of a flight that could be fitted: complete, airborne, without saturated motors or stuck sensors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, run_slices
from stoop.base.variables import RATES
from stoop.flight import Flight, Maneuver, find_maneuvers
from stoop.flight.airborne import flying
from stoop.vehicle import Vehicle
from stoop.vehicle.schema import Rotor

LENGTHS: Final = (4.0, 8.0)  #: s, of windows that are tried all along the flight
STRIDE: Final = 2.0  #: s from one such window to the next
SHORTEST: Final = 2.0  #: s
MIN_USABLE: Final = 0.6  #: share of a window; pieces between holes are fitted separately
LIMIT_MARGIN: Final = 0.002  #: of its range, within which a command is at its limit
MIN_SATURATED: Final = 5  #: samples in a row at the limit
MAX_LEVELS: Final = 20  #: different values of a switch, which has no limits
LIMITED: Final = ("motor_", "pwm_", "rotor_")  #: outputs that end at full power and at idle
SENSORS: Final = ("p", "q", "r", "ax", "ay", "az", "phi", "theta", "V", "alpha", "beta")


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
        if fault.kind == "stuck" and fault.variable in (*SENSORS, *channels):
            good &= (flight.time < fault.start) | (flight.time > fault.stop)
    return np.asarray(good)


def saturated(x: FloatArray, up: BoolArray) -> BoolArray:
    """Tell where a command (n,) is held by the end of its range while the vehicle flies.

    One that mostly rests at its lower end is off there, as the pusher of a quadplane; one of a few levels is a switch.
    """
    seen = x[up & np.isfinite(x)]
    out = np.zeros(x.size, dtype=bool)
    if np.unique(seen).size <= MAX_LEVELS:
        return out
    near = LIMIT_MARGIN * float(np.ptp(seen))
    ends = [x >= seen.max() - near]
    if np.median(seen) > seen.min() + near:
        ends.append(x <= seen.min() + near)
    for held in ends:
        for run in run_slices(held & up):
            if run.stop - run.start >= MIN_SATURATED:
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
    if last - first < SHORTEST or share < MIN_USABLE:
        return None
    low, high = np.ceil(first * 10.0 - 1e-6) / 10.0, np.floor(last * 10.0 + 1e-6) / 10.0
    return Candidate(flight.name, float(low) + 0.0, float(high), maneuver)  # no -0.0


def _apart(found: Iterable[Candidate]) -> list[Candidate]:
    """Keep the first of windows that are the same."""
    out: dict[tuple[float, float], Candidate] = {}
    for one in found:
        out.setdefault((one.start, one.stop), one)
    return list(out.values())


def with_motors(flight: Flight, vehicle: Vehicle | None) -> Flight:
    """Return a flight with a motor_N (rotor_N where pulses set a speed) for each pulse of a rotor that lifts.

    Motors show when the vehicle is airborne and what was commanded about an axis; pulses alone may be surfaces.
    """
    if vehicle is None or vehicle.file.rotors is None:
        return flight
    kind = "motor" if vehicle.file.rotors.drive == "command" else "rotor"
    if any(str(name).startswith(f"{kind}_") for name in flight.data):
        return flight
    gain, idle = vehicle.value("rotors.gain"), vehicle.value("rotors.idle")
    made = {
        channel.replace("pwm", kind): ("time", np.maximum(gain * (flight.column(channel) - idle), 0.0))
        for channel in dict.fromkeys(rotor.channel for rotor in vehicle.file.rotor.values() if _lifts(rotor))
        if channel.startswith("pwm_") and channel in flight.data
    }
    return replace(flight, data=flight.data.assign(made)) if made else flight


def _lifts(rotor: Rotor) -> bool:
    """Tell whether a rotor pulls up rather than along."""
    if rotor.axis is None:
        return True
    forward, right, down = (number.value for number in rotor.axis)
    return -down > math.hypot(forward, right)
