"""Windows of a flight that could be fitted, and what is excited in them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop import Flight
from stoop.extend import flights
from stoop.extend.arrays import BoolArray, FloatArray, robust_std, run_slices
from stoop.extend.variables import FAMILIES

if TYPE_CHECKING:
    from stoop import Vehicle
    from stoop.extend.flights import Window

MANEUVER: Final = flights.FlownManeuver.LIMITS
LENGTHS: Final = (4.0, 8.0)  #: s, of windows that are tried all along the flight


@dataclass(frozen=True)
class CandidateLimits:
    """Lengths and thresholds of the windows that are tried."""

    stride: float = 2.0  #: s from one such window to the next
    shortest: float = MANEUVER.lead + MANEUVER.tail  #: s, those of a maneuver about its input
    min_usable: float = 0.6  #: share of a window; pieces between holes are fitted separately
    limit_margin: float = 0.002  #: of its range, within which a command is at its limit
    min_saturated: int = 5  #: samples in a row at the limit
    max_levels: int = 20  #: different values of a switch, which has no limits
    min_motion: float = 0.05  #: of the strongest signal; weaker ones do not count for the condition number
    min_excitation: float = 2.0  #: times the usual; a command that moves less is none
    #: share of a command's power that feedback leaves over, and of the acceleration that this explains, where a log is too
    #: short to show what is usual; multisines and sweeps leave 0.4 and explain 0.3, gusts under an autopilot leave 0.13 at most
    moved: float = 0.25


LIMITS: Final = CandidateLimits()

LIMITED: Final = ("motor_", "pwm_", "rotor_")  #: outputs that end at full power and at idle
SENSORS: Final = ("p", "q", "r", "ax", "ay", "az", "phi", "theta", "V", "alpha", "beta")


@dataclass(frozen=True)
class Candidate:
    """A stretch of a flight, s on the log's own clock, and the maneuver that its activity shows there, if any."""

    flight: str
    start: float
    stop: float
    maneuver: flights.FlownManeuver | None = None

    @property
    def seconds(self) -> float:
        """Length."""
        return self.stop - self.start

    @property
    def window(self) -> Window:
        """The same as a window to fit."""
        from stoop.extend.flights import Window

        return Window(self.flight, self.start, self.stop)

    def meets(self, other: Candidate) -> bool:
        """Whether they share samples."""
        return self.flight == other.flight and self.start < other.stop and other.start < self.stop


def candidates(flight: Flight, channels: Sequence[str]) -> list[Candidate]:
    """Return maneuvers, and windows of fixed lengths all along, without unusable ends; ``channels`` must be recorded.

    Windows that are too short, or have too many holes, are left out.
    """
    good, time = usable(flight, channels), flight.time
    spans: list[tuple[float, float, flights.FlownManeuver | None]] = [
        (m.start, m.stop, m) for m in flight.find_maneuvers()
    ]
    if good.any():
        first, last = float(time[good][0]), float(time[good][-1])
        for length in LENGTHS:
            tiles = np.arange(first, max(last - length, first) + 1e-6, LIMITS.stride)
            spans += [(float(start), float(start + length), None) for start in tiles]
    out: dict[tuple[float, float], Candidate] = {}
    for start, stop, maneuver in spans:
        part = flight.between(start - 1e-9, stop + 1e-9)
        inside = part.start + np.flatnonzero(good[part])
        if not inside.size:
            continue
        first, last = float(time[inside[0]]), float(time[inside[-1]])
        if last - first < LIMITS.shortest or inside.size / (inside[-1] - inside[0] + 1) < LIMITS.min_usable:
            continue
        low, high = np.ceil(first * 10.0 - 1e-6) / 10.0, np.floor(last * 10.0 + 1e-6) / 10.0
        low, high = float(low) + 0.0, float(high)  # no -0.0
        out.setdefault((low, high), Candidate(flight.name, low, high, maneuver))
    return list(out.values())


def usable(flight: Flight, channels: Sequence[str]) -> BoolArray:
    """Tell at which samples (n,) a window may lie: flying, commands there, nothing stuck or at its limit."""
    up = flight.flying()
    good = up.copy()
    for name in (*channels, *(rate for rate in FAMILIES["rates"] if rate in flight.names)):
        good &= np.isfinite(flight.column(name))
    for name in channels:
        if name.startswith(LIMITED):
            good &= ~saturated(flight.column(name), up)
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
    if np.unique(seen).size <= LIMITS.max_levels:
        return out
    near = LIMITS.limit_margin * float(np.ptp(seen))
    ends = [x >= seen.max() - near]
    if np.median(seen) > seen.min() + near:
        ends.append(x <= seen.min() + near)
    for held in ends:
        for run in run_slices(held & up):
            if run.stop - run.start >= LIMITS.min_saturated:
                out[run] = True
    return out


def with_motors(flight: Flight, vehicle: Vehicle | None) -> Flight:
    """Return a flight with a motor_N (rotor_N where pulses set a speed) for each pulse of a rotor that lifts.

    Motors show when the vehicle is airborne and what was commanded about an axis; pulses alone may be surfaces.
    """
    if vehicle is None:
        return flight
    kind = {"command": "motor"}.get(vehicle.drive, "rotor")
    if any(str(name).startswith(f"{kind}_") for name in flight.names):
        return flight
    made = {}
    for rotor in vehicle.file.rotor.values():
        forward, right, down = (
            (0.0, 0.0, -1.0) if rotor.axis is None else (number.value for number in rotor.axis)
        )
        lifts, channel = -down > math.hypot(forward, right), rotor.channel
        if lifts and channel.startswith("pwm_") and channel in flight.names:
            gain, idle = vehicle.value("rotors.gain"), vehicle.value("rotors.idle")
            command = np.maximum(gain * (flight.column(channel) - idle), 0.0)
            made[channel.replace("pwm", kind)] = ("time", command)
    return replace(flight, data=flight.data.assign(made)) if made else flight


@dataclass(frozen=True, eq=False)
class Excitation:
    """Commands and rates (n, m) of a flight, by name and axis, without their slow part, in units of their usual size.

    ``own`` (n, c) is what feedback of the motion does not explain of the c commands, which come first, in the same units.

    Without a vehicle they stand for information: in any model the derivative of a rate depends on the rates and on the
    commands, and the information about its coefficients is the matrix of products of commands and rates: large where they
    move, singular where they move together, as in a closed loop.
    """

    names: tuple[str, ...]
    axes: tuple[str, ...]
    values: FloatArray
    own: FloatArray

    def only(self, names: Sequence[str]) -> Excitation:
        """Return some of the signals."""
        kept = [self.names.index(n) for n in names]
        own = self.own[:, [i for i in kept if i < self.own.shape[1]]]
        return Excitation(tuple(names), tuple(self.axes[i] for i in kept), self.values[:, kept], own)

    @classmethod
    def of(cls, flight: Flight) -> Excitation | None:
        """Return those of a flight; None where no command or no rate was recorded."""
        by_command: dict[str, Any] = {}
        for command in flight.commands():
            by_command.setdefault(command.axis, command)
        pairs = zip(("roll", "pitch", "yaw"), FAMILIES["rates"], strict=True)
        rates = {axis: name for axis, name in pairs if name in flight.names}
        if not by_command or not rates:
            return None
        columns = [*(c.u for c in by_command.values()), *(flight.column(name) for name in rates.values())]
        names = (*(f"{axis} command" for axis in by_command), *(f"{axis} rate" for axis in rates))
        x, up = np.column_stack(columns), flight.flying()
        x = flight.band_pass(x)
        sizes = []
        for column in x.T:  # where a signal usually rests, a share of its largest excursion
            seen = column[up & np.isfinite(column)]
            largest = float(np.max(np.abs(seen))) if seen.size else 0.0
            sizes.append(max(usual_deviation(column, up), MANEUVER.min_usual * largest) or 1.0)
        x = x / np.array(sizes)
        own = flight.feedback(up).taken_off([*by_command.values()], x[:, : len(by_command)])
        return cls(names, (*by_command, *rates), x, own)

    def inside(self, flight: Flight, one: Candidate) -> FloatArray:
        """Return the complete samples (k, m) of a window, about their mean."""
        rows = self.values[flight.between(one.start, one.stop)]
        rows = rows[np.isfinite(rows).all(axis=1)]
        return rows - rows.mean(axis=0) if len(rows) else rows

    def strengths(self, flight: Flight, one: Candidate) -> Mapping[str, float]:
        """Return how many times the usual the command of each axis moves in a window."""
        rows = self.inside(flight, one)
        sizes = np.sqrt(np.mean(rows**2, axis=0)) if len(rows) else np.zeros(len(self.names))
        pairs = zip(self.axes, self.names, sizes, strict=True)
        return {axis: float(size) for axis, name, size in pairs if name.endswith("command")}

    def commanded(self, flight: Flight, one: Candidate) -> dict[str, float]:
        """Return how many times the usual each command moves in a window that stands out there, and is no feedback's."""
        inside = flight.between(one.start, one.stop)
        moved, own = (np.nansum(x[inside] ** 2, axis=0) for x in (self.values, self.own))
        sizes = self.strengths(flight, one)
        shares = zip(self.axes, moved, own, strict=False)
        real = {a for a, power, left in shares if left >= MANEUVER.commanded * power > 0.0}
        return {a: size for a, size in sizes.items() if a in real and size > LIMITS.min_excitation}

    def moves(self, flight: Flight) -> bool:
        """Tell whether feedback leaves a good part of the command about an axis, which explains the angular acceleration.

        Combinations of outputs are made by such a regression: that they explain an acceleration proves nothing.
        """
        if not any(command.variable in flight.names for command in flight.commands()):
            return False
        count, out = self.own.shape[1], False
        rates = self.values[:, count:]
        changes = np.gradient(rates, axis=0)
        good = flight.flying() & np.isfinite(np.column_stack([self.own, rates, changes])).all(axis=1)
        if good.sum() < MANEUVER.samples:
            return False
        for k, axis in enumerate(self.axes[count:]):
            columns = [i for i in range(count) if self.axes[i] == axis]
            y = changes[good, k]
            x = np.column_stack([self.own[good][:, columns], rates[good]])
            part = x[:, : len(columns)] @ np.linalg.lstsq(x, y, rcond=None)[0][: len(columns)]
            left, every = (float(np.sum(u[good][:, columns] ** 2)) for u in (self.own, self.values))
            out |= bool(left > LIMITS.moved * every and part @ part > LIMITS.moved * float(y @ y))
        return out

    def condition(self, flight: Flight, one: Candidate) -> float:
        """Return the condition number of the correlations of commands and rates: 1 is independent."""
        rows = self.inside(flight, one)
        if len(rows) <= len(self.names):
            return float("inf")
        size = np.sqrt(np.sum(rows**2, axis=0))
        moved = size > LIMITS.min_motion * float(size.max())
        if not moved.any():
            return float("inf")
        values = np.linalg.svd(rows[:, moved] / size[moved], compute_uv=False)
        return float((values[0] / max(values[-1], 1e-12)) ** 2)


def usual_deviation(x: FloatArray, mask: BoolArray) -> float:
    """Return the robust standard deviation of a series (n,) about its median where a mask holds; 0 without samples."""
    known = x[mask & np.isfinite(x)]
    return robust_std(known - np.median(known)) if known.size else 0.0
