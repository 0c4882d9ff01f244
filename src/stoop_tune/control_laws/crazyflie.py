"""Rate and attitude laws of the Crazyflie's cascaded PID.

Both loops run at 500 Hz in degrees [1]_: P and FF as usual, the sum of errors limited before its gain, D on the backward
difference of what is measured, through a second-order low-pass where that is enabled [2]_. The sum of the rate loop is limited
to 16 bits, and a command of 32767 is taken for one. Before that loop the gyro passes a second-order low-pass of 80 Hz at
1 kHz [3]_.

References
----------
.. [1] crazyflie-firmware, src/modules/src/controller/attitude_pid_controller.c and controller_pid.c
.. [2] crazyflie-firmware, src/utils/src/pid.c and filter.c; src/platform/interface/platform_defaults_cf2.h
.. [3] crazyflie-firmware, src/hal/src/sensors_bmi088_bmp3xx.c
.. [4] crazyflie-firmware, src/modules/src/power_distribution_quadrotor.c
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from stoop.extend.arrays import FloatArray
from stoop_tune.control_laws.filters import PASS, Filter, butterworth, difference, series
from stoop_tune.control_laws.mixing import by_place
from stoop_tune.control_laws.parameters import Parameters
from stoop_tune.control_laws.rate_law import ERROR, RATE, SETPOINT, Integral, RateLaw, Term, through

LOOP_RATE, GYRO_RATE, GYRO_CUTOFF = 500.0, 1000.0, 80.0  # Hz
FULL: Final = 32767.0  #: command of one
ALL: Final = 65535.0  #: of a motor
#: axis -> gains of the Crazyflie 2.1 (kp must be given), limit of its sum of errors [deg], and what its cutoff is called
AXES: Final = {
    "roll": ({"kp": None, "ki": 500.0, "kd": 2.5, "kff": 0.0}, 33.3, "omxFiltCut"),
    "pitch": ({"kp": None, "ki": 500.0, "kd": 2.5, "kff": 0.0}, 33.3, "omyFiltCut"),
    "yaw": ({"kp": None, "ki": 16.7, "kd": 0.0, "kff": 0.0}, 166.7, "omzFiltCut"),
}
#: axis -> gains of the attitude loop, and limit of its sum of errors [deg s]
ATTITUDE: Final = {
    "roll": ({"kp": 6.0, "ki": 3.0, "kd": 0.0, "kff": 0.0}, 20.0),
    "pitch": ({"kp": 6.0, "ki": 3.0, "kd": 0.0, "kff": 0.0}, 20.0),
    "yaw": ({"kp": 6.0, "ki": 1.0, "kd": 0.35, "kff": 0.0}, 360.0),
}
D_CUTOFF, ATTITUDE_CUTOFF = 30.0, 15.0  # Hz


def cascade(values: Mapping[str, float], axis: str) -> RateLaw:
    """Return the rate law of a Crazyflie about an axis, from its parameters."""
    own = Parameters(values, "Crazyflie")
    defaults, limit, cutoff = AXES[axis]
    per_radian = 1.0 / (math.radians(FULL))
    gains = {n: x * per_radian for n, x in own.named(f"pid_rate.{axis}_{{}}", defaults).items()}
    smooth = PASS
    if own.number("pid_rate.rateFiltEn", 0.0):
        smooth = butterworth(own.number(f"pid_rate.{cutoff}", D_CUTOFF), LOOP_RATE)
    sensing = {RATE: butterworth(GYRO_CUTOFF, GYRO_RATE)}
    return RateLaw(axis, LOOP_RATE, _terms(gains, limit, smooth), sensing=sensing, gyro_rate=GYRO_RATE)


def attitude(values: Mapping[str, float], axis: str) -> RateLaw:
    """Return the setpoint of the rate, rad/s, by that of an Euler angle and the angle, from the parameters of a Crazyflie."""
    own = Parameters(values, "Crazyflie")
    defaults, limit = ATTITUDE[axis]
    smooth = PASS
    if own.number("pid_attitude.attFiltEn", 0.0):
        smooth = butterworth(own.number("pid_attitude.attFiltCut", ATTITUDE_CUTOFF), LOOP_RATE)
    terms = _terms(own.named(f"pid_attitude.{axis}_{{}}", defaults), limit, smooth)
    return RateLaw(axis, LOOP_RATE, terms, limit=math.inf)


def _terms(gains: Mapping[str, float], limit: float, smooth: Filter) -> tuple[Term, ...]:
    """Return the terms of a PID whose sum of errors is limited, deg, and whose D passes a low-pass."""
    return (
        Term("P", through(ERROR, gains["kp"])),
        Term("I", ERROR, integral=Integral(gains["ki"], gains["ki"] * math.radians(limit))),
        Term("D", {RATE: series(difference(LOOP_RATE), smooth) * -gains["kd"]}),
        Term("FF", {SETPOINT: Filter((gains["kff"],))}),
    )


def mixing(values: Mapping[str, float], positions: FloatArray, turning: FloatArray) -> FloatArray:
    """Return how much each motor (n, 3), from 0 to 1, is commanded by a full command about each axis [4]_.

    Parameters
    ----------
    values : parameters; none of them counts
    positions : (n, 3) of rotors that push up, m from the center of gravity
    turning : (n,) one for counterclockwise as seen from above, minus one for clockwise
    """
    return FULL / ALL * by_place(positions, turning, (0.5, 0.5, 1.0))
