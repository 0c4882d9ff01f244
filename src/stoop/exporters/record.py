"""Records that an exported model is flown through, by our own simulation here; what a vehicle is called in files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import WRAPPED
from stoop.errors import SimulationError
from stoop.simulation import Trim, initial_states, parameter_rows
from stoop.simulation.delays import late_inputs, late_outputs
from stoop.simulation.maneuver import Maneuver
from stoop.simulation.trim import inputs_about
from stoop.vehicle import Vehicle

RATE: Final = 100.0  #: Hz
DURATIONS: Final = (30.0, 10.0, 3.0)  #: s; the first over which the open loop does not diverge
AMPLITUDE: Final = 0.03  #: rad


@dataclass(frozen=True, eq=False)
class Record:
    """A maneuver that is simulated open loop.

    Attributes
    ----------
    vehicle : Vehicle
        With the numbers that it is flown with, biases too.
    start : mapping
        Initial state by :data:`stoop.simulation.START_NAMES`; ``NAME.lag`` adds to a lagged deflection, rad.
    time : (n,), s, uniform
    inputs : (n, n_u)
        As recorded, in the order of ``vehicle.inputs``.
    """

    vehicle: Vehicle
    start: Mapping[str, float]
    time: FloatArray
    inputs: FloatArray

    @property
    def dt(self) -> float:
        """Sample period, s."""
        return float(self.time[1] - self.time[0])


def own_readings(record: Record, steps: int = 1) -> FloatArray:
    """Return the readings (n, n_y) of our own simulation.

    Parameters
    ----------
    record : Record
    steps : int
        Runge-Kutta steps per sample. A delay that is no whole number of steps is interpolated with a cubic
        through the samples, which overshoots where the input jumps; with more steps the cubic becomes the line.

    Raises
    ------
    SimulationError
        The simulation diverges.
    """
    vehicle, count = record.vehicle, len(record.inputs)
    fine = np.arange((count - 1) * steps + 1) / steps
    inputs = np.stack([np.interp(fine, np.arange(count), column) for column in record.inputs.T], axis=1)
    rows, dt = parameter_rows(vehicle), record.dt / steps
    begin = initial_states(vehicle, record.start, rows, inputs[0])
    flown = vehicle.kernel().trajectories(rows, begin, late_inputs(vehicle, inputs, rows, dt), dt)
    out = late_outputs(vehicle, flown[:, ::steps].copy(), rows, record.dt)[0]
    if not np.isfinite(out).all():
        last = record.time[int(np.argmin(np.isfinite(out).all(axis=1)))]
        raise SimulationError(
            f"{vehicle.where}: the flight diverges at {last:.2f} s; there is nothing to compare"
        )
    return np.asarray(out)


def differences(vehicle: Vehicle, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return b - a of readings (n, n_y), angles taken to the nearest turn."""
    out = b - a
    for i, name in enumerate(vehicle.outputs):
        if name in WRAPPED:
            out[:, i] -= 2.0 * np.pi * np.round(out[:, i] / (2.0 * np.pi))
    return out


def relative_differences(vehicle: Vehicle, ours: FloatArray, theirs: FloatArray) -> dict[str, float]:
    """Return the largest difference of each channel over the channel's largest magnitude."""
    apart = np.abs(differences(vehicle, ours, theirs)).max(axis=0)
    largest = np.abs(ours).max(axis=0)
    return {
        c: float(d / m) if m > 0.0 else float(d)
        for c, d, m in zip(vehicle.outputs, apart, largest, strict=True)
    }


def every_control(
    vehicle: Vehicle, point: Trim, duration: float = 30.0, amplitude: float = AMPLITUDE
) -> Maneuver:
    """Return a 3-2-1-1 on each control one after the other, then a doublet on each."""
    count = max(len(vehicle.controls), 1)
    gap = 0.45 * duration / count
    moves = [
        {"control": c, "shape": shape, "start": first + i * gap, "step": min(step, gap / 8.0), "amplitude": amplitude}
        for shape, first, step in (("3-2-1-1", 0.03 * duration, 0.3), ("doublet", 0.53 * duration, 0.6))
        for i, c in enumerate(vehicle.controls)
    ]  # fmt: skip
    start = {"airspeed": point.start["V"], "altitude": point.start["h"]}
    return Maneuver.model_validate({"duration": duration, "rate": RATE, **start, "input": moves})


def maneuver_record(vehicle: Vehicle, point: Trim, maneuver: Maneuver) -> Record:
    """Return a maneuver from a steady flight, with the vehicle's thrust set to that of the steady flight."""
    flown = steady_vehicle(vehicle, point)
    return Record(
        flown,
        point.start,
        maneuver.time,
        inputs_about(flown, point, maneuver.deflections(), len(maneuver.time)),
    )


def steady_vehicle(vehicle: Vehicle, point: Trim) -> Vehicle:
    """Return the vehicle with the numbers that its steady flight sets: a constant thrust."""
    return vehicle.with_numbers({name: {"value": value} for name, value in point.changes.items()})


def steady_record(vehicle: Vehicle, point: Trim, duration: float = 30.0) -> Record:
    """Return a steady flight."""
    time = np.arange(round(duration * RATE) + 1) / RATE
    return Record(
        steady_vehicle(vehicle, point), point.start, time, np.repeat(point.inputs[None, :], len(time), axis=0)
    )


def excitation_record(vehicle: Vehicle, point: Trim) -> Record | None:
    """Return the longest of :data:`DURATIONS` of :func:`every_control` that does not diverge; None where all do."""
    for duration in DURATIONS:
        out = maneuver_record(vehicle, point, every_control(vehicle, point, duration))
        try:
            own_readings(out)
        except SimulationError:
            continue
        return out
    return None


def without_turbulence(vehicle: Vehicle) -> tuple[Vehicle, tuple[Notice, ...]]:
    """Return the vehicle in calm air, and a notice where it had turbulence: gusts are weather, not aircraft."""
    if getattr(vehicle.file, "turbulence", None) is None:
        return vehicle, ()
    loadings = {
        loading: {name: value for name, value in numbers.items() if not name.startswith("turbulence.")}
        for loading, numbers in vehicle.file.loadings.items()
    }
    changes = {"turbulence": None, "loadings": loadings}
    return replace(vehicle, file=vehicle.file.model_copy(update=changes)), (
        notice("turbulence-not-exported", vehicle.name),
    )


def file_name(name: str) -> str:
    """Return a name for files and folders that any system takes."""
    out = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()[:60].strip("-")
    return out or "vehicle"


def identifier(name: str) -> str:
    """Return a name that a MATLAB function may have."""
    out = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_").lower()[:40].strip("_")
    return out if out[:1].isalpha() else f"vehicle_{out}".strip("_")
