"""Laws sample by sample beside the same laws over whole records, and integrals that stop at the ends of actuators."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from stoop.control_laws import ardupilot, betaflight, crazyflie, px4
from stoop.control_laws.filters import PASS
from stoop.control_laws.rate_law import SETPOINT, RateLaw
from stoop.control_laws.recursion import LawRecursion

COUNT = 600
PX4 = {
    "FW_RR_P": 0.06, "FW_RR_I": 0.4, "FW_RR_D": 0.01, "FW_RR_FF": 0.5, "FW_RR_IMAX": 0.05, "IMU_GYRO_CUTOFF": 40.0,
    "IMU_GYRO_NF0_FRQ": 80.0, "IMU_GYRO_NF0_BW": 20.0,
}  # fmt: skip
GAINS = {"P": 0.08, "I": 0.5, "D": 0.004, "FF": 0.3, "IMAX": 0.05, "FLTT": 3.0, "FLTE": 15.0, "FLTD": 12.0}
BETAFLIGHT = {
    "looptime": 500.0, "pid_process_denom": 2.0, "yawPID[0]": 45.0, "yawPID[1]": 20.0, "yawPID[2]": 10.0,
    "gyro_lpf1_static_hz": 250.0, "dterm_lpf1_static_hz": 75.0, "yaw_lowpass_hz": 100.0, "ff_weight[2]": 80.0,
    "gyro_lpf2_static_hz": 0.0, "dterm_lpf2_static_hz": 0.0,
}  # fmt: skip
LAWS = {
    "px4": px4.fixed_wing(PX4, "roll"),
    "yaw of px4": px4.multicopter({"MC_YAWRATE_P": 0.2, "MC_YAW_TQ_CUTOFF": 2.0}, "yaw"),
    "plane": ardupilot.plane({f"RLL_RATE_{n}": x for n, x in GAINS.items()}, "roll"),
    "copter": ardupilot.copter({f"ATC_RAT_RLL_{n}": x for n, x in GAINS.items()}, "roll"),
    "betaflight": betaflight.rate_pid(BETAFLIGHT, "yaw"),
    "crazyflie": crazyflie.cascade({"pid_rate.roll_kp": 250.0}, "roll"),
}


def steps(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return setpoints and rates (n,), zero at first."""
    rng = np.random.default_rng(seed)
    setpoint = np.repeat(rng.normal(0.0, 2.0, COUNT // 60), 60)
    setpoint[:60] = 0.0
    return setpoint, np.convolve(setpoint, np.ones(25) / 25.0, "same")


def sensed(law: RateLaw, rate: np.ndarray) -> Mapping[str, np.ndarray]:
    """Return the measured signals by the sampling of the gyro, whole record at once, at rest one sample before."""
    times = np.arange(len(rate) + 1) / law.rate
    gyro = np.arange(int(times[-1] * law.gyro_rate + 1e-6) + 1) / law.gyro_rate
    last = np.floor(times * law.gyro_rate + 1e-6).astype(int)
    out = {}
    for name in (n for n in law.signals if n != SETPOINT):
        filtered = law.sensing.get(name, PASS).output(np.interp(gyro, times, np.r_[rate[:1], rate]))
        out[name] = law.sensing_loop.output(filtered[last])[1:]
    return out


@pytest.mark.parametrize("name", LAWS)
def test_samples_are_those_of_the_whole_record(name: str) -> None:
    """Two lanes, one of them of another record; what actuators do is all that is asked for."""
    law = LAWS[name]
    records = [steps(1), steps(2)]
    scaled = law.terms[0].power and name != "plane"
    scale = 1.0 + (0.2 if scaled else 0.0) * np.sin(np.arange(COUNT) / 50.0)
    expected = [law.outputs({SETPOINT: s, **sensed(law, rate)}, scale)["command"] for s, rate in records]
    setpoints, rates = (np.column_stack([r[i] for r in records]) for i in range(2))
    running, found = LawRecursion([law], np.zeros((1, 2))), []
    for k in range(COUNT):
        at = slice(k, k + 1)
        found.append(running.commands(setpoints[at], rates[at], np.full(2, scale[k]), running.unlimited)[0])
    assert np.ptp(expected[0]) > 1e-2
    np.testing.assert_allclose(np.array(found).T, expected, rtol=1e-8, atol=1e-10)


def test_an_integral_stops_where_actuators_end() -> None:
    """Against its limit the integral stays; it shrinks at once when the error turns."""
    law = ardupilot.copter({"ATC_RAT_RLL_P": 0.1, "ATC_RAT_RLL_I": 1.0, "ATC_RAT_RLL_IMAX": 0.9}, "roll")
    running, none, one = LawRecursion([law], np.zeros((1, 1))), np.zeros((1, 1)), np.ones((1, 1))
    done = none
    for _ in range(800):
        done = np.minimum(running.commands(3.0 * one, none, np.ones(1), done), 0.2)
    held = float(running.integrals.max())
    assert 0.0 < held < 0.2
    for _ in range(40):
        done = np.minimum(running.commands(-3.0 * one, none, np.ones(1), done), 0.2)
    assert float(running.integrals.max()) < held
