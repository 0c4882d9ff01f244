"""Laws of autopilots beside naive twins, their responses beside the recorded ones of the twins, and bad parameters."""

import itertools
import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive.rate_loops import ArduPilotLoop, Px4Loop

from stoop.errors import StoopError
from stoop_tune.control_laws import ardupilot, betaflight, crazyflie, px4
from stoop_tune.control_laws.filters import PASS, butterworth, low_pass, notch
from stoop_tune.control_laws.mixing import thrust_slope
from stoop_tune.control_laws.parameters import read_parameters
from stoop_tune.control_laws.rate_law import ACCELERATION, RATE, SETPOINT, RateLaw
from stoop_tune.control_laws.recursion import LawRecursion
from stoop_tune.control_laws.table import firmware_of, firmwares

COUNT = 4000
PX4 = {"FW_RR_P": 0.06, "FW_RR_I": 0.4, "FW_RR_D": 0.01, "FW_RR_FF": 0.5, "FW_RR_IMAX": 0.05, "IMU_GYRO_RATEMAX": 400.0,
       "IMU_GYRO_CUTOFF": 40.0, "IMU_DGYRO_CUTOFF": 20.0, "IMU_GYRO_NF0_FRQ": 80.0, "IMU_GYRO_NF0_BW": 20.0}  # fmt: skip
GAINS = {"P": 0.08, "I": 0.5, "D": 0.004, "FF": 0.3, "IMAX": 0.05, "FLTT": 3.0, "FLTE": 15.0, "FLTD": 12.0}
PLANE = {f"RLL_RATE_{n}": x for n, x in GAINS.items()} | {"SCHED_LOOP_RATE": 50.0}
COPTER = {f"ATC_RAT_RLL_{n}": x for n, x in GAINS.items()} | {"SCHED_LOOP_RATE": 400.0}


def recorded(seed: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    rng = np.random.default_rng(seed)
    steps = np.repeat(rng.normal(0.0, 2.0, COUNT // 100), 100)
    rate = np.convolve(steps, np.ones(50) / 50.0, "same") + rng.normal(0.0, 0.05, COUNT)
    signals = {SETPOINT: steps, RATE: rate, ACCELERATION: rng.normal(0.0, 10.0, COUNT)}
    return signals, 1.0 + 0.3 * np.sin(np.arange(COUNT) / 300.0)


def of_px4(law: RateLaw) -> Any:
    loop = Px4Loop(*(PX4[f"FW_RR_{term}"] for term in ("P", "I", "D", "FF", "IMAX")))
    return lambda x, scale: loop.step(x[SETPOINT], x[RATE], x[ACCELERATION], 1.0 / law.rate, scale)


def of_ardupilot(law: RateLaw, plane: bool = False) -> Any:
    loop = ArduPilotLoop(GAINS, plane)
    return lambda x, scale: loop.step(x[SETPOINT], x[RATE], 1.0 / law.rate, scale)


CASES = {
    "px4": (px4.fixed_wing(PX4, "roll"), of_px4),
    "plane": (ardupilot.plane(PLANE, "roll"), partial(of_ardupilot, plane=True)),
    "copter": (ardupilot.copter(COPTER, "roll"), of_ardupilot),
}


@pytest.mark.parametrize("case", CASES)
def test_terms_are_those_of_the_naive_loop(case: str) -> None:
    law, twin_of = CASES[case]
    (signals, scale), twin = recorded(3), twin_of(law)
    if case == "plane":  # its filters see scaled signals: equal at one airspeed
        scale = np.full(COUNT, 1.2)
    found = law.outputs(signals, scale)
    steps = [twin({n: float(x[k]) for n, x in signals.items()}, float(scale[k])) for k in range(COUNT)]
    for name in ("P", "I", "D", "FF"):
        expected = np.array([step[name] for step in steps])
        assert np.ptp(expected) > 1e-3
        np.testing.assert_allclose(found[name], expected, rtol=1e-9, atol=1e-12 * np.ptp(expected))
    assert np.all(np.abs(found["command"]) <= 1.0)


@pytest.mark.parametrize("case", CASES)
def test_the_response_is_that_of_recorded_impulses(case: str) -> None:
    """Impulses small enough for no limit; the integral of an impulse lasts, so its record is differenced."""
    law, twin_of = CASES[case]
    assert set(law.signals) == {SETPOINT, RATE} | ({ACCELERATION} if case == "px4" else set())
    for signal in law.signals:
        twin, size, count = twin_of(law), 1e-6, 2**12
        zero = dict.fromkeys((SETPOINT, RATE, ACCELERATION), 0.0)
        twin(zero, 1.0)
        given = [zero | {signal: size}] + [zero] * (count - 1)
        record = [sum(twin(one, 1.0).values()) / size for one in given]
        frequency = 2.0 * math.pi * law.rate * np.arange(4, 400) / count
        z = np.exp(1j * frequency / law.rate)
        expected = np.fft.fft(np.diff(record, prepend=0.0))[4:400] / (1.0 - 1.0 / z)
        np.testing.assert_allclose(law.response(signal, frequency), expected, rtol=1e-6, err_msg=signal)


def test_feedback_is_that_of_gyro_samples_through_their_filters() -> None:
    """A sine of the rate, sampled, filtered and put through the law: amplitude and phase of what comes out."""
    law, frequency = px4.fixed_wing(PX4, "roll"), 2.0 * math.pi * 7.0
    time = np.arange(8000) / law.rate
    turning = 1e-3 * np.sin(frequency * time)
    signals = {n: law.sensing[n].output(turning) for n in (RATE, ACCELERATION)}
    command = law.outputs({SETPOINT: np.zeros(len(time)), **signals})["command"]
    basis = np.column_stack([np.sin(frequency * time), np.cos(frequency * time), np.ones(len(time))])[4000:]
    in_phase, leading, _ = np.linalg.lstsq(basis, command[4000:], rcond=None)[0] / 1e-3
    assert -law.feedback(np.array([frequency]))[0] == pytest.approx(in_phase + 1j * leading, rel=2e-3)


@settings(max_examples=25, deadline=None)
@given(st.floats(1.0, 150.0), st.floats(301.0, 4000.0))
def test_filters_pass_what_is_steady_and_stop_where_they_should(cutoff: float, rate: float) -> None:
    for made in (low_pass(cutoff, rate), butterworth(cutoff, rate), notch(cutoff, 10.0, rate)):
        assert abs(made.response(np.array([1.0 + 0j]))[0] - 1.0) < 1e-9
        np.testing.assert_allclose(made.output(np.full(20, 3.0)), 3.0, rtol=1e-9)
    z = np.exp(2j * math.pi * np.array([cutoff]) / rate)
    assert abs(butterworth(cutoff, rate).response(z)[0]) == pytest.approx(math.sqrt(0.5))
    assert abs(notch(cutoff, 10.0, rate).response(z)[0]) < 1e-9


def test_airspeed_scales_as_the_firmware_does() -> None:
    k = {"FW_AIRSPD_TRIM": 20.0, "FW_AIRSPD_STALL": 10.0, "FW_AIRSPD_MAX": 25.0}
    assert [px4.airspeed_ratio(k, v) for v in (5.0, 20.0, 40.0)] == [2.0, 1.0, 0.8]
    assert px4.airspeed_ratio(k | {"FW_ARSP_SCALE_EN": 0.0}, 5.0) == 1.0
    a = {"SCALING_SPEED": 15.0, "ARSPD_FBW_MIN": 9.0, "ARSPD_FBW_MAX": 22.0}
    found = [ardupilot.airspeed_ratio(a, v) for v in (10.0, 100.0, 0.0)]
    assert found == pytest.approx([1.5, 15.0 / 44.0, 15.0 / 6.3])


def test_mixing_is_the_documented_one_and_turns_about_one_axis_at_a_time() -> None:
    """PX4's quadrotor in X: 0.707 of a command about roll and pitch, all of one about yaw; a hexarotor turns as it is told.

    ArduCopter: half of the range in which motors spin; Crazyflie: M1, front right, m1 = thrust - r / 2 + p / 2 + yaw.
    """
    quad = 0.2 * np.array([[1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, 1.0, 0.0]])
    turning, diagonal = np.array([1.0, 1.0, -1.0, -1.0]), math.sqrt(0.5)
    documented = np.tile([diagonal, diagonal, 1.0], (4, 1))
    np.testing.assert_allclose(np.abs(px4.mixing({}, quad, turning)), documented, rtol=1e-9)
    linear = {"MOT_THST_EXPO": 0.0, "MOT_SPIN_MIN": 0.1, "MOT_SPIN_MAX": 0.9}
    np.testing.assert_allclose(np.abs(ardupilot.mixing(linear, quad, turning)), 0.4, rtol=1e-9)
    first = crazyflie.mixing({}, quad, turning)[0] * 65535.0 / 32767.0
    np.testing.assert_allclose(first, [-0.5, 0.5, 1.0], rtol=1e-9)
    angles = np.radians([90.0, -90.0, -30.0, 150.0, 30.0, -150.0])
    hexa = 0.4 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
    sixfold = np.array([-1.0, 1.0, -1.0, 1.0, 1.0, -1.0])
    both = ((quad, turning), (hexa, sixfold))
    for law, (places, spins) in itertools.product((px4, ardupilot, crazyflie), both):
        mixed = law.mixing({}, places, spins)
        turned = np.array([-places[:, 1] @ mixed, places[:, 0] @ mixed, spins @ mixed])
        np.testing.assert_allclose(turned, np.diag(np.diag(turned)), atol=1e-12)
        assert np.all(np.diag(turned) > 0.0)
        np.testing.assert_allclose(mixed.sum(axis=0), 0.0, atol=1e-12)


@given(st.floats(0.01, 1.0), st.floats(0.05, 0.95))
def test_the_slope_of_a_thrust_curve_is_that_of_its_inverse(curve: float, thrust: float) -> None:
    def command(asked: float) -> float:
        return (curve - 1.0 + math.sqrt((1.0 - curve) ** 2 + 4.0 * curve * asked)) / (2.0 * curve)

    slope = (command(thrust + 1e-4) - command(thrust - 1e-4)) / 2e-4
    assert thrust_slope(curve, thrust) == pytest.approx(slope, rel=1e-4)


def test_bad_parameters_are_one_line_and_what_a_law_leaves_out_is_named() -> None:
    assert not px4.fixed_wing(PX4, "roll").lacks
    assert "IMU_GYRO_DNF_EN" in px4.fixed_wing(PX4 | {"IMU_GYRO_DNF_EN": 3.0}, "roll").lacks[0]
    found = ardupilot.plane(PLANE | {"INS_HNTCH_ENABLE": 1.0, "RLL_RATE_PDMX": 0.2}, "roll").lacks
    assert [text.split("(")[1] for text in found] == ["RLL_RATE_PDMX)", "INS_HNTCH_ENABLE)"]
    for values, said in (
        ({}, "FW_RR_P is missing"), (PX4 | {"FW_RR_P": math.nan}, "FW_RR_P = nan: it must be a number of at least 0"),
        (PX4 | {"FW_RR_I": -0.1}, "FW_RR_I = -0.1: it must"), (PX4 | {"IMU_GYRO_CUTOFF": 250.0}, "half the rate of its loop"),
    ):  # fmt: skip
        with pytest.raises(StoopError, match=said):
            px4.fixed_wing(values, "roll")


def test_files_of_parameters_by_hand(tmp_path: Path) -> None:
    first, second, wrong = files = [tmp_path / name for name in ("a.parm", "b.parm", "c.parm")]
    texts = "FW_RR_P = 0.4\nFW_RR_I,0.1\n", "FW_RR_P 0.6\n", "FW_RR_P 0,4\n"
    for file, text in zip(files, texts, strict=True):
        file.write_text(text)
    assert read_parameters(first, second) == {"FW_RR_P": 0.6, "FW_RR_I": 0.1}
    with pytest.raises(StoopError, match=r"'FW_RR_P 0,4': write the number with a point, 0\.4"):
        read_parameters(wrong)
    assert [firmwares(values)[0].title for values in (PX4, PLANE)] == ["PX4 fixed wing", "ArduPlane"]
    with pytest.raises(StoopError, match="no parameters of an autopilot that is known"):
        firmwares({"KP": 1.0})
    with pytest.raises(StoopError, match="those of PX4 fixed wing and of ArduPlane"):
        firmware_of({"FW_RR_P": 0.1, "RLL_RATE_P": 0.1}, rotors=False)


def test_planes_before_4_1_and_thin_air() -> None:
    """AP_RollController, deg of a full deflection of 45; feedforward is less by the ratio of true to equivalent airspeed."""
    (signals, scale), thin, dt = recorded(5), 1.2, 0.02
    k = {"P": 1.2, "TCONST": 0.4, "I": 0.3, "D": 0.08, "FF": 0.1, "IMAX": 500.0}
    law = ardupilot.old_plane({f"RLL2SRV_{n}": x for n, x in k.items()}, "roll", thin)
    found, integral = law.outputs(signals, scale), 0.0
    per_rate = max((k["P"] - k["I"] * k["TCONST"]) * k["TCONST"] - k["D"], 0.0) / thin
    for i in range(COUNT):
        desired, turning = (math.degrees(float(signals[n][i])) for n in (SETPOINT, RATE))
        scaler, error = float(scale[i]), (desired - turning) * float(scale[i])
        grown = integral + error * k["I"] * k["TCONST"] * dt * scaler
        integral = max(-k["IMAX"] / 100.0, min(k["IMAX"] / 100.0, grown))
        expected = {"P": desired * per_rate * scaler, "I": integral, "D": error * k["D"] * scaler,
                    "FF": desired * k["FF"] / thin * scaler}  # fmt: skip
        for name, degrees in expected.items():
            assert found[name][i] == pytest.approx(degrees / 45.0, rel=1e-9, abs=1e-12), (name, i)
    new, dense = (ardupilot.plane(PLANE, "roll", ratio).outputs(signals, scale) for ratio in (thin, 1.0))
    np.testing.assert_allclose(new["FF"] * thin, dense["FF"], rtol=1e-12)
    np.testing.assert_array_equal(new["P"], dense["P"])


SHORT = 600
BETAFLIGHT = {"looptime": 500.0, "pid_process_denom": 2.0, "yawPID[0]": 45.0, "yawPID[1]": 20.0, "yawPID[2]": 10.0,
              "gyro_lpf1_static_hz": 250.0, "dterm_lpf1_static_hz": 75.0, "yaw_lowpass_hz": 100.0, "ff_weight[2]": 80.0,
              "gyro_lpf2_static_hz": 0.0, "dterm_lpf2_static_hz": 0.0}  # fmt: skip
LAWS = {
    **{name: law for name, (law, _) in CASES.items()},
    "yaw of px4": px4.multicopter({"MC_YAWRATE_P": 0.2, "MC_YAW_TQ_CUTOFF": 2.0}, "yaw"),
    "betaflight": betaflight.rate_pid(BETAFLIGHT, "yaw"),
    "crazyflie": crazyflie.cascade({"pid_rate.roll_kp": 250.0}, "roll"),
}


def steps(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    setpoint = np.repeat(rng.normal(0.0, 2.0, SHORT // 60), 60)
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
    law, records = LAWS[name], [steps(1), steps(2)]
    scaled = law.terms[0].power and name != "plane"
    scale = 1.0 + (0.2 if scaled else 0.0) * np.sin(np.arange(SHORT) / 50.0)
    expected = [law.outputs({SETPOINT: s, **sensed(law, rate)}, scale)["command"] for s, rate in records]
    setpoints, rates = (np.column_stack([r[i] for r in records]) for i in range(2))
    running = LawRecursion([law], np.zeros((1, 2)))
    rows = zip(setpoints[:, None], rates[:, None], np.repeat(scale[:, None], 2, axis=1), strict=True)
    found = np.concatenate([running.commands(*row, running.unlimited) for row in rows])
    assert np.ptp(expected[0]) > 1e-2
    np.testing.assert_allclose(found.T, expected, rtol=1e-8, atol=1e-10)


def test_an_integral_stops_where_actuators_end() -> None:
    """Against its limit the integral stays; it shrinks at once when the error turns."""
    law = ardupilot.copter({"ATC_RAT_RLL_P": 0.1, "ATC_RAT_RLL_I": 1.0, "ATC_RAT_RLL_IMAX": 0.9}, "roll")
    done = none = np.zeros((1, 1))
    running, held = LawRecursion([law], none), []
    for count, asked in ((800, 3.0), (40, -3.0)):
        for _ in range(count):
            done = np.minimum(running.commands(none + asked, none, np.ones(1), done), 0.2)
        held.append(float(running.integrals.max()))
    assert 0.0 < held[0] < 0.2
    assert held[1] < held[0]
