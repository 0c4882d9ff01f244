"""The F450 flown: a climb with multisines on all four axes and on the velocity, read at 100 Hz."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop_studies.verify.jsbsim_truth.machine import FOOT, POUND, SLUG
from stoop_studies.verify.multirotor.craft import FOOT_POUND, RATE, RPM, SPEEDS, STEP, THRUSTS, TORQUES, Craft
from stoop_studies.verify.multirotor.pilot import HOVER, Pilot

BEFORE: Final = 6.0  #: s, in which it takes off and climbs; not recorded
DURATION: Final = 24.0  #: s, recorded
CLIMB: Final = 3.0  #: m/s: propellers are told apart from still air only where the air comes from one side
WANTED: Final = {0: (6.0, 0.06, 6, 0), 1: (6.0, 0.06, 6, 2), 2: (1.4, 0.05, 7, 5)}
SHAKEN: Final = {0: (2.5, 0.4, 9, 1), 1: (2.5, 0.4, 9, 2), 2: (1.0, 0.3, 8, 3), 3: (1.5, 1.0, 6, 4)}
#: axis -> amplitude (m/s, rad/s2, m/s2), lowest frequency (Hz), how many sines, which phases
MOTORS, TURNS, LIFTS, TWISTS = (
    tuple(f"{of}_{i + 1}" for i in range(4)) for of in ("motor", "rotor", "thrust", "torque")
)  #: channels: command, speed (rad/s), thrust (N) and torque (N m) of each rotor
AIRFRAME: Final = ("drag_x", "drag_y", "drag_z")
READ: Final = {
    "vn": ("velocities/v-north-fps", FOOT), "ve": ("velocities/v-east-fps", FOOT), "vd": ("velocities/v-down-fps", FOOT),
    **{a: (f"velocities/{a}i-rad_sec", 1.0) for a in "pqr"},
    **{a: (f"attitude/{a}-rad", 1.0) for a in ("phi", "theta", "psi")},
    **{f"a{a}": (f"accelerations/a-pilot-{a}-ft_sec2", FOOT) for a in "xyz"},
    "altitude": ("position/h-sl-ft", FOOT), "density": ("atmosphere/rho-slugs_ft3", SLUG / FOOT**3),
    "u": ("velocities/u-aero-fps", FOOT), "v": ("velocities/v-aero-fps", FOOT), "w": ("velocities/w-aero-fps", FOOT),
    **dict(zip(TURNS, ((name, RPM) for name in SPEEDS), strict=True)),
    **dict(zip(LIFTS, ((name, POUND) for name in THRUSTS), strict=True)),
    **dict(zip(TWISTS, ((name, FOOT_POUND) for name in TORQUES), strict=True)),
    **{f"drag_{a}": (f"forces/fb{a}-aero-lbs", POUND) for a in "xyz"},
}  #: channel -> property and its unit: gyros sense the rate in space; the accelerometer is at the center of gravity  # fmt: skip


@dataclass(frozen=True, eq=False)
class Recording:
    """A flight without noise.

    Attributes
    ----------
    time : (n,), s
    columns : mapping
        Channel -> (n,), SI.
    gravity : float, m/s2
        What a body at rest feels there, the turning of the Earth included.
    """

    time: FloatArray
    columns: dict[str, FloatArray]
    gravity: float


def multisine(time: FloatArray, amplitude: float, lowest: float, count: int, phase: int) -> FloatArray:
    """Return a sum of sines (n,), a third of an octave apart, of Schroeder's phases; its standard deviation is a half."""
    each = np.arange(count)
    frequency = lowest * 2.0 ** ((each + phase / 6.0) / 3.0)
    angle = 2.0 * np.pi * frequency * time[:, None] - np.pi * each * (each + phase) / count
    return np.asarray(amplitude * np.sqrt(0.5 / count) * np.sin(angle).sum(axis=1))


def pilot(time: FloatArray) -> Pilot:
    """Return the autopilot with its maneuver; before 0 s it only climbs."""
    grown = np.clip(time + 2.0, 0.0, 1.0)
    wanted, shaken = np.zeros((len(time), 3)), np.zeros((len(time), 4))
    wanted[:, 2] = -CLIMB * np.clip((time + BEFORE) / 2.0, 0.0, 1.0)
    for axis, (amplitude, lowest, count, phase) in WANTED.items():
        wanted[:, axis] += grown * multisine(time, amplitude, lowest, count, phase)
    for axis, (amplitude, lowest, count, phase) in SHAKEN.items():
        shaken[:, axis] += grown * multisine(time, amplitude, lowest, count, phase)
    return Pilot(wanted, shaken)


def fly(craft: Craft) -> Recording:
    """Let go of the vehicle and fly the maneuver.

    Commands run on straight lines between the samples, as the record is taken to say.
    """
    time = np.arange(round((BEFORE + DURATION) * RATE) + 1) / RATE - BEFORE
    autopilot, fine = pilot(time), round(1.0 / (RATE * STEP))
    commands = np.full((len(time), 4), HOVER)
    craft.command(commands[0])
    craft.settle()
    gravity = craft["accelerations/gravity-ft_sec2"] * FOOT
    craft.hold(False)
    rows = [_row(craft)]
    for k in range(1, len(time)):
        commands[k] = autopilot(k, dict(zip(READ, rows[-1].tolist(), strict=True)))
        for j in range(1, fine + 1):
            craft.command(commands[k - 1] + (commands[k] - commands[k - 1]) * (j / fine))
            craft.run(1)
        rows.append(_row(craft))
    flown = time >= 0.0
    columns = dict(
        zip((*READ, *MOTORS), np.column_stack([np.array(rows), commands])[flown].T.copy(), strict=True)
    )
    return Recording(time[flown], columns, gravity)


def _row(craft: Craft) -> FloatArray:
    return np.array([craft[name] * unit for name, unit in READ.values()])
