"""Roll modes with the lag of a servo, and vehicles that take commands, for loops of autopilots."""

import numpy as np
from numpy.typing import ArrayLike

from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries
from stoop_studies.verify import scenes
from stoop_tune.loops import Plants

TAIL = {"CA_SV_CS_COUNT": 4.0} | {f"CA_SV_CS{i}_TYPE": float(kind) for i, kind in enumerate((1, 2, 7, 8))}
SURFACES = {"elevator": ("pitch", -0.4), "aileron": ("roll", 0.3), "rudder": ("yaw", -0.4)}


def rolling(damping: ArrayLike, effect: ArrayLike = 30, late: float = 0.0, servo: ArrayLike = 1) -> Plants:
    """Return a roll mode for each damping (d,), effectiveness and sign of the servo (d,), late by so much."""
    damping = np.asarray(damping, dtype=float)
    A = np.tile([[0.0, 0.0, 0.0], [0.0, -15.0, 0.0], [1.0, 0.0, 0.0]], (len(damping), 1, 1))
    A[:, 0, 0], A[:, 0, 1] = -damping, effect
    B = np.tile([[0.0], [15.0], [0.0]], (len(damping), 1, 1)) * np.reshape(servo, (-1, 1, 1))
    return Plants(("p", "aileron.lag", "phi"), A, B, np.full((len(damping), 1), late))


def quad(kind: str = "motor", **rotors: float) -> Vehicle:
    vehicle = builtin_vehicle("quad-x")
    channels = {("rotor", n, "channel"): f"{kind}_{i}" for i, n in enumerate(vehicle.file.rotor, 1)}
    return with_entries(vehicle, channels | {("rotors", n): x for n, x in rotors.items()})


def wing(**servo: float) -> Vehicle:
    mixes = {("controls", c, "mix"): {f"control_{a}": g} for c, (a, g) in SURFACES.items()}
    more = {("controls", c, n): x for c in SURFACES for n, x in servo.items()}
    return with_entries(scenes.aircraft(), mixes | more)


def v_tail(vehicle: Vehicle, pitch: float, roll: float, yaw: float) -> Vehicle:
    """Return the airplane with servos of two ailerons and of a V-tail that move it so far."""
    elevator, rudder = {"servo_3": pitch / 2, "servo_4": pitch / 2}, {"servo_3": yaw / 2, "servo_4": -yaw / 2}
    mixes = {"elevator": elevator, "aileron": {"servo_1": -roll / 2, "servo_2": roll / 2}, "rudder": rudder}
    return with_entries(vehicle, {("controls", c, "mix"): mix for c, mix in mixes.items()})
