"""A flight of our own simulation that another simulator repeats: states, and channels as surfaces and rotors receive them.

On wings it is flown in open loop from a steady flight. On rotors, where an open loop diverges, the autopilot flies
set-points; the other simulator is then given the recorded channels and restarted at our state every `RESTART` seconds, so that
what is compared is the model and not the growth of rounding errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.exporters.jsbsim_flight import RATE, excitation_record, relative_differences
from stoop.simulation import Trim, initial_states, parameter_rows
from stoop.simulation.delays import late_inputs
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import Maneuver
from stoop.simulation.trajectories import readings_along, states_along
from stoop.vehicle import Vehicle

DURATION: Final = 30.0  #: s
RESTART: Final = 1.0  #: s, of a flight on rotors
SPEEDS: Final = {"north": 3.0, "east": -2.0, "down": -1.0}  #: m/s, set-points of the flight on rotors
HEADING: Final = 0.5  #: rad


@dataclass(frozen=True, eq=False)
class ReferenceFlight:
    """A flight of our own simulation.

    Attributes
    ----------
    vehicle : with the numbers that it is flown with
    time : (n,), s
    inputs : (n, n_u), channels as surfaces and rotors receive them, linear between samples
    states, readings : (n, n_x), (n, n_y); readings as they arise, not delayed
    restarts : indices of the samples where the other simulator is given our state
    title : str
    """

    vehicle: Vehicle
    time: FloatArray
    inputs: FloatArray
    states: FloatArray
    readings: FloatArray
    restarts: tuple[int, ...]
    title: str

    @property
    def dt(self) -> float:
        """Sample period, s."""
        return float(self.time[1] - self.time[0])

    def parts(self) -> Iterator[slice]:
        """Yield the samples from each restart to the next, both included."""
        last = len(self.time) - 1
        for a, b in zip(self.restarts, (*self.restarts[1:], last), strict=True):
            yield slice(a, b + 1)

    def differences(self, readings: FloatArray) -> dict[str, float]:
        """Return the largest difference of each channel from other readings (n, n_y), over the channel's largest magnitude."""
        return relative_differences(self.vehicle, self.readings, readings)


def reference_flight(vehicle: Vehicle, point: Trim) -> ReferenceFlight | None:
    """Return the flight from a steady flight; None where the simulation diverges even in a short one."""
    if "V" in point.start:
        record = excitation_record(vehicle, point)
        if record is None:
            return None
        vehicle, rows = record.vehicle, parameter_rows(record.vehicle)
        begin = initial_states(vehicle, record.start, rows, record.inputs[0])
        inputs = late_inputs(vehicle, record.inputs, rows, record.dt)
        states = states_along(vehicle, rows, begin, inputs, record.dt)
        readings = np.asarray(vehicle.kernel().trajectories(rows, begin, inputs, record.dt)[0])
        return ReferenceFlight(vehicle, record.time, inputs, states, readings, (0,), record.title)
    flown = fly(vehicle, set_points(point.start["h"]))
    vehicle = vehicle.with_numbers({name: {"value": x} for name, x in flown.trim.changes.items()})
    rows = parameter_rows(vehicle)
    inputs = late_inputs(vehicle, flown.inputs, rows, 1.0 / RATE)
    states = np.asarray(flown.states)
    readings = readings_along(vehicle, rows, states, inputs)
    restarts = tuple(range(0, len(flown.time) - 1, round(RESTART * RATE)))
    title = f"{DURATION:g} s under the autopilot, restarted every {RESTART:g} s"
    return ReferenceFlight(vehicle, flown.time, inputs, states, readings, restarts, title)


def set_points(altitude: float) -> Maneuver:
    """Return a maneuver on rotors: velocities along each axis there and back, then a heading."""
    inputs = [
        {"control": name, "shape": "doublet", "start": 1.0 + 7.0 * i, "step": 3.0, "amplitude": amplitude}
        for i, (name, amplitude) in enumerate((SPEEDS | {"heading": HEADING}).items())
    ]
    return Maneuver.model_validate(
        {"duration": DURATION, "rate": RATE, "altitude": altitude, "input": inputs}
    )


def slopes(inputs: FloatArray, dt: float) -> FloatArray:
    """Return the rates (n, n_u) with which inputs (n, n_u) go from a sample to the next, per s; zero at the last."""
    return np.vstack([np.diff(inputs, axis=0) / dt, np.zeros((1, inputs.shape[1]))])
