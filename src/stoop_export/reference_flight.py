"""A flight of our own simulation that another simulator repeats: states, and channels as surfaces and rotors receive them.

On wings it is flown in open loop from a steady flight. On rotors, where an open loop diverges, the autopilot flies
set-points; the other simulator is then given the recorded channels and restarted at our state every `RESTART` seconds, so that
what is compared is the model and not the growth of rounding errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop import Vehicle
from stoop.extend import motion
from stoop.extend.arrays import FloatArray, rotations
from stoop.extend.errors import SimulationError
from stoop.extend.variables import FAMILIES
from stoop_export.jsbsim_flight import RATE, Record, excitation_record, relative_differences, steady_record

DURATION: Final = 30.0  #: s
RESTART: Final = 1.0  #: s, of a flight on rotors
SPEEDS: Final = {"north": 3.0, "east": -2.0, "down": -1.0}  #: m/s, set-points of the flight on rotors
HEADING: Final = 0.5  #: rad
HOVER: Final = 5.0  #: s, of a hover without an autopilot
_TITLE: Final = f"{DURATION:g} s under the autopilot, restarted every {RESTART:g} s"


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
        return relative_differences(self.vehicle.outputs, self.readings, readings)


def reference_flight(vehicle: Vehicle, point: motion.Trim) -> ReferenceFlight | None:
    """Return the flight from a steady flight; None where the simulation diverges even in a short one."""
    if point.on_wings:
        record = excitation_record(vehicle, point)
        if record is None:
            return None
        vehicle, rows = record.vehicle, record.vehicle.parameter_rows()
        begin = vehicle.initial_states(record.start, rows, record.inputs[0])
        inputs = vehicle.late_inputs(record.inputs, rows, record.dt)
        states = vehicle.states_along(rows, begin, inputs, record.dt)
        readings = np.asarray(vehicle.kernel().trajectories(rows, begin, inputs, record.dt)[0])
        return ReferenceFlight(vehicle, record.time, inputs, states, readings, (0,), record.title)
    record, states = _flight_on_rotors(vehicle, point)
    vehicle, rows = record.vehicle, record.vehicle.parameter_rows()
    inputs = vehicle.late_inputs(record.inputs, rows, record.dt)
    readings = vehicle.readings_along(rows, states, inputs)
    restarts = tuple(range(0, len(record.time) - 1, round(RESTART / record.dt)))
    return ReferenceFlight(vehicle, record.time, inputs, states, readings, restarts, _TITLE)


def _flight_on_rotors(vehicle: Vehicle, point: motion.Trim) -> tuple[Record, FloatArray]:
    """Return the flight of the set-points under the autopilot, its start still open, and its states (n, n_x)."""
    (flown,) = motion.fly_together([(vehicle, set_points(point.start["h"]))])
    if isinstance(flown, SimulationError):
        raise flown
    vehicle = vehicle.with_numbers({name: {"value": x} for name, x in flown.trim.changes.items()})
    return Record(vehicle, {}, flown.time, flown.inputs, _TITLE), np.asarray(flown.states)


def steady_start(vehicle: Vehicle, point: motion.Trim) -> Record:
    """Return a steady flight to start from: 30 s on wings; on rotors, where rounding errors grow, a few seconds."""
    return steady_record(vehicle, point, DURATION if point.on_wings else HOVER)


def reference_record(vehicle: Vehicle, point: motion.Trim) -> Record | None:
    """Return the flight from a steady flight as a record with its recorded channels; None where even a short one diverges."""
    if point.on_wings:
        return excitation_record(vehicle, point)
    record, states = _flight_on_rotors(vehicle, point)
    (_, start), *later = _starts(record, states)
    return replace(record, start=start, restarts=tuple(later))


def with_restarts(record: Record) -> Record:
    """Return a flight on rotors with restarts on its own path, so that rounding errors do not grow far; others as they are."""
    if not record.vehicle.file.rotor or "V" in record.start:
        return record
    states = states_of(record)
    if not np.isfinite(states).all():
        return record
    title = f"{record.title}, restarted every {RESTART:g} s"
    return replace(record, title=title, restarts=tuple(_starts(record, states)[1:]))


def states_of(record: Record) -> FloatArray:
    """Return the states (n, n_x) of a record, simulated from its start."""
    vehicle, rows = record.vehicle, record.vehicle.parameter_rows()
    begin = vehicle.initial_states(record.start, rows, record.inputs[0])
    inputs = vehicle.late_inputs(record.inputs, rows, record.dt)
    return vehicle.states_along(rows, begin, inputs, record.dt)


def _starts(record: Record, states: FloatArray) -> list[tuple[int, dict[str, float]]]:
    """Return samples and starts of restarts along states (n, n_x); lags are differences from their commands."""
    vehicle, rows, out = record.vehicle, record.vehicle.parameter_rows(), []
    for k in range(0, len(states) - 1, max(1, round(RESTART / record.dt))):
        x = dict(zip(vehicle.states, states[k].tolist(), strict=True))
        angles = rotations.euler_angles(np.array([[x.pop(f"e{i}") for i in range(4)]]))[0]
        for name in (n for n in x if n.endswith(".lag")):
            x[name] -= float(vehicle.commanded(name.removesuffix(".lag"), rows, record.inputs[k])[0])
        out.append((k, x | dict(zip(FAMILIES["euler"], angles.tolist(), strict=True))))
    return out


def set_points(altitude: float) -> motion.Maneuver:
    """Return a maneuver on rotors: velocities along each axis there and back, then a heading."""
    inputs = [
        {"control": name, "shape": "doublet", "start": 1.0 + 7.0 * i, "step": 3.0, "amplitude": amplitude}
        for i, (name, amplitude) in enumerate((SPEEDS | {"heading": HEADING}).items())
    ]
    return motion.Maneuver.model_validate(
        {"duration": DURATION, "rate": RATE, "altitude": altitude, "input": inputs}
    )


def slopes(inputs: FloatArray, dt: float) -> FloatArray:
    """Return the rates (n, n_u) with which inputs (n, n_u) go from a sample to the next, per s; zero at the last."""
    return np.vstack([np.diff(inputs, axis=0) / dt, np.zeros((1, inputs.shape[1]))])
