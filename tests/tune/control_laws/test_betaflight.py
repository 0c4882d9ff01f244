"""Betaflight's rate law, angle mode and mixer beside naive twins and their recorded responses."""

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stoop.errors import StoopError
from stoop_tune.control_laws.betaflight import level, mixing, rate_pid, settable, thrust_slope
from stoop_tune.control_laws.parameters import read_parameters
from stoop_tune.control_laws.rate_law import AXES, RATE, SETPOINT
from stoop_tune.control_laws.table import firmwares

Floats = NDArray[np.float64]
Step = Callable[[float], float]
HEADER = {"looptime": 125.0, "pid_process_denom": 2.0, "rollPID[0]": 45.0, "rollPID[1]": 80.0, "rollPID[2]": 40.0,
          "pitchPID[0]": 47.0, "pitchPID[1]": 84.0, "pitchPID[2]": 34.0, "yawPID[0]": 45.0, "yawPID[1]": 80.0,
          "yawPID[2]": 5.0, "ff_weight[0]": 120.0, "ff_weight[1]": 125.0, "ff_weight[2]": 80.0, "yaw_lowpass_hz": 100.0,
          "pidsum_limit": 500.0, "pidsum_limit_yaw": 400.0, "dterm_notch_hz": 260.0, "dterm_notch_cutoff": 160.0,
          "dterm_lpf1_type": 0.0, "dterm_lpf1_static_hz": 75.0, "dterm_lpf2_type": 1.0, "dterm_lpf2_static_hz": 150.0,
          "gyro_lpf1_type": 0.0, "gyro_lpf1_static_hz": 250.0, "gyro_lpf2_type": 0.0, "gyro_lpf2_static_hz": 500.0,
          "gyro_notch_hz[0]": 180.0, "gyro_notch_cutoff[0]": 120.0}  # fmt: skip


def first_order(cutoff: float, dt: float, count: int = 1, shift: float = 1.0) -> Step:
    """PT1, PT2 or PT3: states that follow one another by k = w / (w + 1)."""
    w = 2.0 * math.pi * cutoff * shift * dt
    k, states = w / (w + 1.0), [0.0] * count

    def step(x: float) -> float:
        for n in range(count):
            states[n] += k * (x - states[n])
            x = states[n]
        return x

    return step


def second_order(frequency: float, dt: float, q: float, is_notch: bool) -> Step:
    """Direct form 1, coefficients of the cookbook of audio filters."""
    w = 2.0 * math.pi * frequency * dt
    alpha, c = math.sin(w) / (2.0 * q), math.cos(w)
    b = (1.0, -2.0 * c, 1.0) if is_notch else ((1.0 - c) / 2.0, 1.0 - c, (1.0 - c) / 2.0)
    x1 = x2 = y1 = y2 = 0.0

    def step(x: float) -> float:
        nonlocal x1, x2, y1, y2
        y = (b[0] * x + b[1] * x1 + b[2] * x2 + 2.0 * c * y1 - (1.0 - alpha) * y2) / (1.0 + alpha)
        x1, x2, y1, y2 = x, x1, y, y1
        return y

    return step


def smoother(kind: float, cutoff: float, dt: float) -> Step:
    if not cutoff:
        return lambda x: x
    if kind == 1:
        return second_order(cutoff, dt, 1.0 / math.sqrt(2.0), is_notch=False)
    return first_order(cutoff, dt, *{0: (1, 1.0), 2: (2, 1.553773974), 3: (3, 1.961459177)}[int(kind)])


def stop_band(center: float, cutoff: float, dt: float) -> Step:
    return second_order(center, dt, center * cutoff / (center**2 - cutoff**2), is_notch=True)


class Twin:
    """One axis in deg/s, a sample at a time, from rest; terms as the firmware logs them."""

    def __init__(self, h: dict[str, float], axis: str, limit: float = 400.0) -> None:
        self.dt = 1e-6 * h["looptime"] * h["pid_process_denom"]
        self.gains = [h[f"{axis}PID[{n}]"] for n in range(3)] + [h[f"ff_weight[{AXES.index(axis)}]"]]
        self.yaw, self.limit, self.integral = axis == "yaw", limit, 0.0
        kinds = ((h[f"dterm_lpf{n}_type"], h[f"dterm_lpf{n}_static_hz"]) for n in (1, 2))
        notch = stop_band(h["dterm_notch_hz"], h["dterm_notch_cutoff"], self.dt)
        self.lags = [notch, *(smoother(*kind, self.dt) for kind in kinds)]
        self.of_yaw = first_order(h["yaw_lowpass_hz"], self.dt)
        self.before = self.setpoint_before = 0.0

    def step(self, setpoint: float, gyro: float) -> dict[str, float]:
        p, i, d, f = self.gains
        error = setpoint - gyro
        proportional = 0.032029 * p * error
        if self.yaw:
            proportional, i = self.of_yaw(proportional), 2.5 * i
        grown = self.integral + 0.244381 * i * error * self.dt
        self.integral = max(-self.limit, min(self.limit, grown))
        smooth = gyro
        for lag in self.lags:
            smooth = lag(smooth)
        damping = -0.000529 * d * (smooth - self.before) / self.dt
        ahead = 0.013754 * f / 100.0 * (setpoint - self.setpoint_before) / self.dt
        self.before, self.setpoint_before = smooth, setpoint
        return {"P": proportional, "I": self.integral, "D": damping, "FF": ahead}


def flown(twin: Any, setpoint: Floats, gyro: Floats) -> dict[str, Floats]:
    rows = [twin.step(*pair) for pair in zip(setpoint.tolist(), gyro.tolist(), strict=True)]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("axis", AXES)
def test_terms_are_those_of_the_twin(axis: str) -> None:
    for kinds in ((0, 1), (1, 2), (2, 3), (3, 0)) if axis == "roll" else ((0, 1),):
        header = HEADER | {"dterm_lpf1_type": float(kinds[0]), "dterm_lpf2_type": float(kinds[1])}
        rng = np.random.default_rng(kinds[0])
        setpoint, gyro = 300.0 * rng.standard_normal((2, 3000)).cumsum(axis=1) / 20.0
        setpoint[0] = gyro[0] = 0.0
        law, known = rate_pid(header, axis), flown(Twin(header, axis), setpoint, gyro)
        found = law.outputs({SETPOINT: np.radians(setpoint), RATE: np.radians(gyro)})
        for name, values in known.items():
            size = np.abs(values).max()
            np.testing.assert_allclose(1000.0 * found[name], values, rtol=1e-9, atol=1e-9 * size)
        total = np.clip(sum(known.values()) / 1000.0, -(limit := 0.4 if axis == "yaw" else 0.5), limit)
        np.testing.assert_allclose(found["command"], total, atol=1e-9)
        assert np.abs(known["I"]).max() == 400.0  # its limit was met


def of_step(twin: Any, signal: str, n: int) -> tuple[Floats, NDArray[np.complex128]]:
    """Return frequencies a sample and H: the answer to a step, differenced twice, dies out; its transform is H (1 - 1/z)."""
    w, step, rest = 2.0 * np.pi * np.arange(1, n // 2) / n, np.ones(n), np.zeros(n)
    record = flown(twin, *((step, rest) if signal == SETPOINT else (rest, step)))
    answer = np.diff(np.diff(sum(record.values()), prepend=0.0), prepend=0.0)
    return w, np.fft.rfft(answer)[1 : n // 2] / (1.0 - np.exp(-1j * w))


def test_response_is_that_of_a_recorded_step() -> None:
    for axis, signal in itertools.product(("roll", "yaw"), (SETPOINT, RATE)):
        law, (w, known) = rate_pid(HEADER, axis), of_step(Twin(HEADER, axis), signal, 8192)
        found = law.response(signal, w * law.rate) * 1000.0 * np.pi / 180.0
        np.testing.assert_allclose(found, known, rtol=1e-6, err_msg=f"{axis} {signal}")


@pytest.mark.parametrize(("frequency", "kind", "new", "cutoff"), [
    (60.0, 0, True, 500.0), (170.0, 1, True, 500.0), (900.0, 3, True, 300.0), (60.0, 2, False, 300.0), (900.0, 0, True, 0.0),
])  # fmt: skip
def test_a_sine_through_filters_of_the_gyro(frequency: float, kind: int, new: bool, cutoff: float) -> None:
    """Second low-pass or mean at 8 kHz, every second sample kept, notch and first low-pass at 4 kHz."""
    header = HEADER | {"gyro_lpf2_type": float(kind), "gyro_lpf2_static_hz": cutoff}
    header |= {"d_max[0]": 0.0} if new else {}
    fast, slow = 125e-6, 250e-6
    # before 2025.12 two in series had the cutoff of one
    first = first_order(cutoff, fast, 2) if kind == 2 else smoother(kind, cutoff, fast)
    lags = [stop_band(180.0, 120.0, slow), first_order(250.0, slow)]
    n, w = 8000, 2.0 * np.pi * frequency
    samples = [first(math.sin(w * k * fast)) for k in range(2 * n)]
    kept = samples[1::2] if cutoff else np.reshape(samples, (-1, 2)).mean(axis=1)
    for lag in lags:
        kept = [lag(x) for x in kept]
    at = (2 * np.arange(n) + 1) * fast
    basis = np.column_stack([np.sin(w * at), np.cos(w * at)])[n // 2 :]
    a, b = np.linalg.lstsq(basis, kept[n // 2 :], rcond=None)[0]
    law = rate_pid(header, "roll")
    (found,) = -law.feedback(np.array([w])) / law.response(RATE, np.array([w]))
    assert found == pytest.approx(complex(a, b), rel=1e-6)


#: motors in the order of the firmware: rear right, front right, rear left, front left; shares of roll, pitch (nose down) and yaw
QUAD_X = ((-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0), (1.0, 1.0, 1.0), (1.0, -1.0, -1.0))
PLACES = np.array([[-0.1, 0.12, 0.0], [0.08, 0.11, 0.0], [-0.1, -0.12, 0.0], [0.08, -0.11, 0.0]])
TURNING = np.array([-1.0, 1.0, 1.0, -1.0])  # propellers in
DSHOT = {"motorOutput[0]": 158.0, "motorOutput[1]": 1847.0}
PULSES = {"motorOutput[0]": 1070.0, "motorOutput[1]": 1900.0, "minthrottle": 1070.0, "maxthrottle": 2000.0}


def motors(output: tuple[float, float], e: float, newer: bool, throttle: float, sums: Floats) -> Floats:
    """Return what is written to four motors for limited sums about the axes, in the firmware's signs."""
    roll, pitch, yaw = sums / 1000.0
    x = np.array([share[0] * roll + share[1] * pitch + share[2] * -yaw + throttle for share in QUAD_X])
    x *= 1.0 + e * (1.0 - x) * (1.0 + e * (1.0 - x - x) if newer else 1.0 - x)
    return output[0] + (output[1] - output[0]) * x


def test_motors_move_as_the_mixer_moves_them() -> None:
    ranges, step = ((DSHOT, 48.0, 2047.0), (PULSES, 1070.0, 2000.0)), 1e-3
    for (range_, stop, full), e, newer in itertools.product(ranges, (0.0, 0.4, 1.0), (False, True)):
        header = HEADER | range_ | {"thrust_linear": 100.0 * e} | ({"ap_position_f": 80.0} if newer else {})
        output = range_["motorOutput[0]"], range_["motorOutput[1]"]
        hover = float((motors(output, e, newer, 0.3, np.zeros(3))[0] - stop) / (full - stop))
        found = thrust_slope(header, hover) * mixing(header, PLACES, TURNING)
        for k, sign in enumerate((1.0, -1.0, -1.0)):  # pitch and yaw of the firmware count the other way
            sums = 1000.0 * step * sign * np.eye(3)[k]
            more, less = (motors(output, e, newer, 0.3, x) for x in (sums, -sums))
            np.testing.assert_allclose(found[:, k], (more - less) / (2.0 * step * (full - stop)), rtol=1e-5)
        if range_ is DSHOT:
            limit = 1.0 - e + e**2 if newer else 1.0
            assert thrust_slope(header, 1.0) == pytest.approx(limit), "at the limit of a motor"


def test_mixers_that_are_not_modeled_are_refused() -> None:
    frames = (PLACES[:3], PLACES - [0.0, 0.11, 0.0], np.vstack([PLACES, PLACES])[[0, 1, 1, 3]])
    for header, places, said in (
        *((HEADER | DSHOT, places, "the mixer is modeled of a quad X alone") for places in frames),
        (HEADER, PLACES, r"motorOutput\[0\] is missing"),
        (HEADER | dict.fromkeys(DSHOT, 158.0), PLACES, r"motorOutput\[1\] = 158 is not above motorOutput\[0\] = 158"),
    ):  # fmt: skip
        with pytest.raises(StoopError, match=said):
            mixing(header, places, TURNING[: len(places)])


def test_angle_mode_is_that_of_the_twin() -> None:
    """The error of an angle, deg, times a tenth of its gain, through three low-passes of 50 Hz."""
    asked, turned = 20.0 * np.random.default_rng(2).standard_normal((2, 2000)).cumsum(axis=1) / 20.0
    asked[0] = turned[0] = 0.0
    smooth = first_order(50.0, 250e-6, 3, 1.961459177)
    known = np.array([*map(smooth, 6.0 * (asked - turned))])
    law = level(HEADER | {"levelPID[0]": 60.0}, "pitch")
    found = np.degrees(law.outputs({SETPOINT: np.radians(asked), RATE: np.radians(turned)})["command"])
    np.testing.assert_allclose(found, known, rtol=1e-7, atol=1e-9 * np.abs(known).max())
    assert not level(HEADER, "yaw").outputs({SETPOINT: asked, RATE: turned})["command"].any()


def test_commands_are_read_as_the_header_has_them(tmp_path: Path) -> None:
    """Names and words of `dump` in 4.2 and in 4.5; a word that is not known is refused by the law that reads it."""
    commands = {
        "gyro_lpf1_dyn_min_hz = 250": ("gyro_lpf1_dyn_hz[0]", 250.0), "dyn_lpf_dterm_min_hz = 70": ("dterm_lpf1_dyn_hz[0]", 70.0),
        "dterm_lowpass_type = BIQUAD": ("dterm_lpf1_type", 1.0), "dterm_lpf2_type = PT3": ("dterm_lpf2_type", 3.0),
        "iterm_relax = RPY": ("iterm_relax", 2.0), "feedforward_averaging = 2_POINT": ("feedforward_averaging", 1.0),
        "f_pitch = 125": ("ff_weight[1]", 125.0), "gyro_notch2_cutoff = 90": ("gyro_notch_cutoff[1]", 90.0),
        "dshot_bidir = OFF": ("dshot_bidir", 0.0), "p_roll = 50": ("rollPID[0]", 50.0), "d_min_pitch = 31": ("d_min[1]", 31.0),
    }  # fmt: skip
    file = tmp_path / "gains.config"
    file.write_text("feature -AIRMODE\n" + "".join(f"set {line}\n" for line in commands))
    assert read_parameters(file) == dict(commands.values())
    assert len(rate_pid(HEADER | read_parameters(file), "roll").lacks) == 4
    file.write_text("set gps_provider = UBLOX\nset dterm_lpf1_type = PT4\n")
    with pytest.raises(StoopError, match="dterm_lpf1_type = nan: it must be a number"):
        rate_pid(HEADER | read_parameters(file), "roll")
    profiles = "profile 0\nset p_roll = 50\nprofile 1\nset p_roll = {}\nset i_roll = 80\nprofile 0\n"
    file.write_text(profiles.format(50))
    assert read_parameters(file)["rollPID[0]"] == 50.0
    file.write_text(profiles.format(45))
    with pytest.raises(StoopError, match=r"rollPID\[0\] is set to 50 and to 45"):
        read_parameters(file)
    old = {"dterm_lpf1_static_hz": "dterm_lowpass_hz", "dterm_lpf1_type": "dterm_filter_type", "ff_weight[0]":
           "feedforward_weight[0]", "dterm_lpf2_static_hz": "dterm_lowpass2_hz", "dterm_lpf2_type": "dterm_filter2_type",
           "gyro_lpf1_static_hz": "gyro_lowpass_hz", "gyro_lpf2_static_hz": "gyro_lowpass2_hz"}  # fmt: skip
    before_4_3 = {old.get(n, n): x for n, x in HEADER.items()}
    assert rate_pid(before_4_3, "roll") == rate_pid(HEADER, "roll")


def test_the_gain_of_d_is_the_one_that_the_law_takes_and_gains_are_whole() -> None:
    assert [settable(x) for x in (44.9999999999, 44.9, 0.3, 200.0)] == [45.0, 44.0, 1.0, 200.0]
    for least, named in ((0.0, "rollPID[2]"), (20.0, "d_min[0]"), (40.0, "rollPID[2]")):
        header = HEADER | {"d_min[0]": least}
        assert firmwares(header)[0].gains("roll", header)["D"] == named
        assert rate_pid(header | {named: 35.0}, "roll").terms[2] != rate_pid(header, "roll").terms[2]


def test_what_is_left_out_is_named() -> None:
    for switched, axes in (
        ({"iterm_relax": 1.0}, "roll pitch"), ({"iterm_relax": 2.0}, "roll pitch yaw"),
        ({"dyn_notch_count": 3.0}, "roll pitch yaw"), ({"rpm_filter_harmonics": 3.0}, "roll pitch yaw"),
        ({"rpm_filter_harmonics": 3.0, "dshot_bidir": 0.0}, ""), ({"d_min[1]": 20.0}, "pitch"),
        ({"d_max[0]": 50.0}, "roll"), ({"anti_gravity_gain": 80.0}, "roll pitch"),
        ({"anti_gravity_gain": 1000.0, "anti_gravity_mode": 0.0}, ""),
        ({"anti_gravity_gain": 3500.0, "anti_gravity_mode": 0.0}, "roll pitch yaw"),
        ({"features": 2.0**29 + 2.0**22, "dyn_notch_max_hz": 350.0}, "roll pitch yaw"),
        ({"dterm_lpf1_dyn_hz[0]": 75.0}, "roll pitch yaw"), ({"gyro_lpf1_dyn_hz[0]": 250.0}, "roll pitch yaw"),
        ({"tpa_rate": 65.0}, "roll pitch yaw"), ({"feedforward_boost": 15.0}, "roll pitch yaw"),
        ({"vbat_sag_compensation": 100.0}, "roll pitch yaw"), ({"features": 0.0}, "roll pitch yaw"),
        ({"dyn_idle_min_rpm": 35.0}, "roll pitch yaw"), ({"dyn_idle_min_rpm": 35.0, "dshot_bidir": 0.0}, ""),
        ({"use_integrated_yaw": 1.0}, "yaw"), ({"abs_control_gain": 10.0}, "roll pitch yaw"),
    ):  # fmt: skip
        found = {axis: rate_pid(HEADER | switched, axis).lacks for axis in AXES}
        assert [axis for axis, lacks in found.items() if lacks] == axes.split(), switched
        assert all(len(lacks) <= 1 for lacks in found.values())


def test_bad_headers() -> None:
    """Settings of `diff`, which leaves out what is at its default, are not taken for filters that are off."""
    nyquist = "not below half the rate"
    cases = [
        ({"rollPID[0]": None}, r"rollPID\[0\] is missing"), ({"looptime": None}, "looptime is missing"),
        ({"rollPID[1]": math.nan}, r"rollPID\[1\] = nan"), ({"rollPID[2]": -1.0}, "= -1: it must be"),
        ({"looptime": 0.0}, "looptime = 0"), ({"dterm_lpf1_static_hz": 2000.0}, nyquist),
        ({"dterm_lpf2_static_hz": 2500.0}, nyquist), ({"dterm_notch_hz": 2100.0}, nyquist),
        ({"gyro_lpf2_static_hz": 4000.0}, nyquist),
    ]  # fmt: skip
    for one in ("gyro_lpf1", "gyro_lpf2", "dterm_lpf1", "dterm_lpf2"):
        lost = dict.fromkeys(n for n in HEADER if n.startswith(one))
        cases.append((lost, f"{one}_static_hz is missing; take them from a log"))
    for wrong, word in cases:
        with pytest.raises(StoopError, match=word):
            rate_pid({n: x for n, x in (HEADER | wrong).items() if x is not None}, "roll")
