"""What was commanded about each axis: a channel that says so, or the direction of motors or servos that turns it.

A log without mixed commands has outputs only. Their principal directions are taken (dead and doubled outputs drop
out), and each axis gets the combination of them that goes with its own acceleration, the rates held apart: what an
autopilot does against a rate is no effect of that rate.

Axes: k = sample, m = output, a = axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.base.variables import MOTORS, OUTPUT_PINS, ROTORS, SERVOS
from stoop.flight.aloft import flying, lifting
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
RATES: Final = ("p", "q", "r")
FAMILIES: Final = (("motor", MOTORS), ("servo", SERVOS), ("pwm", OUTPUT_PINS), ("rotor", ROTORS))
SMOOTH, SLOW = 0.2, 5.0  #: s; what is quicker is noise, what is slower is trim
LEAST: Final = 200  #: samples that say anything
SINGULAR: Final = 1e-4  #: of the largest variance; a direction below it was not moved
FOLLOWS: Final = 0.05  #: share of an acceleration's variance that its commands must explain


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


def commands(flight: Flight) -> list[Command]:
    """Return what was commanded: mixed commands or surfaces where there are any, else directions of the outputs."""
    named = {**CONTROLS, **(LIFT if lifting(flight) else {})}
    direct = [
        Command(axis, name, flight.column(name))
        for name, axis in named.items()
        if name in flight.data and _moves(flight.column(name))
    ]
    if any(command.axis != "heave" for command in direct):
        return direct
    for names in families(flight):
        found = directions(flight, names)
        if found:
            return found
    return direct


def families(flight: Flight) -> list[list[str]]:
    """Return the outputs that move, motors first, then servos, pulses and measured rotor speeds."""
    every = ([f"{kind}_{n}" for n in range(1, size + 1)] for kind, size in FAMILIES)
    moving = ([n for n in names if n in flight.data and _moves(flight.column(n))] for names in every)
    return [names for names in moving if len(names) > 1]


def directions(flight: Flight, names: list[str]) -> list[Command]:
    """Combine outputs into one command per axis that they turn."""
    outputs = np.column_stack([flight.column(name) for name in names])
    answers = {axis: flight.column(name) for axis, name in MOTION.items() if name in flight.data}
    if not set(RATES) <= {str(name) for name in flight.data.data_vars}:
        return []
    rates = _banded(np.column_stack([flight.column(name) for name in RATES]), flight.rate)
    x, fly = _banded(outputs, flight.rate), flying(flight)
    accelerations = {axis: _answer(axis, y, flight.rate) for axis, y in answers.items()}
    good = fly & np.isfinite(x).all(axis=1) & np.isfinite(rates).all(axis=1)
    good &= np.isfinite(np.column_stack(list(accelerations.values()))).all(axis=1)
    if good.sum() < LEAST:
        return []
    weights = {axis: _weights(x[good], rates[good], y[good]) for axis, y in accelerations.items()}
    centered = outputs - np.median(outputs[good], axis=0)
    label = names[0] if len(names) == 1 else f"{names[0]}..{names[-1].rpartition('_')[2]}"
    return [Command(axis, label, centered @ w) for axis, w in weights.items() if w is not None]


def _answer(axis: Axis, y: FloatArray, rate: float) -> FloatArray:
    """Return the acceleration (n,) about an axis, or up, without what is quick or slow."""
    banded = _banded(y[:, None], rate)[:, 0]
    return -banded if axis == "heave" else np.asarray(np.gradient(banded) * rate)


def _weights(x: FloatArray, rates: FloatArray, y: FloatArray) -> FloatArray | None:
    """Return the weight of each output (m,) in an acceleration y (k,); None where outputs do not explain it."""
    values, vectors = np.linalg.eigh(x.T @ x)
    basis = vectors[:, values > SINGULAR * values[-1]]
    regressors = np.column_stack([x @ basis, rates])
    found = np.linalg.lstsq(regressors, y, rcond=None)[0]
    weights = np.asarray(basis @ found[: basis.shape[1]])
    explained = float(np.sum((x @ weights) ** 2)) / max(float(y @ y), 1e-300)
    return weights if explained > FOLLOWS else None


def _banded(x: FloatArray, rate: float) -> FloatArray:
    """Return columns (n, m) smoothed, less their slow part; NaN where any of the window is missing."""
    return smoothed(x, round(SMOOTH * rate)) - smoothed(x, round(SLOW * rate), 0.5)


def smoothed(x: FloatArray, width: int, least: float = 1.0) -> FloatArray:
    """Return running means (n, m) over `width` samples, NaN where less than a share of them is there."""
    width = max(1, min(width, len(x)))
    good = np.isfinite(x)
    total = np.cumsum(np.pad(np.where(good, x, 0.0), [(1, 0), (0, 0)]), axis=0)
    count = np.cumsum(np.pad(good.astype(np.float64), [(1, 0), (0, 0)]), axis=0)
    first = np.clip(np.arange(len(x)) - width // 2, 0, len(x))
    last = np.clip(first + width, 0, len(x))
    seen = count[last] - count[first]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (total[last] - total[first]) / seen
    return np.where(seen >= least * (last - first)[:, None], mean, np.nan)


def _moves(x: FloatArray) -> bool:
    seen = x[np.isfinite(x)]
    return bool(seen.size > 1 and np.ptp(seen) > 1e-9 * max(1.0, float(np.abs(seen).max())))


def usual_size(x: FloatArray, mask: npt.NDArray[np.bool_]) -> float:
    """Return the standard deviation of a series (n,) where it is usual: 1.4826 times its median absolute deviation."""
    seen = x[mask & np.isfinite(x)]
    if not seen.size:
        return 0.0
    return 1.4826 * float(np.median(np.abs(seen - np.median(seen))))


def by_axis(found: list[Command]) -> Mapping[Axis, Command]:
    """Return one command per axis, the first of each."""
    out: dict[Axis, Command] = {}
    for command in found:
        out.setdefault(command.axis, command)
    return out
