"""Delays of controls and sensors: signals read a fraction of a sample late.

Signals are shifted outside the kernel by four-point Lagrange interpolation: a gather inside it would break its
vectorization, and linear interpolation would put kinks into the gradient.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.variables import WRAPPED
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import slope_input

OFFSETS = (1, 0, -1, -2)  #: samples of the interpolation, relative to the one before the point


def lagrange(f: float) -> tuple[float, float, float, float]:
    """Return the weights of the samples at `OFFSETS` for the point at -f, 0 <= f < 1."""
    return (
        -f * (1.0 - f) * (2.0 - f) / 6.0,
        (1.0 + f) * (1.0 - f) * (2.0 - f) / 2.0,
        (1.0 + f) * f * (2.0 - f) / 2.0,
        -(1.0 + f) * f * (1.0 - f) / 6.0,
    )


def delayed(signal: FloatArray, samples: float) -> FloatArray:
    """Return a signal as it was `samples` earlier; before the record it holds its first value.

    Parameters
    ----------
    signal : (n, ...) array
    samples : float
        Delay in samples; negative looks ahead.
    """
    if samples == 0.0:
        return signal
    whole = int(np.floor(samples))
    index = np.arange(len(signal)) - whole
    out = np.zeros_like(signal, dtype=float)
    for offset, weight in zip(OFFSETS, lagrange(samples - whole), strict=True):
        out += weight * signal[np.clip(index + offset, 0, len(signal) - 1)]
    return out


def delayed_lanes(signal: FloatArray, samples: FloatArray) -> FloatArray:
    """Return one delayed copy per lane: (n, B) for a signal (n,), delays (B,).

    Each distinct delay is computed once; in a Jacobian few lanes differ from the first.
    """
    distinct, lane = np.unique(samples, return_inverse=True)
    copies = np.stack([delayed(signal, float(d)) for d in distinct], axis=-1)
    return np.ascontiguousarray(copies[:, lane])


def first_order_lag(command: FloatArray, lag: float, dt: float) -> FloatArray:
    """Return a first-order lag's response (n,) to a command that is linear between samples, initially at rest."""
    from scipy.signal import lfilter

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


def output_delays(vehicle: Vehicle) -> list[tuple[int, int]]:
    """Return output column and kernel row of each sensor delay."""
    names = [(i, f"sensors.{c}.delay") for i, c in enumerate(vehicle.outputs)]
    return [(i, vehicle.rows[n]) for i, n in names if n in vehicle.rows]


def late_inputs(vehicle: Vehicle, inputs: FloatArray, rows: FloatArray, dt: float) -> FloatArray:
    """Return inputs as surfaces and rotors receive them, with the slopes of channels.

    Parameters
    ----------
    inputs : (n, n_u) array
        As recorded.
    rows : (n_p, B) array
        Kernel parameters.
    dt : float, s

    Returns
    -------
    (n, n_u) array, or (n, n_u, B) where candidates differ in a delay
    """
    late = input_delays(vehicle)
    if not late and not vehicle.sloped:
        return inputs
    if all(np.ptp(rows[row]) == 0.0 for _, row in late):
        out = inputs.astype(float)
        for channel, row in late:
            out[:, channel] = delayed(inputs[:, channel], float(rows[row, 0]) / dt)
    else:
        out = np.repeat(inputs[:, :, None], rows.shape[1], axis=2)
        for channel, row in late:
            out[:, channel] = delayed_lanes(inputs[:, channel], rows[row] / dt)
    return with_slopes(vehicle, out, dt)


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


def late_outputs(
    vehicle: Vehicle, outputs: FloatArray, rows: FloatArray, dt: float, moved: Sequence[int] = ()
) -> FloatArray:
    """Return readings (B, n, n_y) as late as the instruments deliver them; the array is changed in place.

    A reading is continued as a straight line before and after the record. One that diverged is left as it is. `moved` are
    samples of each channel by which the recorded readings were moved ahead: these are no longer late by as much.
    """
    for channel, row in output_delays(vehicle):
        late = rows[row] / dt - (moved[channel] if moved else 0)
        finite = np.isfinite(outputs[:, :, channel]).all(axis=1) & np.isfinite(late)
        for samples in np.unique(late[finite & (late != 0.0)]).tolist():
            lanes = finite & (late == samples)
            readings = outputs[lanes, :, channel].T
            with np.errstate(over="ignore", invalid="ignore"):  # about to diverge: large numbers overflow
                # An angle that jumps from pi to -pi has no value between them.
                whole = np.unwrap(readings, axis=0) if vehicle.outputs[channel] in WRAPPED else readings
                pad = int(np.ceil(abs(samples))) + 2
                steps = np.arange(1.0, pad + 1.0)[:, None]
                before = whole[0] + steps[::-1] * (whole[0] - whole[1])
                after = whole[-1] + steps * (whole[-1] - whole[-2])
                shifted = delayed(np.concatenate([before, whole, after]), samples)
            outputs[lanes, :, channel] = shifted[pad:-pad].T
    return outputs
