"""Commands about each axis, candidate maneuvers, and a summary of a flight as `stoop info` shows it.

A maneuver is a window in which one control was commanded far more than it usually is. Commands are those of a pilot or of
an injected signal; what an autopilot answers to a gust is none, and shows by what feedback of the motion explains of it. A log
without mixed commands has outputs only. Their principal directions are taken (dead and doubled outputs drop out), and each
axis gets the combination of them that goes with its own acceleration, with the rates as further regressors: what an autopilot
does against a rate is no effect of that rate.

Axes: k = sample, m = output, a = axis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar, Final, Literal

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, run_slices
from stoop.base.notices import Notice, attempt, notice
from stoop.base.variables import FAMILIES, RATES, VARIABLES
from stoop.flight.airborne import motors_ran

if TYPE_CHECKING:
    from stoop.flight.flight import Flight

Axis = Literal["roll", "pitch", "yaw", "heave"]

CONTROLS: Final[dict[str, Axis]] = {
    "aileron": "roll",
    "elevator": "pitch",
    "rudder": "yaw",
    "control_roll": "roll",
    "control_pitch": "pitch",
    "control_yaw": "yaw",
    "control_throttle": "heave",  # of a vehicle that rotors carry
}
FEEDBACK: Final = (*RATES, "phi", "theta", "vd", "altitude")  #: of which an autopilot makes its commands
AGAINST: Final = ("elevator", "rudder")  #: that turn the vehicle to the other side when they are positive
#: what feedback about an axis opposes; a command with which they go is answered by the vehicle
OPPOSED: Final[dict[Axis, tuple[str, ...]]] = {
    "roll": ("p", "phi"), "pitch": ("q", "theta"), "yaw": ("r",), "heave": (),
}  # fmt: skip
MOTION: Final[dict[Axis, str]] = {"roll": "p", "pitch": "q", "yaw": "r", "heave": "az"}


@dataclass(frozen=True)
class Limits:
    """What a direction of outputs explains, and what a maneuver is."""

    fast: float = 0.2  #: s; what is quicker is noise
    slow: float = 5.0  #: s; what is slower is trim
    samples: int = 200  #: for a direction of outputs
    singular: float = 1e-4  #: of the largest variance; a direction below it was not moved
    explained: float = 0.05  #: share of an acceleration's variance that its commands must explain
    window: float = 2.0  #: s over which the activity of a control is taken
    ratio: float = 4.0  #: of activity over the median of the flight
    min_usual: float = 0.02  #: of the largest activity or excursion: the least usual size of a signal
    pause: float = 1.5  #: s between two bursts that make one maneuver
    lead: float = 0.5  #: s of calm kept before
    tail: float = 1.0  #: s of response kept after
    rest: float = 5.0  #: s beside a burst, from which the position of rest is taken
    swings: int = 2  #: a doublet has two, a 3-2-1-1 four
    hysteresis: float = 0.3  #: of the largest excursion
    #: share of a command's power in a window that feedback leaves over, at least; a maneuver leaves 0.3 and more, an autopilot
    #: in gusts a tenth
    commanded: float = 0.1
    edge: float = 0.5  #: of the threshold of a burst: activity that belongs to it, before and after


LIMITS: Final = Limits()


@dataclass(frozen=True, eq=False)
class Command:
    """What was commanded about one axis."""

    axis: Axis  #: about which (or along which: "heave") it moves the vehicle
    variable: str  #: channel, or first and last of the channels it is combined from
    u: FloatArray  #: (n,) unit of the channel; of a combination, rad/s2 (m/s2 for heave) less a constant; NaN: missing

    @property
    def sense(self) -> float:
        """1 where a positive command turns the vehicle to the positive side, else -1."""
        return -1.0 if self.variable in AGAINST else 1.0


@dataclass(frozen=True)
class FlownManeuver:
    """A window worth fitting."""

    LIMITS: ClassVar = LIMITS
    axis: Axis  #: about which the vehicle was excited
    variable: str  #: control channel that says so, or the outputs whose direction does
    start: float  #: s, on the log's own clock
    stop: float  #: s
    amplitude: float  #: largest excursion from the mean, in the unit of the channel
    swings: int  #: how often the control went to one side
    strength: float  #: activity as a multiple of what is usual in this flight
    whole: float  #: share of the window in which the control was recorded, 0 to 1

    @property
    def window(self) -> str:
        """START:STOP, as the command line takes it."""
        return f"{self.start:g}:{self.stop:g}"


@dataclass(frozen=True)
class ChannelRow:
    """One channel of a flight: what the registry says of it, how it was recorded, and its numbers on the grid."""

    variable: str
    unit: str
    meaning: str
    source: str  #: topic or file it was recorded in
    rate: float  #: Hz, as recorded
    gaps: int  #: number of holes that nothing is interpolated across
    longest_gap: float  #: s
    minimum: float  #: SI
    median: float
    maximum: float
    missing: float  #: share of the grid without a value, 0 to 1


@dataclass(frozen=True)
class FlightSummary:
    """A flight as it is known before a vehicle is."""

    flight: Flight
    rows: tuple[ChannelRow, ...]  #: one per channel, in the order of the registry
    notices: tuple[Notice, ...]  #: those of the flight, and what makes it useless whatever the vehicle

    @cached_property
    def maneuvers(self) -> tuple[FlownManeuver, ...]:
        """Windows in which one control was commanded, of the flight as it was read."""
        return tuple(self.flight.find_maneuvers())


def describe(flight: Flight) -> FlightSummary:
    """Summarize a flight."""
    rows = []
    for name in flight.channels:
        one, source, x = VARIABLES[name], flight.sources[name], flight.column(name)
        finite = x[np.isfinite(x)]
        low, middle, high = np.quantile(finite, [0.0, 0.5, 1.0]).tolist() if finite.size else [np.nan] * 3
        numbers = (source.gaps, source.longest_gap, low, middle, high, 1.0 - finite.size / x.size)
        rows.append(ChannelRow(name, one.unit, one.meaning, source.source, source.rate, *numbers))
    useless: list[Notice] = []
    missing = tuple(n for n in RATES if n not in flight.names or not np.isfinite(flight.column(n)).any())
    if missing:
        useless.append(notice("no-body-rates", variables=missing))
    if not attempt(useless, True, motors_ran, flight):
        useless.append(notice("motors-never-ran"))
    return FlightSummary(flight, tuple(rows), (*flight.notices, *useless))


def commands(flight: Flight) -> list[Command]:
    """Return what was commanded: mixed commands or surfaces where there are any, else directions of the outputs."""
    known = [(axis, name) for name, axis in CONTROLS.items() if name in flight.names]
    known = [(axis, name) for axis, name in known if axis != "heave" or flight.carried_by_rotors()]
    columns = [(axis, name, flight.column(name)) for axis, name in known]
    direct = [Command(axis, name, u) for axis, name, u in columns if moves(u)]
    if any(command.axis != "heave" for command in direct):
        return direct
    combined = (found for names in flight.output_families() if (found := flight.directions(names)))
    return next(combined, direct)


def output_families(flight: Flight) -> list[list[str]]:
    """Return the outputs that move, motors first, then servos, pulses and measured rotor speeds."""
    every = (FAMILIES[kind] for kind in ("motor", "servo", "pwm", "rotor"))
    moving = ([n for n in names if n in flight.names and moves(flight.column(n))] for names in every)
    return [names for names in moving if len(names) > 1]


def moves(x: FloatArray) -> bool:
    """Tell whether a channel changes by more than rounding."""
    known = x[np.isfinite(x)]
    return bool(known.size > 1 and np.ptp(known) > 1e-9 * max(1.0, float(np.abs(known).max())))


def directions(flight: Flight, names: list[str]) -> list[Command]:
    """Combine outputs into one command per axis that they turn, by regression of each acceleration on them."""
    if not set(RATES) <= flight.names:
        return []

    outputs = np.column_stack([flight.column(name) for name in names])
    rates = flight.band_pass(np.column_stack([flight.column(name) for name in RATES]), 0.5)
    x = flight.band_pass(outputs, 0.5)
    accelerations: dict[Axis, FloatArray] = {}
    for axis, name in MOTION.items():
        if name in flight.names:
            y = flight.band_pass(flight.column(name)[:, None], 0.5)[:, 0]
            accelerations[axis] = -y if axis == "heave" else np.asarray(np.gradient(y) * flight.rate)
    good = flight.flying() & np.isfinite(x).all(axis=1) & np.isfinite(rates).all(axis=1)
    good &= np.isfinite(np.column_stack(list(accelerations.values()))).all(axis=1)
    if good.sum() < LIMITS.samples:
        return []
    x, rates = x[good], rates[good]
    values, vectors = np.linalg.eigh(x.T @ x)
    basis = vectors[:, values > LIMITS.singular * values[-1]]
    regressors = np.column_stack([x @ basis, rates])
    centered = outputs - np.median(outputs[good], axis=0)
    label = names[0] if len(names) == 1 else f"{names[0]}..{names[-1].rpartition('_')[2]}"
    out = []
    for axis, acceleration in accelerations.items():
        y = acceleration[good]
        found = np.linalg.lstsq(regressors, y, rcond=None)[0]
        weights = np.asarray(basis @ found[: basis.shape[1]])
        if float(np.sum((x @ weights) ** 2)) / max(float(y @ y), 1e-300) > LIMITS.explained:
            out.append(Command(axis, label, centered @ weights))
    return out


def _running_sums(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the sum and the number (n + 1, m) of the finite ones of the first 0, 1, ... n samples."""
    good = np.isfinite(x)
    total, count = np.zeros((2, len(x) + 1, x.shape[1]))
    np.cumsum(np.where(good, x, 0.0), axis=0, out=total[1:])
    np.cumsum(good, axis=0, out=count[1:])
    return total, count


def _running_means(sums: tuple[FloatArray, FloatArray], width: int, least: float) -> FloatArray:
    """Return the means (n, m) over `width` samples, NaN where less than a share of them is there."""
    size = len(sums[0]) - 1
    width = max(1, min(width, size))
    lead = width // 2  # by which a window begins before its sample; those of the first begin with the record
    last = np.minimum(np.arange(size - lead) + width, size)
    many = least * (last - np.arange(size - lead))[:, None]

    def within(running: FloatArray) -> FloatArray:
        """Return what lies in each window, without the first ones, which are alike."""
        whole = running[width:] - running[: size + 1 - width]
        rest = running[size] - running[size + 1 - width : size - lead]
        return np.concatenate([whole[: size - lead], rest])

    total, known = map(within, sums)
    out = np.empty((size, total.shape[1]))
    with np.errstate(invalid="ignore", divide="ignore"):
        np.divide(total, known, out=out[lead:])
    out[lead:][known < many] = np.nan
    out[:lead] = out[lead : lead + 1]
    return out


def band_pass(flight: Flight, x: FloatArray, least: float = 0.3) -> FloatArray:
    """Return columns (n, m) smoothed, less their slow part; NaN where less than a share of that is there."""
    fast, slow = round(LIMITS.fast * flight.rate), round(LIMITS.slow * flight.rate)
    sums = _running_sums(x)
    out = _running_means(sums, fast, 1.0)
    out -= _running_means(sums, slow, least)
    return out


@dataclass(frozen=True, eq=False)
class Feedback:
    """The motion of a flight (n, k) of which an autopilot makes its commands, as :func:`band_pass` left it, in the air."""

    names: tuple[str, ...]
    motion: FloatArray
    known: BoolArray  #: (n,) complete, airborne

    def taken_off(self, found: Sequence[Command], u: FloatArray) -> FloatArray:
        """Return what it does not explain of commands, of which :func:`band_pass` left (n, m).

        It is the regression on rates, attitude, altitude and its rate at the same instant, over the airborne part, with gains
        that oppose the rate and the attitude about the axis of the command. Where the vehicle follows a command closely (the
        roll rate of a light airplane its ailerons), the rate explains the command as well as any feedback could, with a gain
        of the other sign.
        """
        from scipy.optimize import lsq_linear

        out, good = u.copy(), self.known & np.isfinite(u).all(axis=1)
        if good.sum() >= LIMITS.samples:
            motion = self.motion[good]
            q, r = np.linalg.qr(motion)
            for k, (command, explained) in enumerate(zip(found, (q.T @ u[good]).T, strict=True)):
                low, high = np.full(len(self.names), -np.inf), np.full(len(self.names), np.inf)
                (high if command.sense > 0.0 else low)[np.isin(self.names, OPPOSED[command.axis])] = 0.0
                out[good, k] -= motion @ lsq_linear(r, explained, (low, high), method="bvls").x
        return out


def feedback(flight: Flight, up: BoolArray) -> Feedback:
    """Return the motion of which an autopilot makes its commands, airborne where `up` (n,) says."""
    names = tuple(n for n in FEEDBACK if n in flight.names and np.isfinite(flight.column(n)).any())
    if not names:
        return Feedback((), np.empty((flight.time.size, 0)), np.zeros(flight.time.size, dtype=bool))
    motion = flight.band_pass(np.column_stack([flight.column(name) for name in names]))
    return Feedback(names, motion, up & np.isfinite(motion).all(axis=1))


def find_maneuvers(flight: Flight) -> list[FlownManeuver]:
    """Look for maneuvers in the airborne part of a flight, in order of time; they share no samples.

    Where several controls were moved at a time (a mixed command, or crosstalk), the most unusual one names
    the axis.
    """
    up = flight.flying()
    motion = flight.feedback(up)
    found = [m for command in flight.commands() for m in _bursts(flight, command, up, motion)]
    kept: list[FlownManeuver] = []
    for one in sorted(found, key=lambda m: -m.strength):
        shared = [max(min(one.stop, m.stop) - max(one.start, m.start), 0.0) for m in kept]
        shortest = [min(one.stop - one.start, m.stop - m.start) for m in kept]
        if all(part / least < 0.5 for part, least in zip(shared, shortest, strict=True)):
            kept.append(one)
    return apart(sorted(kept, key=lambda m: m.start))


def apart(found: Sequence[FlownManeuver]) -> list[FlownManeuver]:
    """Return maneuvers in order of time that share no samples: the weaker of two is cut, but not into its input."""
    out = list(found)
    for i, (one, following) in enumerate(pairwise(found)):
        if following.start < one.stop:
            first, last = following.start, one.stop
            yields = one.strength < following.strength
            cut = max(first, last - LIMITS.tail) if yields else min(last, first + LIMITS.lead)
            out[i : i + 2] = [replace(out[i], stop=cut), replace(following, start=cut)]
    return out


def _bursts(flight: Flight, command: Command, up: BoolArray, feedback: Feedback) -> Iterator[FlownManeuver]:
    """Yield the bursts of one control that swing to both sides."""
    u, width = command.u, max(round(LIMITS.window * flight.rate), 1)
    # activity: the running standard deviation over the samples that are there
    good = np.isfinite(u).astype(np.float64)
    x = np.where(good > 0.0, u - np.nanmean(u) if good.any() else 0.0, 0.0)
    box = np.ones(width)
    count, total, square = (np.convolve(series, box, mode="same")[: u.size] for series in (good, x, x * x))
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = square / count - (total / count) ** 2
    activity = np.where(count > 0.25 * width, np.sqrt(np.maximum(variance, 0.0)), np.nan)
    in_flight = activity[up & np.isfinite(activity)]
    if not in_flight.size or in_flight.max() == 0.0:
        return
    usual = max(float(np.median(in_flight)), LIMITS.min_usual * float(in_flight.max()))
    threshold = LIMITS.ratio * usual
    bursts: list[slice] = []
    active = np.nan_to_num(activity)
    for run in run_slices(up & (active > LIMITS.edge * threshold) & np.isfinite(u)):
        if active[run].max() <= threshold:
            continue
        if bursts and run.start - bursts[-1].stop < round(LIMITS.pause * flight.rate):
            bursts[-1] = slice(bursts[-1].start, run.stop)
        else:
            bursts.append(run)
    if not bursts:
        return
    around = round(LIMITS.rest * flight.rate)
    moved = flight.band_pass(u[:, None])
    own = feedback.taken_off([command], moved)
    first, last = float(flight.time[0]), float(flight.time[-1])
    for run in bursts:
        # the window is narrowed to where the control moves
        rest = float(np.nanmedian(u[max(run.start - around, 0) : run.stop + around]))
        t, swing = flight.time[run], u[run] - rest
        amplitude = float(np.nanmax(np.abs(swing)))
        moving = np.flatnonzero(np.nan_to_num(np.abs(swing)) > LIMITS.hysteresis * amplitude)
        swings = int(np.count_nonzero(np.diff(np.sign(swing[moving])))) + 1
        left, whole_power = (float(np.nansum(series[run] ** 2)) for series in (own, moved))
        if swings < LIMITS.swings or left < LIMITS.commanded * whole_power:
            continue
        start = np.ceil(max(float(t[moving[0]]) - LIMITS.lead, first) * 10.0 - 1.0) / 10.0
        stop = np.floor(min(float(t[moving[-1]]) + LIMITS.tail, last) * 10.0 + 1.0) / 10.0
        whole = float(np.mean(np.isfinite(u[flight.between(float(start), float(stop))])))
        strength = float(np.nanmax(activity[run])) / usual
        begin = float(max(start, first)) + 0.0  # no -0.0
        found = amplitude, swings, strength, whole
        yield FlownManeuver(command.axis, command.variable, begin, float(stop), *found)
