"""Commands about each axis, and candidate maneuvers: windows in which one control moved far more than it usually does.

A log without mixed commands has outputs only. Their principal directions are taken (dead and doubled outputs drop
out), and each axis gets the combination of them that goes with its own acceleration, with the rates as further
regressors: what an autopilot does against a rate is no effect of that rate.

Axes: k = sample, m = output, a = axis.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, run_slices
from stoop.base.robust import robust_std
from stoop.base.variables import MOTORS, OUTPUT_PINS, RATES, ROTORS, SERVOS
from stoop.flight.airborne import carried_by_rotors, flying
from stoop.flight.flight import Flight

Axis = Literal["roll", "pitch", "yaw", "heave"]

CONTROLS: Final[dict[str, Axis]] = {
    "aileron": "roll",
    "elevator": "pitch",
    "rudder": "yaw",
    "control_roll": "roll",
    "control_pitch": "pitch",
    "control_yaw": "yaw",
}
LIFT: Final[dict[str, Axis]] = {"control_throttle": "heave"}  #: of a vehicle that rotors carry
MOTION: Final[dict[Axis, str]] = {"roll": "p", "pitch": "q", "yaw": "r", "heave": "az"}
FAMILIES: Final = (("motor", MOTORS), ("servo", SERVOS), ("pwm", OUTPUT_PINS), ("rotor", ROTORS))
FAST, SLOW = 0.2, 5.0  #: s; what is quicker is noise, what is slower is trim
MIN_SAMPLES: Final = 200  #: for a direction of outputs
SINGULAR_SHARE: Final = 1e-4  #: of the largest variance; a direction below it was not moved
MIN_EXPLAINED: Final = 0.05  #: share of an acceleration's variance that its commands must explain

ACTIVITY_WINDOW: Final = 2.0  #: s over which the activity of a control is taken
ACTIVITY_RATIO: Final = 4.0  #: over the median activity of the flight
ACTIVITY_SHARE: Final = 0.25  #: of the strongest activity of this control
MAX_PAUSE: Final = 1.5  #: s between two bursts that make one maneuver
LEAD, TAIL = 0.5, 1.0  #: s of calm kept before, and of response after
REST_TIME: Final = 5.0  #: s beside a burst, from which the position of rest is taken
MIN_SWINGS: Final = 2  #: a doublet has two, a 3-2-1-1 four
HYSTERESIS: Final = 0.3  #: of the largest excursion


@dataclass(frozen=True, eq=False)
class Command:
    """What was commanded about one axis.

    Attributes
    ----------
    axis : about which (or along which: "heave") it moves the vehicle
    variable : channel, or first and last of the channels it is combined from
    u : (n,) in the unit of the channel; of a combination, rad/s2 (m/s2 for heave) less a constant; NaN where missing
    """

    axis: Axis
    variable: str
    u: FloatArray


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


def commands(flight: Flight) -> list[Command]:
    """Return what was commanded: mixed commands or surfaces where there are any, else directions of the outputs."""
    named = {**CONTROLS, **(LIFT if carried_by_rotors(flight) else {})}
    direct = [
        Command(axis, name, flight.column(name))
        for name, axis in named.items()
        if name in flight.data and _moves(flight.column(name))
    ]
    if any(command.axis != "heave" for command in direct):
        return direct
    combined = (found for names in output_families(flight) if (found := directions(flight, names)))
    return next(combined, direct)


def by_axis(found: list[Command]) -> Mapping[Axis, Command]:
    """Return one command per axis, the first of each."""
    out: dict[Axis, Command] = {}
    for command in found:
        out.setdefault(command.axis, command)
    return out


def output_families(flight: Flight) -> list[list[str]]:
    """Return the outputs that move, motors first, then servos, pulses and measured rotor speeds."""
    every = ([f"{kind}_{n}" for n in range(1, size + 1)] for kind, size in FAMILIES)
    moving = ([n for n in names if n in flight.data and _moves(flight.column(n))] for names in every)
    return [names for names in moving if len(names) > 1]


def _moves(x: FloatArray) -> bool:
    known = x[np.isfinite(x)]
    return bool(known.size > 1 and np.ptp(known) > 1e-9 * max(1.0, float(np.abs(known).max())))


def directions(flight: Flight, names: list[str]) -> list[Command]:
    """Combine outputs into one command per axis that they turn, by regression of each acceleration on them."""
    if not set(RATES) <= flight.names:
        return []
    outputs = np.column_stack([flight.column(name) for name in names])
    rates = _band_pass(np.column_stack([flight.column(name) for name in RATES]), flight.rate)
    x = _band_pass(outputs, flight.rate)
    accelerations: dict[Axis, FloatArray] = {}
    for axis, name in MOTION.items():
        if name in flight.data:
            y = _band_pass(flight.column(name)[:, None], flight.rate)[:, 0]
            accelerations[axis] = -y if axis == "heave" else np.asarray(np.gradient(y) * flight.rate)
    good = flying(flight) & np.isfinite(x).all(axis=1) & np.isfinite(rates).all(axis=1)
    good &= np.isfinite(np.column_stack(list(accelerations.values()))).all(axis=1)
    if good.sum() < MIN_SAMPLES:
        return []
    centered = outputs - np.median(outputs[good], axis=0)
    label = names[0] if len(names) == 1 else f"{names[0]}..{names[-1].rpartition('_')[2]}"
    weights = {axis: _weights(x[good], rates[good], y[good]) for axis, y in accelerations.items()}
    return [Command(axis, label, centered @ w) for axis, w in weights.items() if w is not None]


def _weights(x: FloatArray, rates: FloatArray, y: FloatArray) -> FloatArray | None:
    """Return the weight of each output (m,) in an acceleration y (k,); None where outputs do not explain it."""
    values, vectors = np.linalg.eigh(x.T @ x)
    basis = vectors[:, values > SINGULAR_SHARE * values[-1]]
    regressors = np.column_stack([x @ basis, rates])
    found = np.linalg.lstsq(regressors, y, rcond=None)[0]
    weights = np.asarray(basis @ found[: basis.shape[1]])
    explained = float(np.sum((x @ weights) ** 2)) / max(float(y @ y), 1e-300)
    return weights if explained > MIN_EXPLAINED else None


def _band_pass(x: FloatArray, rate: float) -> FloatArray:
    """Return columns (n, m) smoothed, less their slow part; NaN where any of the window is missing."""
    return moving_average(x, round(FAST * rate)) - moving_average(x, round(SLOW * rate), 0.5)


def moving_average(x: FloatArray, width: int, least: float = 1.0) -> FloatArray:
    """Return running means (n, m) over `width` samples, NaN where less than a share of them is there."""
    width = max(1, min(width, len(x)))
    good = np.isfinite(x)
    total = np.cumsum(np.pad(np.where(good, x, 0.0), [(1, 0), (0, 0)]), axis=0)
    count = np.cumsum(np.pad(good.astype(np.float64), [(1, 0), (0, 0)]), axis=0)
    first = np.clip(np.arange(len(x)) - width // 2, 0, len(x))
    last = np.clip(first + width, 0, len(x))
    known = count[last] - count[first]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (total[last] - total[first]) / known
    return np.where(known >= least * (last - first)[:, None], mean, np.nan)


def usual_deviation(x: FloatArray, mask: BoolArray) -> float:
    """Return the robust standard deviation of a series (n,) about its median where a mask holds; 0 without samples."""
    known = x[mask & np.isfinite(x)]
    return robust_std(known - np.median(known)) if known.size else 0.0


def find_maneuvers(flight: Flight) -> list[Maneuver]:
    """Look for maneuvers in the airborne part of a flight, in order of time.

    Where several controls were moved at a time (a mixed command, or crosstalk), the most unusual one names
    the axis.
    """
    up = flying(flight)
    found = [m for command in commands(flight) for m in _bursts(flight, command, up)]
    found.sort(key=lambda m: -m.strength)
    kept: list[Maneuver] = []
    for candidate in found:
        if all(_overlap(candidate, other) < 0.5 for other in kept):
            kept.append(candidate)
    return sorted(kept, key=lambda m: m.start)


def _overlap(a: Maneuver, b: Maneuver) -> float:
    shared = min(a.stop, b.stop) - max(a.start, b.start)
    return max(shared, 0.0) / min(a.stop - a.start, b.stop - b.start)


def _bursts(flight: Flight, command: Command, up: BoolArray) -> Iterator[Maneuver]:
    """Yield the bursts of one control that swing to both sides."""
    u = command.u
    activity = _activity(u, round(ACTIVITY_WINDOW * flight.rate))
    in_flight = activity[up & np.isfinite(activity)]
    if not in_flight.size or in_flight.max() == 0.0:
        return
    usual = float(np.median(in_flight))
    threshold = max(ACTIVITY_RATIO * usual, ACTIVITY_SHARE * float(in_flight.max()))
    busy = up & (np.nan_to_num(activity) > threshold) & np.isfinite(u)
    bursts: list[slice] = []
    for run in run_slices(busy):
        if bursts and run.start - bursts[-1].stop < round(MAX_PAUSE * flight.rate):
            bursts[-1] = slice(bursts[-1].start, run.stop)
        else:
            bursts.append(run)
    for burst in bursts:
        strength = float(np.nanmax(activity[burst])) / max(usual, 1e-3 * threshold)
        maneuver = _maneuver(flight, command, burst, strength)
        if maneuver.swings >= MIN_SWINGS:
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


def _maneuver(flight: Flight, command: Command, run: slice, strength: float) -> Maneuver:
    """Narrow the window to where the control moves, and count its swings."""
    t, u = flight.time[run], command.u[run]
    around = round(REST_TIME * flight.rate)
    swing = u - float(np.nanmedian(command.u[max(run.start - around, 0) : run.stop + around]))
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
