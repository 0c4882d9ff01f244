"""Rotors as one control: the accelerations that their channels give, and the channels for wanted accelerations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from stoop.base.arrays import FloatArray, IntArray
from stoop.errors import SimulationError
from stoop.vehicle.defaults import full_command

if TYPE_CHECKING:
    from stoop.vehicle.vehicle import Vehicle

EXCITATIONS: Final = {"roll": "rad/s2", "pitch": "rad/s2", "yaw": "rad/s2", "heave": "m/s2"}
"""Angular accelerations and specific force up the body, by unit, that an autopilot commands and a maneuver adds to."""
SETPOINTS: Final = {
    "north": "m/s", "east": "m/s", "down": "m/s", "forward": "m/s", "right": "m/s", "heading": "rad",
}  # fmt: skip
"""Set-points of the autopilot, and units: a velocity over ground (forward and right of the heading), a heading."""
AXES: Final = tuple(EXCITATIONS)  #: the order of every allocation
MIN_AUTHORITY: Final = 1e-7  #: of the strongest axis; a weaker acceleration is none


@dataclass(frozen=True, eq=False)
class Range:
    """Range of the rotor channels."""

    names: tuple[str, ...]  #: channels, each once
    columns: IntArray  #: (m,), among the vehicle's inputs
    idle: FloatArray  #: (m,); the rotor does not push
    full: FloatArray  #: (m,); infinite where nothing bounds its speed

    def clip(self, commands: FloatArray) -> FloatArray:
        """Return commands (m,) within the range."""
        return np.asarray(np.minimum(np.maximum(commands, self.idle), self.full))


def rotor_range(vehicle: Vehicle) -> Range:
    """Return the range of a vehicle's rotor channels; of a vehicle without rotors it is empty."""
    names = tuple(dict.fromkeys(rotor.channel for rotor in vehicle.file.rotor.values()))
    gain, idle = vehicle.value("rotors.gain", 1.0), vehicle.value("rotors.idle", 0.0)
    by_drive = idle + 1.0 / gain if vehicle.drive == "command" and gain > 0.0 else np.inf
    full = np.minimum(by_drive, np.array([full_command(n) or np.inf for n in names]))
    columns = np.array([vehicle.inputs.index(n) for n in names], dtype=np.intp)
    return Range(names, columns, np.full(len(names), idle), full)


def accelerations(
    vehicle: Vehicle,
    start: Mapping[str, ArrayLike],
    inputs: FloatArray,
    rows: FloatArray | None = None,
    of: Sequence[str] = ("u", "v", "w", "p", "q", "r"),
) -> FloatArray:
    """Return the rates (6, B), or those of other states (n, B), for channels (n_u, B) after all lags have settled.

    `rows` are kernel parameters (n_p, B); the vehicle's own when absent.
    """
    rows = vehicle.parameter_rows(None, inputs.shape[1]) if rows is None else rows
    states = vehicle.initial_states(start, rows, inputs)
    rates, _ = vehicle.kernel().evaluate(rows, states, np.ascontiguousarray(inputs))
    return rates[[vehicle.states.index(s) for s in of]]


def rotor_effects(
    vehicle: Vehicle, start: Mapping[str, ArrayLike], inputs: FloatArray, changes: Mapping[str, ArrayLike]
) -> FloatArray:
    """Return the accelerations `AXES` per unit of each rotor channel about `inputs` (n_u,), (4, m), after all lags.

    `start` is as in :func:`~stoop.vehicle.channels.initial_states`; `changes` replace numbers of the vehicle.
    """
    area = vehicle.rotor_range
    step = 1e-4 * np.maximum(np.abs(inputs[area.columns] - area.idle), 1e-3)
    change = np.zeros((len(inputs), 2 * len(step)))
    for i, column in enumerate(area.columns):
        change[column, [2 * i, 2 * i + 1]] = step[i], -step[i]
    rows = vehicle.parameter_rows(changes, change.shape[1])
    rates = vehicle.accelerations(start, inputs[:, None] + change, rows)
    up = np.vstack([rates[3:], -rates[2:3]])
    return np.asarray((up[:, 0::2] - up[:, 1::2]) / (2.0 * step))


def rotor_allocation(vehicle: Vehicle, effect: FloatArray) -> FloatArray:
    """Return the smallest channels (m, 4) that give one unit of each acceleration and nothing of the others.

    Raises
    ------
    SimulationError
        An acceleration that the rotors do not give, or not independently of the others.
    """
    size = np.linalg.norm(effect, axis=1)
    scaled = effect / np.where(size > 0.0, size, 1.0)[:, None]
    missing = [axis for axis, s in zip(AXES, size, strict=True) if not s > MIN_AUTHORITY * size.max()]
    if not missing and np.linalg.svd(scaled, compute_uv=False)[-1] < 1e-6:
        missing = ["roll, pitch, yaw and heave apart from each other"]
    if missing:
        raise SimulationError(
            f"{vehicle.where}: the rotors cannot command {missing[0]}, so no autopilot holds it; "
            "check positions, axes, spin, thrust and torque (torque_ratio, or Q2) of the rotors"
        )
    return np.asarray(np.linalg.pinv(scaled) / size)
