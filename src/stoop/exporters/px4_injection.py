"""Maneuvers for PX4: a script that sends body rates over MAVLink in offboard mode, for airplanes.

In offboard mode PX4 takes body rates from SET_ATTITUDE_TARGET, but no surfaces. Its rate controller gives
u = FF k s + P k^2 (s - w) for a set-point s and a rate w, plus an integral; k = FW_AIRSPD_TRIM over the airspeed, or 1 without
FW_ARSP_SCALE_EN. With s = (u + P k^2 w) / (FF k + P k^2), w the rate that the model expects, the surfaces move by the designed u
where the model is right, and the aircraft follows the expected motion where it is not.

References
----------
PX4 documentation, "Offboard Mode" and "Logging"; PX4-Autopilot, ``src/modules/fw_rate_control/FixedwingRateControl.cpp``;
MAVLink common messages, SET_ATTITUDE_TARGET (82) and MAV_CMD_DO_SET_MODE (176).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.csv_text import csv_text
from stoop.exporters.injection import AXES, AXIS_OF, Injection, Target, pair, template

KNOWN: Final = ("aileron", "elevator", "rudder")
STREAM: Final = 50.0  #: Hz of the set-points
TYPES: Final = {int: 6, float: 9}  #: of parameters, MAV_PARAM_TYPE
PARAMETERS: Final = {
    "SDLOG_PROFILE": 25,  # bits 0 default, 3 system identification, 4 high rate
    "SDLOG_MODE": 0,  # from arming to disarming
    "IMU_GYRO_RATEMAX": 400,  # Hz
    "COM_OF_LOSS_T": 0.5,  # s
    "COM_OBL_RC_ACT": 5,  # Hold where the script no longer sends
}


def _px4_files(injection: Injection) -> dict[str, str]:
    """Return script, set-points and parameters.

    Raises
    ------
    SimulationError
        A throw is exceeded.
    """
    maneuver = injection.maneuver
    moved = {AXIS_OF[control]: x for control, x in injection.outputs().items()}
    time = injection.at(STREAM)
    columns = {"time_s": time}
    for axis, rate in AXES.items():
        expected = injection.expected(rate)
        columns[f"{axis}_output"] = np.interp(time, maneuver.time, moved.get(axis, np.zeros(len(expected))))
        columns[f"{axis}_rate_rad_s"] = np.interp(time, maneuver.time, expected - expected[0])
    rows = ([f"{round(v, 9) + 0.0:.9g}" for v in row] for row in zip(*columns.values(), strict=True))
    script = template(
        "px4_offboard.py.txt", name=injection.name, pitch_trim=f"{injection.trim.start['theta']:.5f}",
        bank=pair(injection.angles("phi"), 4), pitch=pair(injection.angles("theta"), 4),
        airspeed=pair(injection.airspeeds(), 2),
    )  # fmt: skip
    lines = [f"1\t1\t{key}\t{value}\t{TYPES[type(value)]}" for key, value in PARAMETERS.items()]
    return {
        "fly_px4.py": script,
        "px4_setpoints.csv": csv_text(tuple(columns), rows, "\n"),
        "px4.params": "# Onboard parameters: vehicle, component, name, value, type\n"
        + "\n".join(lines)
        + "\n",
    }


PX4: Final = Target(
    _px4_files, ("fly_px4.py", "px4_setpoints.csv", "px4.params"), on_wings=True, on_rotors=False,
    advice="rates alone would let a multirotor drift; choose --for ardupilot or crazyflie", surfaces=KNOWN,
    needs=tuple(AXES.values()),
)  # fmt: skip
