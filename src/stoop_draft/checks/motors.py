"""The rotors of a vehicle file against a flight: exchanged channels, a wrong spin, an arm on the other side, a lost sign.

The motors' commands, through lag and delay, go into the file's moments per inertia, and these predict the measured angular
accelerations, band-passed alike. One positive gain for each axis is free, for thrust and inertia are not known yet. So is the
delay: that at which commands explain most whatever moments they have.

Axes: k = sample, m = channel, a = axis (roll, pitch, yaw).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Final, TypeAlias

import numpy as np

from stoop import Flight, Notice, Vehicle
from stoop.extend.arrays import BoolArray, FloatArray, run_slices
from stoop.extend.flights import Window
from stoop.extend.motion import delayed, first_order_lag
from stoop.extend.notices import notice
from stoop.extend.text import enumerated
from stoop_draft.checks.engine import Edit, Evidence, Key, Residual, Residuals, search
from stoop_draft.checks.lines import RATES

AXES: Final = ("roll", "pitch", "yaw")
#: Hz, by axis: slower is the air's doing, quicker is noise
BANDS: Final = ((0.3, 5.0), (0.3, 5.0), (0.15, 2.0))
ORDER: Final = 2  #: of the Butterworth filter, which runs forward and backward
RATE: Final = 25.0  #: Hz that the bands need
MIN_STRETCH: Final = 2.0  #: s without a hole
LATEST: Final = 0.5  #: s; the longest delay that is tried
DELAY_STEP: Final = 0.01  #: s
#: times the noise's power: an axis that moves; motors answer to noise as well, the wrong way round
MOTION: Final = 4.0
MOST_ORDERED: Final = 8  #: commands of which every order is tried

#: (a, m) angular acceleration per command, as the file has it: the state of the search
Moments: TypeAlias = FloatArray


@dataclass(frozen=True, eq=False)
class Motions:
    """Band-passed angular accelerations and commands of all windows: the model that `search` needs."""

    commands: Sequence[FloatArray]  #: for each axis (k, m)
    accelerations: Sequence[FloatArray]  #: for each axis (k,), rad/s2
    noise: FloatArray  #: (a,) variance that the noise of the rates leaves in them
    rate: float  #: Hz

    def __call__(self, moments: Moments, changed: Collection[str] | None) -> Residuals:
        """Return what commands leave of the acceleration about each axis that moves."""
        out: dict[Key, Evidence] = {}
        for axis, x, y, noise, row, samples in zip(
            AXES, self.commands, self.accelerations, self.noise, moments, self.samples, strict=True
        ):
            if np.mean(y**2) > MOTION * noise:
                predicted = x @ row
                power = float(predicted @ predicted)
                gain = max(float(predicted @ y), 0.0) / power if power > 0.0 else 0.0
                out["moment", axis] = Residual(y - gain * predicted, y, samples, noise)
        return out

    @property
    def samples(self) -> tuple[float, ...]:
        """Samples of each axis that are as good as one independent sample."""
        return tuple(self.rate / (2.0 * (high - low)) for low, high in BANDS)

    @property
    def likelihood(self) -> float:
        """Logarithm of the likelihood of the accelerations by commands of any moments."""
        out = 0.0
        for x, y, noise, samples in zip(
            self.commands, self.accelerations, self.noise, self.samples, strict=True
        ):
            left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
            out -= 0.5 * y.size / samples * np.log(np.mean(left**2) + noise)
        return float(out)

    def explained(self, moments: Moments, axis: str) -> float:
        """Return the share of an axis' acceleration that the commands explain."""
        residual = self(moments, None)["moment", axis]
        if not isinstance(residual, Residual):
            raise TypeError("an axis has a residual")
        return 1.0 - float(np.mean(residual.left**2) / np.mean(residual.size**2))

    def order(self, moments: Moments) -> tuple[int, ...]:
        """Return which column of the moments each command takes so that all axes together are explained best.

        Every order is tried: those of eight commands are 40,320.
        """
        count = moments.shape[1]
        if count > MOST_ORDERED:
            return tuple(range(count))
        orders = np.array(list(permutations(range(count))))
        left = np.zeros(len(orders))
        for x, y, noise, row, samples in zip(
            self.commands, self.accelerations, self.noise, moments, self.samples, strict=True
        ):
            if np.mean(y**2) <= MOTION * noise:
                continue
            rows, power = row[orders], float(y @ y)
            along = np.maximum(rows @ (x.T @ y), 0.0)
            explained = along**2 / np.maximum(np.sum((rows @ (x.T @ x)) * rows, axis=1), 1e-300)
            left += (
                0.5 * y.size / samples * np.log(np.maximum(1.0 - explained / power, noise * y.size / power))
            )
        return tuple(int(i) for i in orders[int(np.argmin(left))])


def check_motors(vehicle: Vehicle, flight: Flight, windows: Sequence[Window]) -> list[Notice]:
    """Return the lines of a vehicle file's rotors that the motion of a flight contradicts.

    Parameters
    ----------
    vehicle : Vehicle
        Wings make moments too: only a multirotor is checked.
    flight : Flight
    windows : sequence of Window
        Of this flight; only where it flies.
    """
    if not vehicle.rotors:
        return []
    channels = vehicle.rotor_range.names
    motions = _motions(vehicle, flight, windows, channels)
    if motions is None:
        return []
    up, level = flight.flying(), np.zeros(len(vehicle.inputs))  # the median of every input in flight
    for i, name in enumerate(vehicle.inputs):
        x = flight.column(name)[up] if name in flight.names else np.zeros(0)
        x = x[np.isfinite(x)]
        level[i] = float(np.median(x)) if x.size else 0.0
    moments = vehicle.rotor_effects({}, level, {})[:3]
    ratios = (f"rotors.{name}" for name in ("torque_ratio", "Q0", "Q1", "Q2"))
    torque = moments - vehicle.rotor_effects({}, level, {n: 0.0 for n in ratios if n in vehicle.rows})[:3]

    def edits(state: Moments) -> Iterable[Edit[Moments]]:
        yield from rotor_edits(vehicle, torque, channels)
        yield from order_edits(vehicle, channels, motions.order(state))

    found, _ = search(moments, edits, motions)
    out = []
    for one in found:
        axis, corrected = one.edits[0].channel[1], one.best.apply(moments)
        alternatives = tuple(s.edit.fix for s in one.edits[:3])
        out.append(
            notice(
                "moments-contradicted",
                flight.name,
                kind=one.best.kind,
                axis=axis,
                lines=one.best.lines,
                suggestion=" or ".join(alternatives),
                alternatives=alternatives,
                before=motions.explained(moments, axis),
                after=motions.explained(corrected, axis),
                evidence=one.edits[0].evidence,
                vehicle=vehicle.where,
            )
        )
        moments = corrected
    return out


def rotor_edits(vehicle: Vehicle, torque: Moments, channels: Sequence[str]) -> Iterator[Edit[Moments]]:
    """Yield every single edit of the file's rotors; `torque` (a, m) is the part of the moments that spins make."""
    rotors: dict[str, list[str]] = {}
    for name, rotor in vehicle.file.rotor.items():
        rotors.setdefault(rotor.channel, []).append(name)
    axes = np.eye(3, dtype=bool)
    for row, line, rate in zip(axes, ("y of position", "x of position", "spin"), RATES, strict=True):
        fix = f"change the sign of {line} of all rotors (or of {rate} in the mapping)"
        yield Edit("axis", (line, rate), fix, _negated(row[:, None]), complete=True)
    for i, j in combinations(range(len(channels)), 2):
        (first, now), (second, then) = sorted((rotors[channels[k]][0], channels[k]) for k in (i, j))
        fix = f'write channel = "{then}" in [rotor.{first}] and "{now}" in [rotor.{second}]'
        yield Edit("exchange", (f"rotor.{first}", f"rotor.{second}"), fix, _exchanged(i, j), complete=True)
    for column, channel in zip(np.eye(len(channels), dtype=bool), channels, strict=True):
        fix = f"change the sign or scale of {channel} in the mapping (it looks inverted)"
        yield Edit("command", (channel,), fix, _negated(column), complete=True)
        if len(rotors[channel]) == 1:
            table = f"rotor.{rotors[channel][0]}"
            fix = f"turn spin in [{table}] around"
            yield Edit("spin", (table,), fix, _turned(column, torque), complete=True)
            for row, axis in zip(axes, "yx", strict=False):
                fix = f"change the sign of {axis} of position in [{table}]"
                yield Edit("position", (table, axis), fix, _negated(column & row[:, None]), complete=True)


def order_edits(vehicle: Vehicle, channels: Sequence[str], order: Sequence[int]) -> Iterator[Edit[Moments]]:
    """Yield the edit that gives the commands another order; two that are exchanged are among the single edits."""
    moved = [i for i, j in enumerate(order) if i != j]
    if len(moved) < 3:
        return
    rotors = {rotor.channel: name for name, rotor in reversed(vehicle.file.rotor.items())}
    places = sorted((rotors[channels[order[i]]], channels[i]) for i in moved)
    fix = "write " + enumerated([f'channel = "{channel}" in [rotor.{name}]' for name, channel in places])
    lines = tuple(f"rotor.{name}" for name, _ in places)
    columns = list(order)
    prior = -math.lgamma(len(order) + 1.0)  # one of all orders
    yield Edit("order", lines, fix, lambda moments: moments[:, columns], complete=True, prior=prior)


def _negated(where: BoolArray) -> Callable[[Moments], Moments]:
    return lambda moments: np.where(where, -moments, moments)


def _exchanged(i: int, j: int) -> Callable[[Moments], Moments]:
    def apply(moments: Moments) -> Moments:
        out = moments.copy()
        out[:, [i, j]] = moments[:, [j, i]]
        return out

    return apply


def _turned(column: BoolArray, torque: Moments) -> Callable[[Moments], Moments]:
    return lambda moments: np.where(column, moments - 2.0 * torque, moments)


def _motions(
    vehicle: Vehicle, flight: Flight, windows: Sequence[Window], channels: Sequence[str]
) -> Motions | None:
    """Return what is compared; None where rates, commands or time are missing."""
    from scipy.signal import butter, sosfiltfilt

    if not {*RATES, *channels} <= flight.names or flight.rate <= 2.0 * BANDS[0][1]:
        return None
    columns = np.column_stack([flight.column(c) for c in (*channels, *RATES)])
    good = Window.within(flight, windows) & flight.flying() & np.isfinite(columns).all(axis=1)
    delay, lag = (vehicle.value(n) if n in vehicle.rows else 0.0 for n in ("rotors.delay", "rotors.lag"))
    filters = [butter(ORDER, band, "bandpass", fs=flight.rate, output="sos") for band in BANDS]
    step = max(1, int(flight.rate / RATE))
    stated = [getattr(vehicle.file.sensors, name).sigma for name in RATES]
    parts: list[tuple[list[FloatArray], list[FloatArray]]] = []
    variance, count = np.zeros(len(AXES)), 0
    for run in run_slices(good):
        if run.stop - run.start < MIN_STRETCH * flight.rate:
            continue
        turned = columns[run, : -len(RATES)]
        if lag > 0.0:
            turned = np.column_stack([first_order_lag(c, lag, 1.0 / flight.rate) for c in turned.T])
        rates = columns[run, -len(RATES) :]
        commands = [sosfiltfilt(sos, turned, axis=0) for sos in filters]
        # slopes of what is filtered: slopes first would let noise in at the ends
        slow = [sosfiltfilt(sos, own) for sos, own in zip(filters, rates.T, strict=True)]
        parts.append((commands, [np.gradient(own, 1.0 / flight.rate)[::step] for own in slow]))
        # what white noise of the rates leaves in their band-passed slopes; motion is hardly in second differences
        recorded = np.std(np.diff(rates, 2, axis=0), axis=0) / np.sqrt(6.0)
        cubes = np.array([high**3 - low**3 for low, high in BANDS])
        noise = np.maximum(stated, recorded) ** 2 * 8.0 * np.pi**2 * cubes / (3.0 * flight.rate)
        variance += (run.stop - run.start) * noise
        count += run.stop - run.start
    if not parts:
        return None
    accelerations = [np.concatenate(own) for own in zip(*(slopes for _, slopes in parts), strict=True)]

    def after(late: float) -> Motions:
        shifted = ([delayed(x, late * flight.rate, step) for x in commands] for commands, _ in parts)
        several = [np.concatenate(own) for own in zip(*shifted, strict=True)]
        return Motions(several, accelerations, variance / count, flight.rate / step)

    delays = np.arange(-lag, LATEST, DELAY_STEP).tolist()
    return max(map(after, [delay, *delays]), key=lambda motions: motions.likelihood)
