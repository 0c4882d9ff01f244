"""The rotors of a vehicle file against a flight: exchanged channels, a wrong spin, an arm on the other side, a lost sign.

The motors' commands, through delay and lag, go into the file's moments per inertia, and these predict the measured angular
accelerations, band-passed alike. One positive gain for each axis is free, for thrust and inertia are not known yet.

Axes: k = sample, m = channel, a = axis (roll, pitch, yaw).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, TypeAlias

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, runs
from stoop.base.notices import Notice, notice
from stoop.base.variables import RATES
from stoop.checks.engine import Edit, Evidence, Finding, Key, Residual, Residuals, search
from stoop.flight import Flight
from stoop.flight.airborne import flying
from stoop.problem.windows import Window, within
from stoop.simulation.delays import delayed, first_order_lag
from stoop.simulation.rotors import Range, channel_range, effects
from stoop.vehicle import Vehicle

AXES: Final = ("roll", "pitch", "yaw")
BANDS: Final = (
    (0.3, 5.0),
    (0.3, 5.0),
    (0.15, 2.0),
)  #: Hz, by axis: slower is the air's doing, quicker is noise
ORDER: Final = 2  #: of the Butterworth filter, which runs forward and backward
RATE: Final = 25.0  #: Hz that the bands need
MIN_STRETCH: Final = 2.0  #: s without a hole
MOTION: Final = (
    4.0  #: times the noise's power: an axis that moves; motors answer to noise as well, the wrong way round
)
MAX_NAMED: Final = 3  #: edits in one suggestion
WEAK_TORQUE: Final = ("torque_ratio", "Q0", "Q1", "Q2")

Moments: TypeAlias = (
    FloatArray  #: (a, m) angular acceleration per command, as the file has it: the state of the search
)


@dataclass(frozen=True, eq=False)
class Motions:
    """Band-passed angular accelerations and commands of all windows: the model that `search` needs.

    Attributes
    ----------
    commands : for each axis (k, m)
    accelerations : for each axis (k,), rad/s2
    noise : (a,)
        Variance that the noise of the rates leaves in them.
    rate : float, Hz
    """

    commands: Sequence[FloatArray]
    accelerations: Sequence[FloatArray]
    noise: FloatArray
    rate: float

    def __call__(self, moments: Moments, changed: Collection[str] | None) -> Residuals:
        """Return what commands leave of the acceleration about each axis that moves."""
        out: dict[Key, Evidence] = {}
        for axis, x, y, noise, row, (low, high) in zip(
            AXES, self.commands, self.accelerations, self.noise, moments, BANDS, strict=True
        ):
            if np.mean(y**2) > MOTION * noise:
                predicted = x @ row
                power = float(predicted @ predicted)
                gain = max(float(predicted @ y), 0.0) / power if power > 0.0 else 0.0
                out["moment", axis] = Residual(
                    y - gain * predicted, y, self.rate / (2.0 * (high - low)), noise
                )
        return out

    def explained(self, moments: Moments, axis: str) -> float:
        """Return the share of an axis' acceleration that the commands explain."""
        residual = self(moments, None)["moment", axis]
        if not isinstance(residual, Residual):
            raise TypeError("an axis has a residual")
        return 1.0 - float(np.mean(residual.left**2) / np.mean(residual.size**2))


def check_motors(vehicle: Vehicle, flight: Flight, windows: Sequence[Window]) -> list[Notice]:
    """Return the lines of a vehicle file's rotors that the motion of a flight contradicts.

    Parameters
    ----------
    vehicle : Vehicle
        With rotors.
    flight : Flight
    windows : sequence of Window
        Of this flight; only where it flies.
    """
    area = channel_range(vehicle)
    motions = _motions(vehicle, flight, windows, area)
    if motions is None:
        return []
    level = _level(vehicle, flight)
    moments = effects(vehicle, {}, level, {})[:3]
    without = {f"rotors.{name}": 0.0 for name in WEAK_TORQUE if f"rotors.{name}" in vehicle.rows}
    torque = moments - effects(vehicle, {}, level, without)[:3]
    found, _ = search(moments, lambda _: rotor_edits(vehicle, torque, area), motions)
    out = []
    for one in found:
        out.append(_notice(vehicle, flight, one, motions, moments))
        moments = one.best.apply(moments)
    return out


def _notice(
    vehicle: Vehicle, flight: Flight, found: Finding[Moments], motions: Motions, moments: Moments
) -> Notice:
    axis = found.edits[0].channel[1]
    alternatives = tuple(one.edit.fix for one in found.edits[:MAX_NAMED])
    return notice(
        "moments-contradicted",
        flight.name,
        kind=found.best.kind,
        axis=axis,
        lines=found.best.lines,
        suggestion=" or ".join(alternatives),
        alternatives=alternatives,
        before=motions.explained(moments, axis),
        after=motions.explained(found.best.apply(moments), axis),
        evidence=found.edits[0].evidence,
        vehicle=vehicle.where,
    )


def rotor_edits(vehicle: Vehicle, torque: Moments, area: Range) -> Iterator[Edit[Moments]]:
    """Yield every single edit of the file's rotors; `torque` (a, m) is the part of the moments that spins make."""
    rotors: dict[str, list[str]] = {}
    for name, rotor in vehicle.file.rotor.items():
        rotors.setdefault(rotor.channel, []).append(name)
    for row, line, rate in zip(
        np.eye(3, dtype=bool), ("y of position", "x of position", "spin"), RATES, strict=True
    ):
        fix = f"change the sign of {line} of all rotors (or of {rate} in the mapping)"
        yield Edit("axis", (line, rate), fix, _negated(row[:, None]), complete=True)
    for i, j in combinations(range(len(area.names)), 2):
        (first, now), (second, then) = sorted((rotors[area.names[k]][0], area.names[k]) for k in (i, j))
        fix = f'write channel = "{then}" in [rotor.{first}] and "{now}" in [rotor.{second}]'
        yield Edit("exchange", (f"rotor.{first}", f"rotor.{second}"), fix, _exchanged(i, j), complete=True)
    for column, channel in zip(np.eye(len(area.names), dtype=bool), area.names, strict=True):
        fix = f"change the sign or scale of {channel} in the mapping (it looks inverted)"
        yield Edit("command", (channel,), fix, _negated(column), complete=True)
        if len(rotors[channel]) == 1:
            table = f"rotor.{rotors[channel][0]}"
            yield Edit(
                "spin", (table,), f"turn spin in [{table}] around", _turned(column, torque), complete=True
            )
            for row, axis in zip(np.eye(3, dtype=bool), "yx", strict=False):
                fix = f"change the sign of {axis} of position in [{table}]"
                yield Edit("position", (table, axis), fix, _negated(column & row[:, None]), complete=True)


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


def _level(vehicle: Vehicle, flight: Flight) -> FloatArray:
    """Return the median of every input (n_u,) in flight."""
    up = flying(flight)
    out = np.zeros(len(vehicle.inputs))
    for i, name in enumerate(vehicle.inputs):
        x = flight.column(name)[up] if name in flight.data else np.zeros(0)
        x = x[np.isfinite(x)]
        out[i] = float(np.median(x)) if x.size else 0.0
    return out


def _motions(vehicle: Vehicle, flight: Flight, windows: Sequence[Window], area: Range) -> Motions | None:
    """Return what is compared; None where rates, commands or time are missing."""
    from scipy.signal import butter, sosfiltfilt

    if not {*RATES, *area.names} <= set(map(str, flight.data.data_vars)) or flight.rate <= 2.0 * BANDS[0][1]:
        return None
    columns = np.column_stack([flight.column(c) for c in (*area.names, *RATES)])
    good = within(flight, windows) & flying(flight) & np.isfinite(columns).all(axis=1)
    delay, lag = (vehicle.value(n) if n in vehicle.rows else 0.0 for n in ("rotors.delay", "rotors.lag"))
    filters = [butter(ORDER, band, "bandpass", fs=flight.rate, output="sos") for band in BANDS]
    step = max(1, int(flight.rate / RATE))
    parts: list[tuple[list[FloatArray], list[FloatArray]]] = []
    variance, count = np.zeros(len(AXES)), 0
    for start, stop in runs(good):
        if stop - start < MIN_STRETCH * flight.rate:
            continue
        late = delayed(columns[start:stop, : -len(RATES)], delay * flight.rate)
        turned = (
            np.column_stack([first_order_lag(c, lag, 1.0 / flight.rate) for c in late.T])
            if lag > 0.0
            else late
        )
        rates = columns[start:stop, -len(RATES) :]
        commands = [sosfiltfilt(sos, turned, axis=0)[::step] for sos in filters]
        # slopes of what is filtered: slopes first would let noise in at the ends
        slow = [sosfiltfilt(sos, own) for sos, own in zip(filters, rates.T, strict=True)]
        parts.append((commands, [np.gradient(own, 1.0 / flight.rate)[::step] for own in slow]))
        variance += (stop - start) * _noise(vehicle, rates, flight.rate)
        count += stop - start
    if not parts:
        return None
    commands, accelerations = (
        [np.concatenate([part[kind][a] for part in parts]) for a in range(len(AXES))] for kind in (0, 1)
    )
    return Motions(commands, accelerations, variance / count, flight.rate / step)


def _noise(vehicle: Vehicle, rates: FloatArray, rate: float) -> FloatArray:
    """Return the variance (a,) that white noise of the rates (k, a) leaves in their band-passed slopes, rad2/s4."""
    stated = [getattr(vehicle.file.sensors, name).sigma for name in RATES]
    recorded = np.std(np.diff(rates, 2, axis=0), axis=0) / np.sqrt(
        6.0
    )  # motion is hardly in second differences
    cubes = np.array([high**3 - low**3 for low, high in BANDS])
    return np.asarray(np.maximum(stated, recorded) ** 2 * 8.0 * np.pi**2 * cubes / (3.0 * rate))
