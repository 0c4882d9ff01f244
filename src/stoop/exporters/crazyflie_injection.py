"""Maneuvers for the Crazyflie: a script that sends the expected attitude over radio, while the firmware holds the height.

References
----------
Bitcraze, crazyflie-lib-python, ``cflib/crazyflie/commander.py`` (``send_zdistance_setpoint``); crazyflie-firmware,
``crtp_commander_generic.c`` (signs of the set-points) and ``docs/functional-areas/usd_deck`` (format of ``config.txt``).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from stoop.base.csv_text import csv_text
from stoop.errors import SimulationError
from stoop.exporters.injection import Injection, Target, pair, template

RATE: Final = 100.0  #: Hz, of set-points and log
MAX_ANGLE, MAX_YAW_RATE, MAX_HEIGHT = 30.0, 200.0, 0.5  #: deg, deg/s, and m about the height of the hover
LOGGED: Final = (
    *(f"{sensor}.{axis}" for sensor in ("gyro", "acc") for axis in "xyz"),
    *(f"stateEstimate.{name}" for name in ("qx", "qy", "qz", "qw", "vx", "vy", "vz", "z")),
    *(f"motor.m{i}" for i in range(1, 5)), "pm.vbat",
)  #: one block of the card  # fmt: skip
BUFFER: Final = 512  #: bytes
CONFIG: Final = """\
1     # version
{buffer}   # buffer size in bytes
stoop # file name
0     # enable on startup
on:fixedFrequency
{rate:.0f}   # Hz
1     # synchronous
{variables}
"""


def _crazyflie_files(injection: Injection) -> dict[str, str]:
    """Return script, set-points and the configuration of the card.

    Raises
    ------
    SimulationError
        The set-points would be too large.
    """
    maneuver = injection.maneuver
    time = injection.at(RATE)
    climb = np.interp(time, maneuver.time, -injection.expected("vd"))
    height = np.concatenate([[0.0], np.cumsum(0.5 * (climb[1:] + climb[:-1]) / RATE)])
    columns = {
        "time_s": time,
        **{
            key: np.interp(time, maneuver.time, np.degrees(injection.expected(channel)))
            for key, channel in (("roll_deg", "phi"), ("pitch_deg", "theta"), ("yawrate_deg_s", "r"))
        },
        "height_m": height,
    }
    limits = (
        ("roll_deg", MAX_ANGLE),
        ("pitch_deg", MAX_ANGLE),
        ("yawrate_deg_s", MAX_YAW_RATE),
        ("height_m", MAX_HEIGHT),
    )
    for key, limit in limits:
        most = float(np.abs(columns[key]).max())
        if most > limit:
            advice = (
                "lower --amplitude heave=..., or exclude it with --amplitude heave=0"
                if key == "height_m"
                else "lower --amplitude or narrow --within"
            )
            raise SimulationError(
                f"crazyflie: the maneuver needs {key} {most:.3g}, and the script sends {limit:g} at most; {advice}"
            )
    rows = ([f"{round(v, 6) + 0.0:.6g}" for v in row] for row in zip(*columns.values(), strict=True))
    roll, pitch = (
        pair((math.degrees(low), math.degrees(high)), 1)
        for low, high in map(injection.angles, ("phi", "theta"))
    )
    return {
        "fly_crazyflie.py": template(
            "crazyflie_setpoints.py.txt", name=injection.name, roll=roll, pitch=pitch
        ),
        "crazyflie_setpoints.csv": csv_text(tuple(columns), rows, "\n"),
        "config.txt": CONFIG.format(buffer=BUFFER, rate=RATE, variables="\n".join(LOGGED)),
    }


CRAZYFLIE: Final = Target(
    _crazyflie_files, ("fly_crazyflie.py", "crazyflie_setpoints.csv", "config.txt"), on_wings=False, on_rotors=True,
    advice="choose --for pilot, ardupilot or px4", needs=("phi", "theta", "r", "vd"),
)  # fmt: skip
