"""Rate laws of ArduPilot: planes, planes before 4.1, and copters.

The target passes FLTT and the error FLTE; D is the difference of that error, through FLTD; FF is of the filtered target [1]_.
A plane scales P, I and D by the square of `SCALING_SPEED` over airspeed, FF by the ratio itself over EAS2TAS, and commands
degrees of 45 [2]_. Before AC_PID (`RLL2SRV_P`), P and FF are of the target alone, D of the error, and I counts the error over
`RLL2SRV_TCONST` [3]_. `SMAX` lowers P and D only while the command oscillates faster than it allows, and is left out.

References
----------
.. [1] ArduPilot, libraries/AC_PID/AC_PID.cpp
.. [2] ArduPilot, libraries/APM_Control/AP_FW_Controller.cpp; ArduPlane/Attitude.cpp (calc_speed_scaler)
.. [3] ArduPilot, Plane-3.8, libraries/APM_Control/AP_RollController.cpp, AP_PitchController.cpp
.. [4] ArduPilot, libraries/AC_AttitudeControl/AC_AttitudeControl_Multi.cpp; AP_InertialSensor (INS_GYRO_FILTER)
.. [5] ArduPilot, libraries/AP_Motors/AP_MotorsMatrix.cpp (normalise_rpy_factors), AP_Motors_Thrust_Linearization.cpp
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from stoop.extend.arrays import FloatArray
from stoop_tune.control_laws.filters import Filter, butterworth, difference, low_pass, series
from stoop_tune.control_laws.mixing import by_place, thrust_slope
from stoop_tune.control_laws.parameters import Parameters
from stoop_tune.control_laws.rate_law import ERROR, RATE, SETPOINT, Integral, RateLaw, Term, through

FULL: Final = 45.0  #: degrees of a full command of a plane
PLANE: Final = {"roll": "RLL_RATE_{}", "pitch": "PTCH_RATE_{}", "yaw": "YAW_RATE_{}"}
OLD_PLANE: Final = {"roll": "RLL2SRV_{}", "pitch": "PTCH2SRV_{}"}
COPTER: Final = {"roll": "ATC_RAT_RLL_{}", "pitch": "ATC_RAT_PIT_{}", "yaw": "ATC_RAT_YAW_{}"}
#: P tells of which vehicle and version a log is
PLANE_DEFAULTS: Final = {
    "P": None, "I": 0.15, "D": 0.0, "FF": 0.345, "IMAX": 0.666, "FLTT": 3.0, "FLTE": 0.0, "FLTD": 12.0,
}  # fmt: skip
COPTER_DEFAULTS: Final = {
    "P": None, "I": 0.135, "D": 0.0036, "FF": 0.0, "IMAX": 0.5, "FLTT": 20.0, "FLTE": 0.0, "FLTD": 20.0,
}  # fmt: skip
OLD_DEFAULTS: Final = {"P": None, "TCONST": 0.5, "I": 0.3, "D": 0.08, "FF": 0.0, "IMAX": 3000.0}
NOTCHES: Final = ("INS_HNTCH_ENABLE", "INS_HNTC2_ENABLE")
SLOWEST: Final = 5.0  #: m/s, least that counts as the slowest airspeed
GYRO_RATE: Final = 1000.0  #: Hz, at which INS_GYRO_FILTER runs unless sampling is faster
#: parts of AC_PID that are left out, and act where they are not zero
LEFT_OUT: Final = {
    "NTF": "notch of the target", "NEF": "notch of the error", "PDMX": "limit of P and D",
    "D_FF": "FF of the target's derivative",
}  # fmt: skip


def plane(values: Mapping[str, float], axis: str, density_ratio: float = 1.0) -> RateLaw:
    """Return the rate law of a plane about an axis, from its parameters.

    Parameters
    ----------
    density_ratio : true over equivalent airspeed
    """
    own, pattern = Parameters(values, "ArduPilot"), PLANE[axis]
    gains = own.named(pattern, PLANE_DEFAULTS)
    degrees = math.degrees(1.0) / FULL
    return _pid(
        own, axis, pattern, gains, degrees, degrees / density_ratio, power=2, rate=_loop_rate(own, 50.0)
    )


def copter(values: Mapping[str, float], axis: str) -> RateLaw:
    """Return the rate law of a copter about an axis, from its parameters."""
    own, pattern = Parameters(values, "ArduPilot"), COPTER[axis]
    gains = own.named(pattern, COPTER_DEFAULTS)
    law = _pid(own, axis, pattern, gains, 1.0, 1.0, power=0, rate=_loop_rate(own, 400.0))
    if own.number("MOT_BAT_VOLT_MAX", 0.0):
        law = replace(law, lacks=(*law.lacks, "gains that grow as the battery sags (MOT_BAT_VOLT_MAX)"))
    return law


def old_plane(values: Mapping[str, float], axis: str, density_ratio: float = 1.0) -> RateLaw:
    """Return the law of a plane before version 4.1 about roll or pitch; `density_ratio` as of :func:`plane`."""
    own, pattern = Parameters(values, "ArduPilot"), OLD_PLANE[axis]
    k = own.named(pattern, OLD_DEFAULTS)
    degrees, tau = math.degrees(1.0) / FULL, k["TCONST"]
    target = max((k["P"] - k["I"] * tau) * tau - k["D"], 0.0) / density_ratio
    error = through(ERROR, degrees)
    terms = (
        Term("P", {SETPOINT: Filter((degrees * target,))}, 1),
        Term("I", error, 2, Integral(k["I"] * tau, 0.01 * k["IMAX"] / FULL, scaled_error=True)),
        Term("D", through(error, k["D"]), 2),
        Term("FF", {SETPOINT: Filter((degrees * k["FF"] / density_ratio,))}, 1),
    )
    return _sensed(own, RateLaw(axis, _loop_rate(own, 50.0), terms))


def mixing(values: Mapping[str, float], positions: FloatArray, turning: FloatArray) -> FloatArray:
    """Return how much each motor (n, 3) of a copter is commanded by a full command about each axis [5]_.

    Shares are one half at most; thrust is linearized about hover, and moves a motor between `MOT_SPIN_MIN` and `MOT_SPIN_MAX`.

    Parameters
    ----------
    values : parameters
    positions : (n, 3) of rotors that push up, m from the center of gravity
    turning : (n,) one for counterclockwise as seen from above, minus one for clockwise
    """
    own = Parameters(values, "ArduPilot")
    slope = thrust_slope(own.number("MOT_THST_EXPO", 0.65, -1.0), own.number("MOT_THST_HOVER", 0.35, 0.01))
    low, high = _spin(own)
    return slope * (high - low) * by_place(positions, turning, (0.5, 0.5, 0.5))


def pulse(values: Mapping[str, float]) -> float:
    """Return the change of a motor's pulse, us, over that of its command from 0 to 1."""
    low, high = _pulses(Parameters(values, "ArduPilot"))
    return high - low


def motor_command(values: Mapping[str, float], kind: str, channel: FloatArray) -> FloatArray:
    """Return the command of a motor from 0 to 1 between `MOT_SPIN_MIN` and `MOT_SPIN_MAX` for a channel: ``motor`` or ``pwm``."""
    own = Parameters(values, "ArduPilot")
    (low, high), (least, most) = _spin(own), _pulses(own)
    output = channel if kind == "motor" else (channel - least) / (most - least)
    return (output - low) / (high - low)


def _pulses(own: Parameters) -> tuple[float, float]:
    low, high = "MOT_PWM_MIN", "MOT_PWM_MAX"
    return own.rising((low, own.number(low, 0.0) or 1000.0), (high, own.number(high, 0.0) or 2000.0))


def _spin(own: Parameters) -> tuple[float, float]:
    low, high = "MOT_SPIN_MIN", "MOT_SPIN_MAX"
    return own.rising((low, own.number(low, 0.15)), (high, own.number(high, 0.95)))


def _pid(
    own: Parameters, axis: str, pattern: str, gains: Mapping[str, float], unit: float, forward: float, power: int, rate: float,
) -> RateLaw:  # fmt: skip
    target, smooth = low_pass(gains["FLTT"], rate), low_pass(gains["FLTE"], rate)
    error = {SETPOINT: series(target, smooth) * unit, RATE: smooth * -unit}
    slope = series(difference(rate), low_pass(gains["FLTD"], rate)) * gains["D"]
    terms = (
        Term("P", through(error, gains["P"]), power),
        Term("I", error, power, Integral(gains["I"], unit * gains["IMAX"], scaled_error=True)),
        Term("D", through(error, slope), power),
        Term("FF", {SETPOINT: target * (forward * gains["FF"])}, power // 2),
    )
    switched_on = tuple(
        f"{what} ({pattern.format(n)})"
        for n, what in LEFT_OUT.items()
        if own.number(pattern.format(n), 0.0) > 0.0
    )
    return _sensed(own, RateLaw(axis, rate, terms, lacks=switched_on))


def _sensed(own: Parameters, law: RateLaw) -> RateLaw:
    """Return a law with the low-pass of the gyro before it."""
    gyro_rate = max(GYRO_RATE, law.rate)
    sensing = {RATE: butterworth(own.number("INS_GYRO_FILTER", 20.0), gyro_rate)}
    lacks = [f"harmonic notch ({n})" for n in NOTCHES if own.number(n, 0.0) > 0.0]
    return replace(law, sensing=sensing, gyro_rate=gyro_rate, lacks=(*law.lacks, *lacks))


def _loop_rate(own: Parameters, default: float) -> float:
    return own.number("SCHED_LOOP_RATE", default, 1.0)


def airspeed_ratio(values: Mapping[str, float], airspeed: float) -> float:
    """Return `SCALING_SPEED` over airspeed as a plane scales its law, within its limits.

    Parameters
    ----------
    airspeed : equivalent, m/s
    """
    own = Parameters(values, "ArduPilot")
    speed = own.number("SCALING_SPEED", 15.0, 0.1)
    slowest = own.number("ARSPD_FBW_MIN", own.number("AIRSPEED_MIN", 9.0))
    fastest = own.number("ARSPD_FBW_MAX", own.number("AIRSPEED_MAX", 22.0, 0.1), 0.1)
    low, high = min(0.5, speed / (2.0 * fastest)), max(2.0, speed / (0.7 * max(slowest, SLOWEST)))
    return min(max(speed / max(airspeed, 1e-4), low), high)


def copter_attitude(values: Mapping[str, float], axis: str) -> float:
    """Return the rate over a small error of the attitude, 1/s, of a copter: `ATC_ANG_RLL_P`."""
    return Parameters(values, "ArduPilot").number(COPTER[axis].replace("RAT", "ANG").format("P"), 4.5)


def plane_attitude(values: Mapping[str, float], axis: str) -> float:
    """Return the rate over an error of the attitude, 1/s, of a plane: one over `RLL2SRV_TCONST`; zero about yaw."""
    own = Parameters(values, "ArduPilot")
    return 0.0 if axis == "yaw" else 1.0 / own.number(OLD_PLANE[axis].format("TCONST"), 0.5, 0.01)
