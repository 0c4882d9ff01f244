"""Gains by the published rules of autopilots' own tuning, to stand beside those that margins were searched for.

PX4 fits y[k] = -a1 y[k-1] - a2 y[k-2] + b0 u[k-1] + b1 u[k-2] + b2 u[k-3] to the filtered rate over the torque command while
it shakes the vehicle with steps, and takes the PID of a generalized minimum variance law from it [1]_ [2]_. ArduPilot raises
gains in flight and takes three quarters of the last (AUTOTUNE_GMBK) [3]_.

References
----------
.. [1] T. Yamamoto, K. Fujii and M. Kaneda, Design and implementation of a self-tuning PID controller, 1998.
.. [2] PX4-Autopilot, src/lib/pid_design/pid_design.hpp; src/modules/mc_autotune_attitude_control and fw_autotune_attitude_control
.. [3] ArduPilot, libraries/AC_AutoTune/AC_AutoTune_Multi.cpp
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop.base.arrays import ComplexArray, FloatArray
from stoop_tune.control_laws.table import rounded
from stoop_tune.gain_search import Design
from stoop_tune.loops import motion

BACK_OFF: Final = 0.75
MODEL_STEP: Final = 0.01  #: s
BAND: Final = (0.5, 40.0)  #: Hz, of the filters before the fit
#: rise time, s, about roll and pitch, and about yaw; coefficient that lowers the gain
ROTORS, WINGS = (0.14, 0.2, 0.7), (0.2, 0.2, 0.4)
#: largest P, ratio of I to P and ratio of D to P of a multicopter that are taken; of a fixed wing P, ratio of I to P, FF
LARGEST, LARGEST_ON_WINGS = (0.5, 10.0, 0.1), (4.0, 10.0, 2.0)
LEAST_TIME_CONSTANT: Final = 1.0 / 12.0  #: s, least time constant of the attitude that is taken
NO_DERIVATIVE: Final = -0.001  #: s, from which a negative ratio of D to P counts as none


def minimum_variance(design: Design) -> dict[str, float] | None:
    """Return parameters of PX4 by its rule for the first models, at the middle airspeed; None where it refuses its gains."""
    firmware, out = design.firmware, dict(design.flown)
    condition = design.conditions[len(design.conditions) // 2]
    frequency = 2.0 * np.pi * np.linspace(*BAND, 400)
    answers = motion(condition.plants.part(slice(0, 1)), frequency)
    for i, axis in enumerate(design.axes):
        loop = design.loop(design.flown, axis, condition)
        flown = answers[loop.rate][0, i] * loop.gyro(frequency) * loop.hold(frequency)
        den, num = difference_equation(flown, frequency, MODEL_STEP)
        rise, slow, detuning = ROTORS if firmware.rotors else WINGS
        inverse = float((1.0 + den.sum()) / num.sum())  # of the static gain
        gain, integral, derivative = minimum_variance_pid(
            den,
            num if firmware.rotors else inverse * num,
            MODEL_STEP,
            slow if axis == "yaw" else rise,
            detuning,
        )
        derivative = 0.0 if NO_DERIVATIVE < derivative < 0.0 else derivative
        terms = {"P": gain, "I": gain * integral, "D": gain * derivative, "FF": inverse}
        out |= {
            n: rounded(terms[t])
            for t, n in firmware.gains(axis, design.flown).items()
            if t != "D" or firmware.rotors
        }
        third, least, largest = (
            (derivative, 0.0, LARGEST) if firmware.rotors else (inverse, 1e-9, LARGEST_ON_WINGS)
        )
        if not (0.0 < gain < largest[0] and 0.0 < integral < largest[1] and least <= third < largest[2]):
            return None
        if firmware.rotors:
            out[f"MC_{axis.upper()}_P"] = min(max(1.0 / (math.radians(60.0) * gain), 2.0), 6.5)
        elif axis != "yaw":
            out[f"FW_{axis[0].upper()}_TC"] = math.pi / 8.0 * (inverse + gain)
            if out[f"FW_{axis[0].upper()}_TC"] <= LEAST_TIME_CONSTANT:
                return None
    return out


def difference_equation(
    response: ComplexArray, frequency: FloatArray, step: float
) -> tuple[FloatArray, FloatArray]:
    """Return (a1, a2) and (b0, b1, b2) nearest to a response (m,) at frequencies, rad/s, excited by steps."""
    delay = np.exp(-1j * frequency * step)
    columns = [-response * delay, -response * delay**2, delay, delay**2, delay**3]
    matrix = np.column_stack(columns) / frequency[:, None]
    right = response / frequency
    found = np.linalg.lstsq(np.vstack([matrix.real, matrix.imag]), np.r_[right.real, right.imag], rcond=None)[
        0
    ]
    return found[:2], found[2:]


def minimum_variance_pid(
    den: FloatArray, num: FloatArray, step: float, rise: float, detuning: float
) -> tuple[float, float, float]:
    """Return gain, 1/s and s of kc (1 + ki / s + kd s), critically damped, with the fifth of ki that PX4 takes."""
    (a1, a2), decay = den.tolist(), math.exp(-2.0 * step / rise)
    p1, p2 = -2.0 * decay, decay**2
    e1 = p1 + 1.0 - a1
    f0 = e1 * (1.0 - a1) + a1 - a2 + p2
    f1 = e1 * (a1 - a2) + a2
    f2 = e1 * a2
    slope = f1 + 2.0 * f2
    gain = -slope / (detuning + (e1 + 1.0) * float(num.sum()))
    return gain, -(f0 + f1 + f2) / (5.0 * step * slope), -step * f2 / slope


def backed_off(design: Design, values: Mapping[str, float] | None) -> dict[str, float] | None:
    """Return parameters whose P, I and D are three quarters."""
    if values is None:
        return None
    lowered = {n for axis in design.axes for n in design.tuned(axis).values()}
    return {n: BACK_OFF * x if n in lowered else x for n, x in values.items()}
