"""Whether a vehicle turns as its motors are told: exchanged channels, a wrong spin, a command with its sign lost.

The motors' commands, through delay and lag, go into the file's moments per inertia, and these are held against the
measured angular accelerations, band-passed alike. Beside the file stand its neighbors: any two channels exchanged,
any one spin turned around, any one command inverted. One positive gain per axis is free, for thrust and inertia are not
known yet; so is a constant. A neighbor that explains far more than the file is said, with the line to change.

Axes: k = sample, m = channel, a = axis (roll, pitch, yaw).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray, run_slices
from stoop.base.variables import RATES
from stoop.estimate.regression.aircraft import first_order_lag
from stoop.flight import Flight
from stoop.flight.airborne import flying
from stoop.problem.windows import Window, within
from stoop.simulate.delays import delayed
from stoop.simulate.rotors import Range, channel_range, effects
from stoop.vehicle import Vehicle

BANDS: Final = (
    (0.3, 5.0),
    (0.3, 5.0),
    (0.15, 2.0),
)  #: Hz, by axis: slower is the air's doing, quicker is noise
ORDER: Final = 2  #: of the Butterworth filter, which runs forward and backward
LEAST: Final = 2.0  #: s of a stretch without a hole
ENOUGH: Final = 0.6  #: share of an angular acceleration that a neighbor explains, to be believed
MARGIN: Final = 0.1  #: by which it explains more than the file
LEFT: Final = 0.5  #: of what the file leaves unexplained, at most, that it leaves
CERTAIN: Final = 25.0  #: twice the logarithm of the likelihood ratio, five sigma
LOUD: Final = (
    4.0  #: times the noise's power: an axis that moves; motors answer to noise as well, the wrong way round
)
NEAR: Final = 0.03  #: below the best share, where another is as good
MOST: Final = 3  #: neighbors that are named
AXES: Final = ("roll", "pitch", "yaw")
_WHOLE: Final = (
    "y of position of all rotors (or p in the mapping) looks to have the wrong sign",
    "x of position of all rotors (or q in the mapping) looks to have the wrong sign",
    "spin of all rotors (or r in the mapping) looks to have the wrong sign",
)
_TORQUE: Final = ("torque_ratio", "Q0", "Q1", "Q2")


@dataclass(frozen=True, eq=False)
class Gram:
    """Inner products of commands and angular accelerations of all windows.

    Attributes
    ----------
    commands : (a, m, m)
    both : (a, m)
    turning : (a,)
    noise : (a,)
        What the noise of the rates has of `turning`.
    seconds : float
    """

    commands: FloatArray
    both: FloatArray
    turning: FloatArray
    noise: FloatArray
    seconds: float

    def shares(self, moments: FloatArray) -> FloatArray:
        """Return the share of each axis (a,) that moments per command (a, m) explain; none of an axis that is still."""
        along = np.einsum("am,am->a", moments, self.both)
        size = np.einsum("am,amn,an->a", moments, self.commands, moments) * self.turning
        told = (size > 0.0) & (self.turning > LOUD * self.noise)
        return np.asarray(np.maximum(along, 0.0) ** 2 / np.where(told, size, np.inf))


@dataclass(frozen=True, eq=False)
class Neighbor:
    """A vehicle that differs from the file in one respect.

    Attributes
    ----------
    words : what is wrong then, with the line to change
    moments : (a, m)
    """

    words: str
    moments: FloatArray


def swapped_motors(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> list[str]:
    """Say in words which motors hardly are what the file of a vehicle that hovers says; most often nothing."""
    if not vehicle.rotors:
        return []
    area = channel_range(vehicle)
    out = []
    for name in dict.fromkeys(w.flight for w in windows):
        own = [w for w in windows if w.flight == name]
        gram = _gram(vehicle, flights[name], own, area)
        if gram is not None:
            said = _told(vehicle, flights[name], gram, area)
            out += [f"{name}: {said}"] if said else []
    return out


def _told(vehicle: Vehicle, flight: Flight, gram: Gram, area: Range) -> str:
    """Name the neighbors that explain far more than the file; nothing where none does."""
    level = _level(vehicle, flight)
    whole = effects(vehicle, {}, level, {})[:3]
    before = gram.shares(whole)
    found = [(gram.shares(n.moments), n.words) for n in _neighbors(vehicle, level, whole, area)]
    better = [one for one in found if is_better(one[0], before, gram.seconds)]
    if not better:
        return ""
    best = max((after for after, _ in better), key=lambda after: float(after.mean()))
    near = [words for after, words in better if (best - after).max() < NEAR]
    axis = int(np.argmax(best - before))
    return (
        f"commands and motion contradict each other in {AXES[axis]}: {', or '.join(near[:MOST])}; the commands would explain "
        f"{best[axis]:.0%} of the {AXES[axis]} acceleration instead of {before[axis]:.0%}."
    )


def is_better(after: FloatArray, before: FloatArray, seconds: float) -> bool:
    """Tell whether a neighbor explains one axis far better, and none worse."""
    axis = int(np.argmax(after - before))
    independent = 2.0 * (BANDS[axis][1] - BANDS[axis][0]) * seconds  # samples of what is band-limited
    left = np.maximum(1.0 - np.array([before[axis], after[axis]]), 1e-12)  # nothing where there is no noise
    ratio = independent * float(np.log(left[0] / left[1]))
    more = after[axis] - before[axis] > MARGIN and 1.0 - after[axis] < LEFT * (1.0 - before[axis])
    clear = more and after[axis] > ENOUGH and ratio > CERTAIN
    return bool(clear and (after - before).min() > -NEAR)


def _neighbors(vehicle: Vehicle, level: FloatArray, whole: FloatArray, area: Range) -> Iterator[Neighbor]:
    """Yield what differs from the file in one respect; `whole` (a, m) is what the file says."""
    changes = {f"rotors.{n}": 0.0 for n in _TORQUE if f"rotors.{n}" in vehicle.rows}
    torque = whole - effects(vehicle, {}, level, changes)[:3]
    for row, words in zip(np.eye(3, dtype=bool), _WHOLE, strict=True):
        yield Neighbor(words, np.where(row[:, None], -whole, whole))
    yield from _exchanged(vehicle, whole, area)
    rotors = _rotors(vehicle)
    for column, channel in zip(np.eye(len(area.names), dtype=bool), area.names, strict=True):
        yield Neighbor(
            f"{channel} looks inverted (its sign or scale in the mapping)", np.where(column, -whole, whole)
        )
        if len(rotors[channel]) == 1:
            yield from _of_rotor(rotors[channel][0], column, whole, torque)


def _exchanged(vehicle: Vehicle, whole: FloatArray, area: Range) -> Iterator[Neighbor]:
    rotors = _rotors(vehicle)
    for i, j in combinations(range(len(area.names)), 2):
        order = np.arange(len(area.names))
        order[[i, j]] = j, i
        (first, now), (second, then) = sorted((rotors[area.names[k]][0], area.names[k]) for k in (i, j))
        yield Neighbor(
            f"channel in [rotor.{first}] and [rotor.{second}] look exchanged (write {then} in the first, {now} in the second)",
            whole[:, order],
        )


def _of_rotor(
    rotor: str, column: NDArray[np.bool_], whole: FloatArray, torque: FloatArray
) -> Iterator[Neighbor]:
    """Yield the neighbors with one spin turned around, or one arm on the other side."""
    yield Neighbor(f"spin in [rotor.{rotor}] looks wrong", np.where(column, whole - 2.0 * torque, whole))
    for row, axis in zip(np.eye(3, dtype=bool), "yx", strict=False):
        moments = np.where(column & row[:, None], -whole, whole)
        yield Neighbor(f"{axis} of position in [rotor.{rotor}] looks to have the wrong sign", moments)


def _rotors(vehicle: Vehicle) -> dict[str, list[str]]:
    """Return which rotors each channel turns."""
    out: dict[str, list[str]] = {}
    for name, rotor in vehicle.file.rotor.items():
        out.setdefault(rotor.channel, []).append(name)
    return out


def _level(vehicle: Vehicle, flight: Flight) -> FloatArray:
    """Return the usual reading of every input (n_u,) while the vehicle flies."""
    up = flying(flight)
    out = np.zeros(len(vehicle.inputs))
    for i, name in enumerate(vehicle.inputs):
        seen = flight.column(name)[up] if name in flight.data else np.zeros(0)
        seen = seen[np.isfinite(seen)]
        out[i] = float(np.median(seen)) if seen.size else 0.0
    return out


def _gram(vehicle: Vehicle, flight: Flight, windows: Sequence[Window], area: Range) -> Gram | None:
    """Return the inner products; None where rates, commands or time are missing."""
    if not {*RATES, *area.names} <= set(map(str, flight.data.data_vars)) or flight.rate <= 2.0 * BANDS[0][1]:
        return None
    columns = np.column_stack([flight.column(c) for c in (*area.names, *RATES)])
    kept = within(flight, windows) & flying(flight) & np.isfinite(columns).all(axis=1)
    parts = [
        _products(vehicle, columns[run], flight.rate)
        for run in run_slices(kept)
        if run.stop - run.start >= LEAST * flight.rate
    ]
    if not parts:
        return None
    commands, both, turning, noise, seconds = (np.sum(kind, axis=0) for kind in zip(*parts, strict=True))
    return Gram(commands, both, turning, noise, float(seconds))


def _products(
    vehicle: Vehicle, columns: FloatArray, rate: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Return the numbers of a :class:`Gram` for one stretch, each axis in its own band."""
    from scipy.signal import butter, sosfiltfilt

    delay, lag = (vehicle.value(n) if n in vehicle.rows else 0.0 for n in ("rotors.delay", "rotors.lag"))
    late = delayed(columns[:, : -len(RATES)], delay * rate)
    turned = np.column_stack([first_order_lag(c, lag, 1.0 / rate) for c in late.T]) if lag > 0.0 else late
    rates = columns[:, -len(RATES) :]
    filters = [butter(ORDER, band, "bandpass", fs=rate, output="sos") for band in BANDS]
    x = [sosfiltfilt(sos, turned, axis=0) for sos in filters]
    slow = [sosfiltfilt(sos, own) for sos, own in zip(filters, rates.T, strict=True)]
    y = np.gradient(slow, 1.0 / rate, axis=1)  # (a, k); slopes first would let noise in at the ends
    commands = np.array([own.T @ own for own in x])
    both = np.array([own.T @ slope for own, slope in zip(x, y, strict=True)])
    n = len(columns)
    return commands, both, np.sum(y**2, axis=1), n * _noise(vehicle, rates, rate), n / rate


def _noise(vehicle: Vehicle, rates: FloatArray, rate: float) -> FloatArray:
    """Return the variance (a,) that white noise of the rates (k, a) leaves in their band-passed slopes, rad2/s4."""
    stated = [getattr(vehicle.file.sensors, name).sigma for name in RATES]
    seen = np.std(np.diff(rates, 2, axis=0), axis=0) / np.sqrt(6.0)  # motion is hardly in second differences
    cubes = np.array([high**3 - low**3 for low, high in BANDS])
    return np.asarray(np.maximum(stated, seen) ** 2 * 8.0 * np.pi**2 * cubes / (3.0 * rate))
