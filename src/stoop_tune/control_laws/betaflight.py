"""Rate law, angle mode and mixer of Betaflight 4.2 and later, from the header of a blackbox log.

The loop works in deg/s: P on the error, of yaw through a low-pass; the limited sum of errors; D on the gyro through a notch and
two low-passes; FF on the derivative of the setpoint [1]_. Gains are the numbers of the header times fixed constants; a sum of
1000 is taken for one. The gyro passes its second low-pass, or a mean where that is off, at its own rate; what follows is at the
rate of the loop, and ends in the gyro that is logged [2]_. Axes and signs are those of the firmware.

The mixer of a quad X adds the whole command about each axis to a motor or takes it away, linearizes the thrust, and moves the
motor between idle and its limit [4]_. Angle mode sets rates in proportion to the error of roll and pitch, through a low-pass.

References
----------
.. [1] betaflight, src/main/flight/pid.c, pid_init.c and pid.h, of 4.5 and of 2025.12
.. [2] betaflight, src/main/sensors/gyro.c, gyro_init.c and gyro_filter_impl.c; src/main/common/filter.c
.. [3] betaflight, src/main/blackbox/blackbox.c: names in the header
.. [4] betaflight, src/main/flight/mixer.c and mixer_init.c, and pidApplyThrustLinearization of pid.c, of 4.5, 2025.12 and 2026.6
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.polynomial import Polynomial
from scipy.optimize import brentq

from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop_tune.control_laws.filters import (
    PASS,
    Filter,
    below_nyquist,
    butterworth,
    difference,
    low_pass,
    notch_of_quality,
    series,
)
from stoop_tune.control_laws.parameters import Parameters
from stoop_tune.control_laws.rate_law import AXES, ERROR, RATE, SETPOINT, Integral, RateLaw, Term, through

P_SCALE, I_SCALE, D_SCALE, FF_SCALE = 0.032029, 0.244381, 0.000529, 0.013754e-2
YAW_INTEGRAL: Final = 2.5  #: times the gain of I about yaw
FULL: Final = 1000.0  #: sum of one
INTEGRAL_LIMIT: Final = 400.0  #: before 2025.12, which has a percentage of the limit of the sum
DSHOT: Final = (48.0, 2047.0)  #: commands of the digital protocol, from stop to full
PULSES: Final = (500.0, 2000.0)  #: us, the shortest and the longest that a motor understands
BUTTERWORTH: Final = 1  #: type of a low-pass; others are one, two or three of first order in series
ORDERS: Final = {0: 1, 2: 2, 3: 3}
#: names of 4.2 -> of 4.3 and later
RENAMED: Final = {
    "dterm_lowpass_hz": "dterm_lpf1_static_hz",
    "dterm_filter_type": "dterm_lpf1_type",
    "dterm_lowpass_dyn_hz[0]": "dterm_lpf1_dyn_hz[0]",
    "dterm_lowpass2_hz": "dterm_lpf2_static_hz",
    "dterm_filter2_type": "dterm_lpf2_type",
    "gyro_lowpass_hz": "gyro_lpf1_static_hz",
    "gyro_lowpass_type": "gyro_lpf1_type",
    "gyro_lowpass_dyn_hz[0]": "gyro_lpf1_dyn_hz[0]",
    "gyro_lowpass2_hz": "gyro_lpf2_static_hz",
    "gyro_lowpass2_type": "gyro_lpf2_type",
    "gyro_rpm_notch_harmonics": "rpm_filter_harmonics",
    "ff_boost": "feedforward_boost",
    "ff_interpolate_sp": "feedforward_averaging",
    "ff_max_rate_limit": "feedforward_max_rate_limit",
    **{f"feedforward_weight[{k}]": f"ff_weight[{k}]" for k in range(3)},
}
DYNAMIC_NOTCH, AIRMODE = 2**29, 2**22  #: of the features, the first of 4.2
LEVEL_CUTOFF: Final = 50.0  #: Hz, of three low-passes behind the error of angle mode
LARGEST: Final = 250.0  #: gain that the firmware takes
#: what reshapes the derivative of the setpoint before it is fed forward
SHAPING: Final = ("averaging", "boost", "jitter_factor", "max_rate_limit", "smooth_factor", "transition")


@dataclass(frozen=True)
class Header(Parameters):
    """Settings in the header of a log."""

    @property
    def recent(self) -> bool:
        """Whether it is of 2025.12 or later."""
        return "d_max[0]" in self.values

    def low_pass(self, name: str, rate: float, corrected: bool = True) -> Filter:
        """Return a low-pass of the header; one that follows the throttle is that at no throttle.

        Parameters
        ----------
        name : beginning of its settings; the cutoff has no default, as off is not that of the firmware
        rate : Hz
        corrected : whether the cutoff of several in series is that of them all
        """
        kind = int(self.number(f"{name}_type", 0.0))
        cutoff = self.number(f"{name}_dyn_hz[0]", 0.0) or self.number(f"{name}_static_hz")
        if kind == BUTTERWORTH or not cutoff:
            return butterworth(cutoff, rate)
        return in_series(below_nyquist(cutoff, rate), rate, ORDERS.get(kind, 1), corrected)

    @property
    def rate(self) -> float:
        """Rate of the loop, Hz."""
        return (
            1e6 / self.number("looptime", least=1.0) / int(self.number("pid_process_denom", 1.0, least=1.0))
        )

    @property
    def motors(self) -> tuple[float, float]:
        """Commands to a motor, from 0 to 1 as they are logged, at idle and at its limit."""
        low, high = ((n, self.number(n)) for n in ("motorOutput[0]", "motorOutput[1]"))
        self.rising(low, high)
        stop, full = DSHOT
        if not (low[1] < PULSES[0] or high[1] > PULSES[1]):  # no commands of the digital protocol
            stop, full = self.rising(*((n, self.number(n)) for n in ("minthrottle", "maxthrottle")))
        return (low[1] - stop) / (full - stop), (high[1] - stop) / (full - stop)

    def notch(self, name: str, rate: float, place: str = "") -> Filter:
        """Return a notch of the header, whose cutoff is the lower frequency at 3 dB."""
        center = self.number(f"{name}_hz{place}", 0.0)
        cutoff = self.number(f"{name}_cutoff{place}", 0.0)
        if not 0.0 < cutoff < center:
            return PASS
        return notch_of_quality(center, center * cutoff / (center**2 - cutoff**2), rate)

    def lacks(self, axis: str, k: int) -> tuple[str, ...]:
        """Return what these settings switch on and the law leaves out."""
        yaw, old = axis == "yaw", "anti_gravity_mode" in self.values  # before 4.4

        def on(name: str) -> float:
            return self.number(name, 0.0)

        base, least, most = on(f"{axis}PID[2]"), on(f"d_min[{k}]"), on(f"d_max[{k}]")
        old_notch = on("dyn_notch_max_hz") and int(on("features")) & DYNAMIC_NOTCH
        shaping = [f"feedforward_{n}" for n in SHAPING if on(f"feedforward_{n}")]
        found = {
            "integral held in maneuvers (iterm_relax)": on("iterm_relax")
            in ((2, 4) if yaw else (1, 2, 3, 4)),
            "notches that follow the spectrum (dyn_notch_count)": on("dyn_notch_count") or old_notch,
            "notches that follow the speed of the motors (rpm_filter_harmonics)": on("rpm_filter_harmonics")
            and self.number("dshot_bidir", 1.0),
            "D that grows in maneuvers (d_min)": 0.0 < least < base,
            "D that grows in maneuvers (d_max)": 0.0 < base < most,
            "P and I that grow as the throttle moves (anti_gravity_gain)": on("anti_gravity_gain") > 1000.0
            if old
            else on("anti_gravity_gain") and not yaw,
            "low-pass of D that follows the throttle (dterm_lpf1_dyn_hz)": on("dterm_lpf1_dyn_hz[0]"),
            "low-pass of the gyro that follows the throttle (gyro_lpf1_dyn_hz)": on("gyro_lpf1_dyn_hz[0]"),
            "gains that fall above a throttle (tpa_rate)": on("tpa_rate"),
            "correction of the accumulated error (abs_control_gain)": on("abs_control_gain"),
            "range of motors that follows the battery (vbat_sag_compensation)": on("vbat_sag_compensation"),
            "idle that follows the speed of the motors (dyn_idle_min_rpm)": on("dyn_idle_min_rpm")
            and self.number("dshot_bidir", 1.0),
            "mixing that is weaker below half throttle without airmode (features)": "features" in self.values
            and not int(on("features")) & AIRMODE,
            "sum of yaw that is integrated (use_integrated_yaw)": yaw and on("use_integrated_yaw"),
            f"feedforward shaped before the loop ({', '.join(shaping)})": shaping and on(f"ff_weight[{k}]"),
        }
        return tuple(name for name, applies in found.items() if applies)


def in_series(cutoff: float, rate: float, order: int, corrected: bool = True) -> Filter:
    """Return first-order low-passes one after the other, whose cutoff, Hz, is that of them all if `corrected`."""
    one = cutoff / (math.sqrt(2.0 ** (1.0 / order) - 1.0) if corrected else 1.0)
    return series(*[low_pass(one, rate)] * order)


def header(values: Mapping[str, float]) -> Header:
    """Return the settings in the header of a log, named as those of 4.3 and later."""
    return Header({RENAMED.get(name, name): value for name, value in values.items()}, "Betaflight")


def rate_pid(values: Mapping[str, float], axis: str) -> RateLaw:
    """Return the rate law of Betaflight about an axis, from the settings in the header of a blackbox log."""
    own, k = header(values), AXES.index(axis)
    per_radian = 1.0 / (math.radians(FULL))
    p, i, d = (own.number(f"{axis}PID[{n}]") * per_radian for n in range(3))
    least = own.number(f"d_min[{k}]", 0.0) * per_radian
    d = least if 0.0 < least < d else d  # at rest
    ff = own.number(f"ff_weight[{k}]", 0.0) * FF_SCALE * per_radian
    denominator = int(own.number("pid_process_denom", 1.0, least=1.0))
    rate, gyro_rate = own.rate, own.rate * denominator
    yaw = axis == "yaw"
    limit = own.number("pidsum_limit_yaw", 400.0) if yaw else own.number("pidsum_limit", 500.0)
    held = 0.01 * own.number("iterm_windup", 80.0) * limit if own.recent else INTEGRAL_LIMIT
    smooth = low_pass(own.number("yaw_lowpass_hz", 0.0), rate) if yaw else PASS
    lags = [own.notch("dterm_notch", rate), *(own.low_pass(f"dterm_lpf{n}", rate) for n in (1, 2))]
    i *= I_SCALE * (YAW_INTEGRAL if yaw else 1.0)
    terms = (
        Term("P", through(through(ERROR, smooth), P_SCALE * p)),
        Term("I", ERROR, integral=Integral(i, held / FULL)),
        Term("D", {RATE: series(*lags, difference(rate)) * (-D_SCALE * d)}),
        Term("FF", {SETPOINT: difference(rate) * ff}),
    )
    first = own.low_pass("gyro_lpf2", gyro_rate, own.recent)
    if first is PASS:
        first = Filter((1.0 / denominator,) * denominator)
    notches = [own.notch("gyro_notch", rate, f"[{n}]") for n in (0, 1)]
    return RateLaw(
        axis,
        rate,
        terms,
        limit=limit / FULL,
        sensing={RATE: first},
        sensing_loop=series(*notches, own.low_pass("gyro_lpf1", rate, own.recent)),
        gyro_rate=gyro_rate,
        lacks=own.lacks(axis, k),
    )


def level(values: Mapping[str, float], axis: str) -> RateLaw:
    """Return the setpoint of the rate, rad/s, by that of the attitude and the attitude in angle mode; zero about yaw."""
    own = header(values)
    gain = 0.0 if axis == "yaw" else 0.1 * own.number("levelPID[0]", 50.0)
    smooth = in_series(LEVEL_CUTOFF, own.rate, 3)
    return RateLaw(axis, own.rate, (Term("P", through(through(ERROR, smooth), gain)),), limit=math.inf)


def mixing(values: Mapping[str, float], positions: FloatArray, turning: FloatArray) -> FloatArray:
    """Return how much each motor (4, 3) of a quad X is commanded by a command of one about each axis, thrust not linearized [4]_.

    Parameters
    ----------
    values : settings
    positions : (n, 3) of rotors that push up, m from the center of gravity
    turning : (n,) one for counterclockwise as seen from above, minus one for clockwise
    """
    signs = np.sign(np.column_stack([-positions[:, 1], positions[:, 0], turning]))
    if len(signs) != 4 or not signs.all() or signs.sum(axis=0).any():
        raise StoopError(
            "Betaflight: the mixer is modeled of a quad X alone: four rotors, front and rear, left and right, two of each turning"
        )
    low, high = header(values).motors
    return np.asarray((high - low) * signs)


def thrust_slope(values: Mapping[str, float], hover: float) -> float:
    """Return the change of a motor's command over that of what the mixer asks for, both of their ranges, by `thrust_linear` [4]_.

    Parameters
    ----------
    hover : command to a motor in hover, from 0 to 1
    """
    own = header(values)
    e, (low, high) = 0.01 * own.number("thrust_linear", 0.0), own.motors
    curve = Polynomial([0.0, 1.0 + e, -2.0 * e, e])
    if "ap_position_f" in own.values:  # 2026.6
        curve = Polynomial([0.0, 1.0 + e + e**2, -e - 3.0 * e**2, 2.0 * e**2])
    share = min(max((hover - low) / (high - low), 0.0), float(curve(1.0)))  # one, but for rounding
    return float(curve.deriv()(brentq(lambda x: curve(x) - share, 0.0, 1.0)))


def settable(gain: float) -> float:
    """Return a gain as the firmware takes it: whole, and no more than is asked for."""
    return float(max(math.floor(gain + 1e-6), 1))
