"""A flight in which pulses are told to be motors, as the vehicle file knows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.flight import Flight
from stoop.vehicle import Vehicle
from stoop.vehicle.rotors_schema import Rotor


def with_motors(flight: Flight, vehicle: Vehicle | None) -> Flight:
    """Return a flight with a motor_N (rotor_N where pulses set a speed) for each pulse of a rotor that lifts.

    What is in the air, and what was commanded about an axis, is told by motors where there are any; pulses alone may
    be surfaces.
    """
    if vehicle is None or vehicle.file.rotors is None:
        return flight
    kind = "motor" if vehicle.file.rotors.drive == "command" else "rotor"
    if any(str(name).startswith(f"{kind}_") for name in flight.data):
        return flight
    gain, idle = vehicle.value("rotors.gain"), vehicle.value("rotors.idle")
    made = {
        channel.replace("pwm", kind): ("time", _command(flight.column(channel), gain, idle))
        for channel in dict.fromkeys(rotor.channel for rotor in vehicle.file.rotor.values() if _lifts(rotor))
        if channel.startswith("pwm_") and channel in flight.data
    }
    return replace(flight, data=flight.data.assign(made)) if made else flight


def _command(x: FloatArray, gain: float, idle: float) -> FloatArray:
    return np.asarray(np.maximum(gain * (x - idle), 0.0))


def _lifts(rotor: Rotor) -> bool:
    """Tell whether a rotor pulls up rather than along."""
    if rotor.axis is None:
        return True
    forward, right, down = (number.value for number in rotor.axis)
    return -down > math.hypot(forward, right)
