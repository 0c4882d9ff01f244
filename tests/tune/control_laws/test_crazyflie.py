"""The rate and attitude laws of the Crazyflie beside a naive twin and its recorded responses."""

import itertools
import math
from functools import partial

import numpy as np
import pytest
from tune.control_laws.test_betaflight import flown, of_step, second_order

from stoop.errors import StoopError
from stoop_tune.control_laws.crazyflie import attitude, cascade
from stoop_tune.control_laws.rate_law import AXES, RATE, SETPOINT, RateLaw

VALUES = {"pid_rate.roll_kp": 250.0, "pid_rate.pitch_kp": 240.0, "pid_rate.pitch_kff": 30.0, "pid_rate.yaw_kp": 120.0,
          "pid_rate.yaw_kd": 1.5}  # fmt: skip
SMOOTH = VALUES | {"pid_rate.rateFiltEn": 1.0, "pid_rate.omxFiltCut": 40.0, "pid_rate.omzFiltCut": 25.0}
#: axis -> gains and limit of the sum of errors, deg, of the Crazyflie 2.1 and the values above
KNOWN = {"roll": (250.0, 500.0, 2.5, 0.0, 33.3), "pitch": (240.0, 500.0, 2.5, 30.0, 33.3),
         "yaw": (120.0, 16.7, 1.5, 0.0, 166.7)}  # fmt: skip
#: the same of the attitude loop, 1/s
ANGLES = {"roll": (6.0, 3.0, 0.0, 0.0, 20.0), "pitch": (4.0, 2.0, 0.1, 0.2, 20.0),
          "yaw": (6.0, 1.0, 0.35, 0.0, 360.0)}  # fmt: skip
OUTER = {f"pid_attitude.pitch_k{n}": x for n, x in zip(("p", "i", "d", "ff"), ANGLES["pitch"], strict=False)}
CUTOFFS = {"roll": 40.0, "pitch": 30.0, "yaw": 25.0}
DT = 0.002
two_pole = partial(second_order, q=1.0 / math.sqrt(2.0), is_notch=False)


class Twin:
    """One axis in deg/s, a sample at a time, from rest; terms in units of 16 bits. Or an angle in deg; terms in deg/s."""

    def __init__(self, axis: str, smooth: bool, outer: bool = False) -> None:
        self.kp, self.ki, self.kd, self.kff, self.limit = (ANGLES if outer else KNOWN)[axis]
        self.smooth = two_pole(15.0 if outer else CUTOFFS[axis], DT) if smooth else (lambda x: x)
        self.sum = self.before = 0.0

    def step(self, desired: float, measured: float) -> dict[str, float]:
        error = desired - measured
        slope = self.smooth(-(measured - self.before) / DT)
        self.sum = min(max(self.sum + error * DT, -self.limit), self.limit)
        self.before = measured
        return {"P": self.kp * error, "I": self.ki * self.sum, "D": self.kd * slope, "FF": self.kff * desired}


def law_of(axis: str, smooth: bool, outer: bool) -> RateLaw:
    if outer:
        return attitude(OUTER | ({"pid_attitude.attFiltEn": 1.0} if smooth else {}), axis)
    return cascade(SMOOTH if smooth else VALUES, axis)


@pytest.mark.parametrize("outer", [False, True])
@pytest.mark.parametrize("smooth", [False, True])
def test_terms_are_those_of_the_twin(smooth: bool, outer: bool) -> None:
    """Of the loop of rates, and of that of angles, whose commands are setpoints of rates; all limits are met."""
    size, seed, count = (20.0, 4, 9000) if outer else (60.0, 1, 3000)
    asked, turned = size * np.random.default_rng(seed).standard_normal((2, count)).cumsum(axis=1) / 10.0
    asked[0] = turned[0] = 0.0
    unit, limit = (180.0 / math.pi, math.inf) if outer else (32767.0, 32767.0)
    for axis in AXES:
        known = flown(Twin(axis, smooth, outer), asked, turned)
        found = law_of(axis, smooth, outer).outputs({SETPOINT: np.radians(asked), RATE: np.radians(turned)})
        for name, values in known.items():
            size = np.abs(values).max()
            np.testing.assert_allclose(unit * found[name], values, rtol=1e-9, atol=1e-9 * size)
        total = np.clip(sum(known.values()), -limit, limit)
        np.testing.assert_allclose(found["command"], total / unit, atol=1e-9)
        assert outer or np.abs(total).max() == limit
        _, ki, *_, most = (ANGLES if outer else KNOWN)[axis]
        assert np.abs(known["I"]).max() == pytest.approx(ki * most)


@pytest.mark.parametrize("outer", [False, True])
def test_response_is_that_of_a_recorded_step(outer: bool) -> None:
    unit = 1.0 if outer else 32767.0 * np.pi / 180.0
    for axis, signal in itertools.product(AXES, (SETPOINT, RATE)):
        w, known = of_step(Twin(axis, True, outer), signal, 4096)
        found = law_of(axis, True, outer).response(signal, w / DT) * unit
        np.testing.assert_allclose(found, known, rtol=1e-6, err_msg=f"{axis} {signal}")


def test_the_gyro_is_smoothed_at_its_own_rate() -> None:
    n, w = 4096, 2.0 * np.pi * 31.0
    answer = np.array([*map(two_pole(80.0, 0.001), [1.0] + [0.0] * (n - 1))])
    known = answer @ np.exp(-1j * w * 0.001 * np.arange(n))
    law, at = cascade(VALUES, "roll"), np.array([w])
    assert -law.feedback(at) / law.response(RATE, at) == pytest.approx([known], rel=1e-9)


def test_bad_parameters() -> None:
    for wrong, word in (
        ({"pid_rate.roll_kp": None}, "pid_rate.roll_kp is missing"), ({"pid_rate.roll_kp": math.nan}, "kp = nan"),
        ({"pid_rate.roll_ki": math.inf}, "ki = inf"), ({"pid_rate.roll_kd": -2.5}, "kd = -2.5"),
        ({"pid_rate.omxFiltCut": 250.0}, "not below half the rate"),
    ):  # fmt: skip
        with pytest.raises(StoopError, match=word):
            cascade({n: x for n, x in (SMOOTH | wrong).items() if x is not None}, "roll")
