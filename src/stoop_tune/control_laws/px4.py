"""Rate laws of PX4 for fixed wings and multicopters.

torque = P (setpoint - rate) + integral - D (derivative of the rate) + FF setpoint, where the integral is used before the error
of its sample is added. The gyro passes a notch; then its difference passes one low-pass, and the rate another [3]_. Of a fixed
wing P, I and D act by the square of the ratio of trim airspeed to airspeed, FF by the ratio itself [2]_.

References
----------
.. [1] PX4-Autopilot, src/lib/rate_control/rate_control.cpp
.. [2] PX4-Autopilot, src/modules/fw_rate_control/FixedwingRateControl.cpp; mc_rate_control/MulticopterRateControl.cpp
.. [3] PX4-Autopilot, src/modules/sensors/vehicle_angular_velocity/VehicleAngularVelocity.cpp
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop_tune.control_laws.filters import Filter, butterworth, difference, low_pass, notch, series
from stoop_tune.control_laws.mixing import command_of, thrust_slope
from stoop_tune.control_laws.parameters import Parameters
from stoop_tune.control_laws.rate_law import (
    ACCELERATION,
    ERROR,
    RATE,
    SETPOINT,
    Integral,
    RateLaw,
    Term,
    through,
)

FADE: Final = math.radians(400.0)  #: rad/s, error at which the integral stands
#: axis -> pattern of the parameters of a fixed wing, with the defaults of PX4; P tells of which vehicle a log is
WING: Final = {
    "roll": ("FW_RR_{}", {"P": None, "I": 0.1, "D": 0.0, "FF": 0.5, "IMAX": 0.2}),
    "pitch": ("FW_PR_{}", {"P": None, "I": 0.1, "D": 0.0, "FF": 0.5, "IMAX": 0.4}),
    "yaw": ("FW_YR_{}", {"P": None, "I": 0.1, "D": 0.0, "FF": 0.3, "IMAX": 0.2}),
}
ROTORS: Final = {
    "roll": ("MC_ROLLRATE_{}", "MC_RR_INT_LIM", {"P": None, "I": 0.2, "D": 0.003, "FF": 0.0, "K": 1.0}),
    "pitch": ("MC_PITCHRATE_{}", "MC_PR_INT_LIM", {"P": None, "I": 0.2, "D": 0.003, "FF": 0.0, "K": 1.0}),
    "yaw": ("MC_YAWRATE_{}", "MC_YR_INT_LIM", {"P": None, "I": 0.1, "D": 0.0, "FF": 0.0, "K": 1.0}),
}
INTEGRAL_LIMIT: Final = 0.3
TORQUE_RATIO: Final = 0.05  #: m, CA_ROTORn_KM, of any size: allocation is normalized
SMALL: Final = 1e-3  #: of a share that counts as none
GYRO_RATE: Final = 400.0  #: Hz, of IMU_GYRO_RATEMAX


def fixed_wing(values: Mapping[str, float], axis: str) -> RateLaw:
    """Return the rate law of a fixed wing about an axis, from its parameters."""
    own = Parameters(values, "PX4")
    pattern, defaults = WING[axis]
    gains = own.named(pattern, defaults)
    return _law(own, axis, gains, gains["IMAX"], power=2)


def multicopter(values: Mapping[str, float], axis: str) -> RateLaw:
    """Return the rate law of a multicopter about an axis, from its parameters."""
    own = Parameters(values, "PX4")
    pattern, limit, defaults = ROTORS[axis]
    gains = own.named(pattern, defaults)
    gains |= {n: gains["K"] * gains[n] for n in "PID"}
    law = _law(own, axis, gains, own.number(limit, INTEGRAL_LIMIT), power=0)
    if axis == "yaw":
        law = replace(law, after=low_pass(own.number("MC_YAW_TQ_CUTOFF", 0.0), law.rate))
    return law


def _law(own: Parameters, axis: str, gains: Mapping[str, float], limit: float, power: int) -> RateLaw:
    terms = (
        Term("P", through(ERROR, gains["P"]), power),
        Term("I", ERROR, power, Integral(gains["I"], limit, FADE, late=True)),
        Term("D", {ACCELERATION: Filter((-gains["D"],))}, power),
        Term("FF", {SETPOINT: Filter((gains["FF"],))}, power // 2),
    )
    rate = own.number("IMU_GYRO_RATEMAX", GYRO_RATE) or GYRO_RATE
    notches = [
        notch(own.number(f"IMU_GYRO_NF{i}_FRQ", 0.0), own.number(f"IMU_GYRO_NF{i}_BW", 20.0), rate)
        for i in range(2)
    ]
    notches.append(notch(own.number("IMU_GYRO_NF_FREQ", 0.0), own.number("IMU_GYRO_NF_BW", 20.0), rate))
    sensing = {
        RATE: series(*notches, butterworth(own.number("IMU_GYRO_CUTOFF", 40.0), rate)),
        ACCELERATION: series(
            *notches, difference(rate), butterworth(own.number("IMU_DGYRO_CUTOFF", 30.0), rate)
        ),
    }
    dynamic = int(own.number("IMU_GYRO_DNF_EN", 0.0))
    lacks = ("notches that follow the speed of the motors (IMU_GYRO_DNF_EN)",) if dynamic else ()
    return RateLaw(axis, rate, terms, sensing=sensing, gyro_rate=rate, lacks=lacks)


def airspeed_ratio(values: Mapping[str, float], airspeed: float) -> float:
    """Return the ratio of trim airspeed to airspeed by which a fixed wing scales its law.

    Parameters
    ----------
    airspeed : calibrated, m/s
    """
    own = Parameters(values, "PX4")
    if not own.number("FW_ARSP_SCALE_EN", 1.0):
        return 1.0
    trim = own.number("FW_AIRSPD_TRIM", 15.0, 0.1)
    slowest = own.number("FW_AIRSPD_STALL", own.number("FW_AIRSPD_MIN", 10.0))
    return trim / min(max(airspeed, slowest), own.number("FW_AIRSPD_MAX", 20.0, 0.1))


def mixing(values: Mapping[str, float], positions: FloatArray, turning: FloatArray) -> FloatArray:
    """Return how much each motor (n, 3) is commanded by a full command about each axis, as PX4 normalizes its allocation.

    Parameters
    ----------
    values : parameters; none of them counts
    positions : (n, 3) of rotors that push up, m from the center of gravity
    turning : (n,) one for counterclockwise as seen from above, minus one for clockwise

    References
    ----------
    .. [4] PX4-Autopilot, src/lib/control_allocation/control_allocation/ControlAllocationPseudoInverse.cpp
    """
    up = np.array([0.0, 0.0, -1.0])
    moments = np.cross(positions, up) - TORQUE_RATIO * turning[:, None] * up
    effect = np.vstack([moments.T, np.broadcast_to(up[:, None], (3, len(positions)))])
    mix = np.linalg.pinv(effect)[:, :3]
    used = np.maximum(np.sum(np.abs(mix[:, :2]) > SMALL, axis=0), 1)
    level = float(np.max(np.sqrt(np.sum(mix[:, :2] ** 2, axis=0) / (used / 2.0))))
    return np.asarray(mix / np.array([level, level, float(np.max(mix[:, 2]))]))


def pulse(values: Mapping[str, float]) -> float:
    """Return the change of a motor's pulse, us, over that of its normalized command about hover.

    Thrust is linearized by `THR_MDL_FAC` behind the command that is logged [5]_.

    References
    ----------
    .. [5] PX4-Autopilot, src/lib/mixer_module/functions/FunctionMotors.hpp
    """
    own = Parameters(values, "PX4")
    curve, (low, high) = own.number("THR_MDL_FAC", 0.0), _pulses(own)
    return (high - low) * thrust_slope(curve, own.number("MPC_THR_HOVER", 0.5, 0.01))


def motor_command(values: Mapping[str, float], kind: str, channel: FloatArray) -> FloatArray:
    """Return the command of a motor from 0 to 1 for its channel: ``motor``, ahead of the linearization, or ``pwm`` [5]_."""
    own = Parameters(values, "PX4")
    low, high = _pulses(own)
    return (
        command_of(own.number("THR_MDL_FAC", 0.0), channel)
        if kind == "motor"
        else (channel - low) / (high - low)
    )


def _pulses(own: Parameters) -> tuple[float, float]:
    low, high = "PWM_MAIN_MIN1", "PWM_MAIN_MAX1"
    return own.rising((low, own.number(low, 1000.0)), (high, own.number(high, 2000.0)))


def multicopter_attitude(values: Mapping[str, float], axis: str) -> float:
    """Return the rate over an error of the attitude, 1/s, of a multicopter: `MC_ROLL_P`."""
    return Parameters(values, "PX4").number(f"MC_{axis.upper()}_P", 2.8 if axis == "yaw" else 6.5)


def fixed_wing_attitude(values: Mapping[str, float], axis: str) -> float:
    """Return the rate over an error of the attitude, 1/s, of a fixed wing: one over `FW_R_TC`; zero about yaw."""
    own = Parameters(values, "PX4")
    return 0.0 if axis == "yaw" else 1.0 / own.number(f"FW_{axis[0].upper()}_TC", 0.4, 0.01)
