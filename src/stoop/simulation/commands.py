"""What the autopilot sends to the rotors, sample by sample, and when it arrives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.simulation.autopilot import LinearErrors
from stoop.simulation.delays import input_delays, lagrange
from stoop.simulation.maneuver import EXCITATIONS, SETPOINTS, Battery, Maneuver
from stoop.simulation.mixing import mixed_inputs
from stoop.simulation.rotors import AXES, Range, channel_range
from stoop.simulation.steady import Trim
from stoop.vehicle import Vehicle

_EMPTY: Final = 0.05  #: of the nominal voltage; less is left by no battery


@dataclass(frozen=True, eq=False)
class Late:
    """Channels as they arrive: four neighboring samples of each, weighed.

    Attributes
    ----------
    offsets, weights : (4, n_u)
    ahead : int
        Samples from a state to the first command that can depend on it.
    delay : int
        Samples from there to its arrival, rounded.
    """

    offsets: NDArray[np.intp]
    weights: FloatArray
    ahead: int
    delay: int

    @classmethod
    def of(cls, vehicle: Vehicle, rows: FloatArray, dt: float) -> Late:
        """Read the delays of a vehicle off its kernel parameters (n_p, 1)."""
        samples = np.zeros(len(vehicle.inputs))
        for column, row in input_delays(vehicle):
            samples[column] = rows[row, 0] / dt
        whole = np.floor(samples)
        offsets = np.array([1, 0, -1, -2])[:, None] - whole.astype(np.intp)
        weights = np.array([lagrange(float(f)) for f in samples - whole]).T
        rotors = channel_range(vehicle).columns
        needed = 1 - whole[rotors] + (samples[rotors] > whole[rotors])
        return cls(offsets, weights, max(1, int(needed.max())), max(0, round(float(samples[rotors].mean()))))

    def received(self, commands: FloatArray, k: int) -> FloatArray:
        """Return what arrives at a sample (n_u,) of channels (n, n_u), as `late_inputs` has it of them all."""
        at = np.minimum(np.maximum(k + self.offsets, 0), len(commands) - 1)
        return np.asarray((self.weights * commands[at, np.arange(commands.shape[1])]).sum(axis=0))


@dataclass(frozen=True, eq=False)
class Commands:
    """The recorded channels, filled sample by sample.

    Attributes
    ----------
    range : Range
    model : LinearErrors
    trim : (m,)
        Channels of the rotors.
    inputs : (n, n_u)
        Filled.
    excitations : (n, 4)
        Accelerations that the maneuver adds.
    single : (n, m)
        What it adds to single channels.
    voltage : (n,) or None
        Of the battery before its sag; None where the rotors do not feel it.
    given : (n, 4)
        Filled: accelerations that the channels give, beyond the trim's.
    clipped : (n, m)
        Filled: where the range ended.
    """

    range: Range
    model: LinearErrors
    trim: FloatArray
    inputs: FloatArray
    excitations: FloatArray
    single: FloatArray
    voltage: FloatArray | None
    sag: float
    nominal: float
    column: int  #: of the voltage
    given: FloatArray
    clipped: NDArray[np.bool_]

    @classmethod
    def of(cls, vehicle: Vehicle, maneuver: Maneuver, point: Trim, model: LinearErrors) -> Commands:
        """Prepare the channels of a maneuver, those of the rotors still empty."""
        signals, area, time = maneuver.deflections(), channel_range(vehicle), maneuver.time
        none = np.zeros(len(time))
        voltage, sag, nominal = _battery(vehicle, maneuver.battery or Battery(), time)
        return cls(
            range=area,
            model=model,
            trim=point.inputs[area.columns],
            inputs=_others(vehicle, point, signals, len(time)),
            excitations=np.column_stack([signals.get(axis, none) for axis in AXES]),
            single=np.column_stack([signals.get(name, none) for name in area.names]),
            voltage=voltage,
            sag=sag,
            nominal=nominal,
            column=-1 if voltage is None else vehicle.inputs.index("voltage"),
            given=np.zeros((len(time), 4)),
            clipped=np.zeros((len(time), len(area.names)), dtype=bool),
        )

    def give(self, k: int, accelerations: FloatArray) -> None:
        """Record the channels that give accelerations (4,) beside the excitations, as far as their range allows.

        The autopilot measures the voltage and makes up for it.
        """
        area = self.range
        wanted = self.trim + self.model.mixing @ (accelerations + self.excitations[k]) + self.single[k]
        share = self._share(k, wanted)
        sent = area.idle + (wanted - area.idle) / share
        held = area.clip(sent)
        self.clipped[k] = held != sent
        self.inputs[k, area.columns] = held
        self.given[k] = self.model.effect @ (area.idle + (held - area.idle) * share - self.trim)

    def _share(self, k: int, wanted: FloatArray) -> float:
        """Record the voltage under the current of these channels; return it over the nominal one."""
        if self.voltage is None:
            return 1.0
        idle = self.range.idle
        load = float(np.mean(np.square((wanted - idle) / (self.trim - idle))))
        volts = max(float(self.voltage[k]) - self.sag * load, _EMPTY * self.nominal)
        self.inputs[k, self.column] = volts
        return volts / self.nominal


def _battery(vehicle: Vehicle, battery: Battery, time: FloatArray) -> tuple[FloatArray | None, float, float]:
    """Return voltage (n,) before its sag, the sag at the current of the trim, and the nominal voltage."""
    if "rotors.nominal_voltage" not in vehicle.rows:
        return None, 0.0, math.nan
    nominal = vehicle.value("rotors.nominal_voltage")
    start = nominal if battery.start is None else battery.start
    return start - battery.fall * time, battery.sag, nominal


def _others(vehicle: Vehicle, point: Trim, signals: Mapping[str, FloatArray], count: int) -> FloatArray:
    """Return channels (n, n_u): those of the trim, with surfaces and a pusher as the maneuver moves them."""
    out = np.repeat(point.inputs[None, :], count, axis=0)
    taken = {*EXCITATIONS, *SETPOINTS, *channel_range(vehicle).names}
    for name in (n for n in signals if n not in taken):
        if name in vehicle.controls:
            moved = {**point.deflections, name: point.deflections[name] + 1.0}
            out += np.outer(signals[name], mixed_inputs(vehicle, moved, point.inputs) - point.inputs)
        else:
            out[:, vehicle.inputs.index(name)] += signals[name]
    return out
