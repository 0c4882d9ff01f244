"""Actuators and delays: dead zone, rate limit and delay of recorded channels, delays of sensors.

A command passes the dead zone of its servo, then the rate limit, then the delay; lags are states of the kernel. All of it
is applied outside the kernel: memory of earlier samples inside it would break its vectorization. Signals are shifted by
four-point Lagrange interpolation: linear interpolation would put kinks into the gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.base.variables import WRAPPED
from stoop.vehicle.channels import slope_input

if TYPE_CHECKING:
    from stoop.vehicle.vehicle import Vehicle

OFFSETS = (1, 0, -1, -2)  #: samples of the interpolation, relative to the one before the point


def lagrange(f: float | FloatArray) -> tuple[float | FloatArray, ...]:
    """Return the weights of the samples at `OFFSETS` for the point at -f, 0 <= f < 1."""
    return (
        -f * (1.0 - f) * (2.0 - f) / 6.0,
        (1.0 + f) * (1.0 - f) * (2.0 - f) / 2.0,
        (1.0 + f) * f * (2.0 - f) / 2.0,
        -(1.0 + f) * f * (1.0 - f) / 6.0,
    )


def delayed(signal: FloatArray, samples: float | FloatArray, every: int = 1) -> FloatArray:
    """Return a signal as it was `samples` earlier; before the record it holds its first value.

    Parameters
    ----------
    signal : (n, ...) array
    samples : float, or (...) array
        Delay in samples; negative looks ahead. Those of an array differ by a fraction of a sample.
    every : int
        Interval of the samples that are returned.
    """
    if not np.any(samples):
        return signal[::every]
    count, whole = len(signal), int(np.floor(np.min(samples)))
    # what all four offsets read, once
    around = signal[np.clip(np.arange(min(OFFSETS), count + max(OFFSETS)) - whole, 0, count - 1)]
    out = np.zeros((-(-count // every), *signal.shape[1:]))
    for offset, weight in zip(OFFSETS, lagrange(samples - whole), strict=True):
        first = offset - min(OFFSETS)
        out += weight * around[first : first + count : every]
    return out


def play(command: FloatArray, width: float) -> FloatArray:
    """Return positions (n,) of what stays while its command (n,) is within half a width of it, and else follows.

    It begins at the first command.
    """
    if width == 0.0:
        return command
    half, position, out = 0.5 * width, float(command[0]), []
    for c in command.tolist():
        position = min(max(position, c - half), c + half)
        out.append(position)
    return np.array(out)


def rate_limited(command: FloatArray, step: float) -> FloatArray:
    """Return positions (n,) of what follows its command (n,) by at most `step` from sample to sample.

    It begins at the first command.
    """
    if not np.abs(np.diff(command)).max(initial=0.0) > step:
        return command
    position, out = float(command[0]), []
    for c in command.tolist():
        position = min(max(c, position - step), position + step)
        out.append(position)
    return np.array(out)


def first_order_lag(command: FloatArray, lag: float, dt: float) -> FloatArray:
    """Return a first-order lag's response (n,) to a command that is linear between samples, initially at rest."""
    from scipy.signal import lfilter

    if lag == 0.0:
        return command
    decay = float(np.exp(-dt / lag))
    mean = -float(np.expm1(-dt / lag)) * lag / dt  # of the decay over a sample
    begin = [mean * float(command[0])]  # so that the first value is the first command
    return np.asarray(lfilter([1.0 - mean, mean - decay], [1.0, -decay], command, zi=begin)[0])


def input_delays(vehicle: Vehicle) -> list[tuple[int, int]]:
    """Return input column and kernel row of each delay (controls and rotors that share a channel share it)."""
    found: dict[int, int] = {}
    for control in vehicle.controls:
        name = f"controls.{control}.delay"
        for channel in vehicle.channels_of(control) if name in vehicle.rows else ():
            found[vehicle.inputs.index(channel)] = vehicle.rows[name]
    if "rotors.delay" in vehicle.rows:
        channels = [rotor.channel for rotor in vehicle.file.rotor.values()]
        found |= {vehicle.inputs.index(channel): vehicle.rows["rotors.delay"] for channel in channels}
    return list(found.items())


@dataclass(frozen=True)
class Actuator:
    """Kernel rows of what a recorded channel passes before surfaces and rotors receive it."""

    column: int  #: of the input
    delay: int | None
    #: row of the number of each control that the channel moves, rad or rad/s, and of its gain; None for a gain of one
    dead_zones: tuple[tuple[int, int | None], ...] = ()
    rate_limits: tuple[tuple[int, int | None], ...] = ()

    @property
    def rows(self) -> tuple[int, ...]:
        """Every row that it depends on."""
        of_surfaces = [row for pair in (*self.dead_zones, *self.rate_limits) for row in pair]
        return tuple(row for row in (self.delay, *of_surfaces) if row is not None)

    def numbers(self, rows: FloatArray, dt: float) -> FloatArray:
        """Return dead zone and largest step from sample to sample, the channel's unit, and delay in samples (3, B).

        Of several controls the widest dead zone and the lowest rate limit hold: a servo has one of each. `rows` are
        kernel parameters (n_p, B).
        """
        out = np.repeat([[0.0], [np.inf], [0.0]], rows.shape[1], axis=1)

        def of_channel(row: int, gain: int | None) -> FloatArray:
            size = 1.0 if gain is None else np.maximum(np.abs(rows[gain]), 1e-300)
            return np.asarray(rows[row] / size)

        for pair in self.dead_zones:
            out[0] = np.maximum(out[0], of_channel(*pair))
        for pair in self.rate_limits:
            out[1] = np.minimum(out[1], of_channel(*pair) * dt)
        if self.delay is not None:
            out[2] = rows[self.delay] / dt
        return out


def positions(command: FloatArray, dead_zone: float, step: float, delay: float) -> FloatArray:
    """Return what an actuator of the given :meth:`Actuator.numbers` makes of a command (n,)."""
    return delayed(rate_limited(play(command, dead_zone), step), delay)


def actuators(vehicle: Vehicle) -> tuple[Actuator, ...]:
    """Return the actuators of all channels that are not received as they are recorded."""
    pairs: dict[str, dict[int, list[tuple[int, int | None]]]] = {"dead_zone": {}, "rate_limit": {}}
    for control in vehicle.controls:
        base = f"controls.{control}"
        for channel in vehicle.channels_of(control):
            gain = vehicle.rows.get(f"{base}.mix.{channel}")
            for kind, found in pairs.items():
                if f"{base}.{kind}" in vehicle.rows:
                    own = found.setdefault(vehicle.inputs.index(channel), [])
                    own.append((vehicle.rows[f"{base}.{kind}"], gain))
    late, (zones, limits) = dict(vehicle.input_delays()), pairs.values()
    return tuple(
        Actuator(column, late.get(column), tuple(zones.get(column, ())), tuple(limits.get(column, ())))
        for column in sorted({*late, *zones, *limits})
    )


def actuator_rows(vehicle: Vehicle) -> list[int]:
    """Return the kernel rows that decide how channels are received; empty where they are received as recorded."""
    return sorted({row for actuator in vehicle.actuators() for row in actuator.rows})


def output_delays(vehicle: Vehicle) -> list[tuple[int, int]]:
    """Return output column and kernel row of each sensor delay."""
    names = [(i, f"sensors.{c}.delay") for i, c in enumerate(vehicle.outputs)]
    return [(i, vehicle.rows[n]) for i, n in names if n in vehicle.rows]


def late_inputs(
    vehicle: Vehicle, inputs: FloatArray, rows: FloatArray, dt: float, before: FloatArray | None = None
) -> FloatArray:
    """Return inputs as surfaces and rotors receive them, with the slopes of channels.

    Parameters
    ----------
    inputs : (n, n_u) array
        As recorded.
    rows : (n_p, B) array
        Kernel parameters.
    dt : float, s
    before : (m, n_c) array, optional
        Recorded channels, the first columns, in the samples before: what is late arrives from there. Else they held.

    Returns
    -------
    (n, n_u) array, or (n, n_u, B) where candidates differ in an actuator
    """
    actuators = vehicle.actuators()
    if not actuators and not vehicle.sloped:
        return inputs
    numbers = [actuator.numbers(rows, dt) for actuator in actuators]
    commands = inputs if before is None else np.concatenate([before, inputs[:, : before.shape[1]]])
    lead = len(commands) - len(inputs)
    if all(np.array_equal(own, np.broadcast_to(own[:, :1], own.shape)) for own in numbers):
        out = inputs.astype(float)
        for actuator, own in zip(actuators, numbers, strict=True):
            out[:, actuator.column] = positions(commands[:, actuator.column], *own[:, 0].tolist())[lead:]
    else:
        out = np.repeat(inputs[:, :, None], rows.shape[1], axis=2)
        for actuator, own in zip(actuators, numbers, strict=True):
            # Each distinct actuator is computed once; in a Jacobian few lanes differ from the first.
            distinct, lane = np.unique(own, axis=1, return_inverse=True)
            copies = [positions(commands[:, actuator.column], *one)[lead:] for one in distinct.T.tolist()]
            out[:, actuator.column] = np.stack(copies, axis=-1)[:, lane.ravel()]
    return with_slopes(vehicle, out, dt)


def distinct_inputs(
    vehicle: Vehicle, inputs: FloatArray, rows: FloatArray, dt: float, before: FloatArray | None = None
) -> tuple[FloatArray, IntArray]:
    """Return inputs (k, n, n_u) as different actuators receive them, and which of them each candidate (B,) has."""
    at, which = distinct_actuators(rows[actuator_rows(vehicle)])
    return np.stack([vehicle.late_inputs(inputs, rows[:, i : i + 1], dt, before) for i in at]), which


def distinct_actuators(late: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the first candidate (k,) of each different actuator, and which each candidate has, for numbers of them (m, B)."""
    if not (len(late) and np.ptp(late, axis=1).any()):
        return np.zeros(1, dtype=np.int64), np.zeros(late.shape[1], dtype=np.int64)
    _, at, which = np.unique(late, axis=1, return_index=True, return_inverse=True)
    return at, which.ravel()


def with_slopes(vehicle: Vehicle, inputs: FloatArray, dt: float) -> FloatArray:
    """Write the slopes of channels that are linear between samples into inputs (n, n_u, ...); return them.

    A slope holds from its sample to the next, so that its integral is the change of the channel.
    """
    for channel in vehicle.sloped:
        to, of = (vehicle.inputs.index(name) for name in (slope_input(channel), channel))
        slopes = np.diff(inputs[:, of], axis=0) / dt
        inputs[:, to] = np.concatenate([slopes, slopes[-1:]]) if len(slopes) else 0.0
    return inputs


def at_samples(vehicle: Vehicle, inputs: FloatArray) -> FloatArray:
    """Return inputs (n, n_u) at their samples alone: slopes are the mean of those before and after."""
    columns = [vehicle.inputs.index(slope_input(channel)) for channel in vehicle.sloped]
    if not columns:
        return inputs
    out = inputs.copy()
    out[1:, columns] = 0.5 * (inputs[1:, columns] + inputs[:-1, columns])
    return out


def late(readings: FloatArray, samples: float | FloatArray, wrapped: bool = False) -> FloatArray:
    """Return readings (n, ...) as they were `samples` earlier; before and after the record they are straight lines.

    Samples (...) of an array differ by a fraction of a sample.

    An angle that is `wrapped` jumps from pi to -pi and has no value between them: it is returned without jumps.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # about to diverge: large numbers overflow
        whole = np.unwrap(readings, axis=0) if wrapped else readings
        pad = int(np.ceil(np.max(np.abs(samples)))) + 2
        steps = np.arange(1.0, pad + 1.0).reshape(-1, *[1] * (readings.ndim - 1))
        before = whole[0] + steps[::-1] * (whole[0] - whole[1])
        after = whole[-1] + steps * (whole[-1] - whole[-2])
        return delayed(np.concatenate([before, whole, after]), samples)[pad:-pad]


def late_outputs(
    vehicle: Vehicle, outputs: FloatArray, rows: FloatArray, dt: float, moved: Sequence[int] = ()
) -> FloatArray:
    """Return readings (B, n, n_y) as late as the instruments deliver them; the array is changed in place.

    A reading is continued as a straight line before and after the record. One that diverged is left as it is. `moved` are
    samples of each channel by which the recorded readings were moved ahead: these are no longer late by as much.
    """
    for channel, row in output_delays(vehicle):
        behind = rows[row] / dt - (moved[channel] if moved else 0)
        finite = np.isfinite(outputs[:, :, channel]).all(axis=1) & np.isfinite(behind)
        lanes = np.flatnonzero(finite & (behind != 0.0))
        for whole in np.unique(np.floor(behind[lanes])).tolist():
            some = lanes[np.floor(behind[lanes]) == whole]
            readings = outputs[some, :, channel].T
            outputs[some, :, channel] = late(readings, behind[some], vehicle.outputs[channel] in WRAPPED).T
    return outputs


def held_numbers(vehicle: Vehicle, kinds: Sequence[str]) -> tuple[str, ...]:
    """Return name, value and unit of each number of these kinds of controls, rotors and observed instruments."""
    sensors = (f"sensors.{c}" for c in vehicle.outputs)
    owners = (*(f"controls.{c}" for c in vehicle.controls), "rotors", *sensors)
    rows = [vehicle.rows.get(name) for name in (f"{owner}.{kind}" for owner in owners for kind in kinds)]
    own = [vehicle.parameters[row] for row in dict.fromkeys(rows) if row is not None]
    return tuple(f"{p.name} = {p.value:g} {p.unit}" for p in own if p.value)
