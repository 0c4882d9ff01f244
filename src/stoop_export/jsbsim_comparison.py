"""Maneuvers by our own simulation and by JSBSim: readings, and force and moment along body axes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop_export.agreement import AXES, Compared, has_axes, loads_at, rigid_loads
from stoop_export.jsbsim_flight import (
    PLANET,
    Record,
    file_name,
    fly,
    frames_per_sample,
    instruments,
    joined,
    jsbsim_readings,
    own_readings,
    relative_differences,
)
from stoop_export.reference_flight import states_of


@dataclass(frozen=True, eq=False)
class Comparison:
    """One maneuver, flown by our simulation and by JSBSim.

    Attributes
    ----------
    record : Record
    own, fine : (n, n_y), our simulation: a step per sample, and a step per frame of JSBSim
    flat, earth : (n, n_y), JSBSim on the flat planet and on its Earth
    own_loads, flat_loads : (n, 6), :data:`AXES` of both; (n, 0) where our equations are reduced
    """

    record: Record
    own: FloatArray
    fine: FloatArray
    flat: FloatArray
    earth: FloatArray
    own_loads: FloatArray
    flat_loads: FloatArray

    @property
    def relative(self) -> dict[str, float]:
        """Largest difference of each channel over its largest magnitude, JSBSim against our simulation."""
        return relative_differences(self.record.vehicle.outputs, self.own, self.flat)

    @property
    def compared(self) -> Compared:
        """Every axis and channel, on the flat planet."""
        names = (*(AXES if self.own_loads.size else ()), *self.record.vehicle.outputs)
        ours, theirs = np.hstack([self.own_loads, self.own]), np.hstack([self.flat_loads, self.flat])
        return Compared("JSBSim, flat planet", self.record.title, names, ours, theirs)

    def __str__(self) -> str:
        """Return the largest difference of all channels as a sentence."""
        channel, largest = max(self.relative.items(), key=lambda item: item[1])
        return f"{self.record.title}: JSBSim within {largest:.1e} of each channel's maximum (largest in {channel})."


def compare(root: Path, record: Record) -> Comparison:
    """Fly a maneuver by our equations and in JSBSim, whose root folder holds the exported aircraft.

    StoopError when the flight diverges, or JSBSim is not there.
    """
    vehicle, name, parts = record.vehicle, file_name(record.vehicle.name), [*record.parts()]
    own, fine = (own_readings(record, steps) for steps in (1, frames_per_sample(record.dt)))
    flown, read = [fly(root, name, part, root / PLANET) for part in parts], instruments(vehicle)
    flat = joined(read(one, record.dt) for one in flown)
    earth = jsbsim_readings(root, name, record, None)
    if not has_axes(vehicle):
        ours = flown_loads = np.zeros((len(record.time), 0))
    else:
        forces, rates, turning = ("XYZ", "pqr", ("pdot", "qdot", "rdot"))
        theirs = (
            rigid_loads(vehicle, *(np.stack([one[n] for n in names]) for names in (forces, rates, turning))).T
            for one in flown
        )
        ours, flown_loads = joined(loads_at(part, states_of(part)) for part in parts), joined(theirs)
    return Comparison(record, own, fine, flat, earth, ours, flown_loads)
