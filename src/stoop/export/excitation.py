"""What an exported aircraft is flown through when no recorded inputs are at hand: every control in turn, from trim."""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.errors import SimulationError
from stoop.export.flown import Record, own_readings
from stoop.simulate import Maneuver, Trim
from stoop.simulate.fly import flown_inputs
from stoop.vehicle import Vehicle

RATE: Final = 100.0  #: Hz
DURATIONS: Final = (30.0, 10.0, 3.0)  #: s; the first over which the open loop does not diverge
AMPLITUDE: Final = 0.03  #: rad


def every_control(
    vehicle: Vehicle, point: Trim, duration: float = 30.0, amplitude: float = AMPLITUDE
) -> Maneuver:
    """Return a 3-2-1-1 on each control one after the other, then a doublet on each."""
    count = max(len(vehicle.controls), 1)
    gap = 0.45 * duration / count
    moves = [
        {
            "control": c,
            "shape": shape,
            "start": first + i * gap,
            "step": min(step, gap / 8.0),
            "amplitude": amplitude,
        }
        for shape, first, step in (("3-2-1-1", 0.03 * duration, 0.3), ("doublet", 0.53 * duration, 0.6))
        for i, c in enumerate(vehicle.controls)
    ]
    return Maneuver.model_validate(
        {
            "duration": duration,
            "rate": RATE,
            "airspeed": point.start["V"],
            "altitude": point.start["h"],
            "input": moves,
        }
    )


def record(vehicle: Vehicle, point: Trim, maneuver: Maneuver) -> Record:
    """Return a maneuver from a steady flight, the thrust that holds it put into the vehicle."""
    flown = steady_vehicle(vehicle, point)
    return Record(flown, point.start, maneuver.time, flown_inputs(flown, maneuver, point))


def steady_vehicle(vehicle: Vehicle, point: Trim) -> Vehicle:
    """Return the vehicle with the numbers that its steady flight sets: a constant thrust."""
    return vehicle.with_numbers({name: {"value": value} for name, value in point.changes.items()})


def steady(vehicle: Vehicle, point: Trim, duration: float = 30.0) -> Record:
    """Return a steady flight."""
    time = np.arange(round(duration * RATE) + 1) / RATE
    return Record(
        steady_vehicle(vehicle, point), point.start, time, np.repeat(point.inputs[None, :], len(time), axis=0)
    )


def excited(vehicle: Vehicle, point: Trim) -> Record | None:
    """Return the longest of :data:`DURATIONS` of :func:`every_control` that does not diverge; None where all do."""
    for duration in DURATIONS:
        out = record(vehicle, point, every_control(vehicle, point, duration))
        try:
            own_readings(out)
        except SimulationError:
            continue
        return out
    return None
