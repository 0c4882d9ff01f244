"""Files with which a maneuver is flown: their scripts send the designed input, by clocks and links that are not there."""

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import lupa
import numpy as np
import pytest
from helpers.flown import maneuver

from stoop.errors import SimulationError
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import builtin_vehicle
from stoop_export.exporter import load_script
from stoop_plan.injection import Injection, corners
from stoop_plan.injection_targets import ARDUPILOT, CRAZYFLIE, PILOT, PX4

THROWS = {"elevator": math.radians(25.0), "aileron": math.radians(20.0), "rudder": math.radians(30.0)}
GAINS = {"FW_RR_P": 0.05, "FW_RR_FF": 0.5, "FW_PR_P": 0.08, "FW_PR_FF": 0.4, "FW_YR_P": 0.05, "FW_YR_FF": 0.3}
SCALING = {"FW_ARSP_SCALE_EN": 1e-45, "FW_AIRSPD_TRIM": 30.0, "FW_AIRSPD_STALL": 15.0, "FW_AIRSPD_MAX": 45.0}
WINGS = """
duration = 12.0
airspeed = 35.0
input = [
  { control = "elevator", shape = "3-2-1-1", start = 1.0, step = 0.5, amplitude = 0.04, slew = 1.0 },
  { control = "aileron", shape = "doublet", start = 6.0, step = 0.5, amplitude = -0.03 },
  { control = "rudder", shape = "harmonics", start = 0.5, duration = 11.0, harmonics=[3,9], amplitudes=[0.02,0.02], phases=[0,0]},
]
"""
SWEEPS = """
duration = 50.0
input = [
  { control = "roll", shape = "sweep", start = 1.0, duration = 20.0, amplitude = 8.0, low = 0.4, band = 8.0, fade = 2.0 },
  { control = "heave", shape = "sweep", start = 25.0, duration = 20.0, amplitude = 1.0, low = 0.5, band = 5.0, fade = 1.0 },
]
"""
DOUBLETS = """
duration = 8.0
input = [
  { control = "roll", shape = "doublet", start = 1.0, step = 0.3, amplitude = 6.0 },
  { control = "yaw", shape = "doublet", start = 5.0, step = 0.4, amplitude = 1.0 },
]
"""


@cache
def injection(name: str, text: str) -> Injection:
    vehicle, course = builtin_vehicle(name), parse_maneuver(text, "m.toml")
    point = trim(vehicle, course.airspeed, course.altitude)
    flown = simulate_flight(vehicle, course, noise=False)
    readings = np.column_stack([flown.column(c) for c in vehicle.outputs])
    envelope = {"V": (28.0, 42.0), "phi": (-0.2, 0.6), "theta": (-0.4, 0.3)}
    return Injection(vehicle, point, course, readings, envelope, THROWS)


def wings() -> Injection:
    return injection("twin-boom", WINGS)


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += max(seconds, 1e-6)


def module(folder: Path, files: dict[str, str], name: str) -> Any:
    for file, text in files.items():
        (folder / file).write_text(text)
    script = load_script(folder / name)
    script.time = Clock()
    return script


def test_corners_keep_within_the_tolerance() -> None:
    t = np.arange(2000) / 100.0
    kept = corners(t, x := np.sin(t) + (t > 5.0), 0.01)
    assert len(kept) < 200
    assert np.abs(np.interp(t, *kept.T) - x).max() <= 0.01


class Plane:
    """What a script of ArduPilot sees; servo 1 is an elevator, 2 reversed ailerons, 5 a second aileron, 4 the rudder."""

    def __init__(self) -> None:
        self.ms, self.aux, self.mode, self.roll, self.pitch, self.airspeed = 0, 0, 5, 0.0, 0.05, 35.0
        self.scaled = {19: 450.0, 4: -300.0, 21: 0.0}
        functions = {1: 19, 2: 4, 4: 21, 5: 4, 3: 70}
        self.parameters = {"SERVO2_REVERSED": 1.0}
        for n, function in functions.items():
            ends = {"FUNCTION": function, "MIN": 1100.0, "MAX": 1900.0, "TRIM": 1480.0}
            self.parameters |= {f"SERVO{n}_{key}": float(value) for key, value in ends.items()}
            self.parameters.setdefault(f"SERVO{n}_REVERSED", 0.0)
        self.sent: dict[int, list[tuple[float, int]]] = {}
        self.said: list[str] = []
        self.angles = ""  # "_rad" where the angles carry their unit, as from ArduPilot 4.7 on

    def api(self) -> dict[str, dict[str, Any]]:
        return {
            "param": {"get": lambda _, key: self.parameters.get(key)},
            "rc": {"get_aux_cached": lambda _, option: self.aux if option == 300 else None},
            "vehicle": {"get_mode": lambda _: self.mode, "get_likely_flying": lambda _: self.airspeed > 3.0},
            "arming": {"is_armed": lambda _: True},
            "ahrs": {
                f"get_roll{self.angles}": lambda _: self.roll, f"get_pitch{self.angles}": lambda _: self.pitch,
                "airspeed_estimate": lambda _: self.airspeed,
            },
            "gcs": {"send_text": lambda _, __, text: self.said.append(text)},
            "logger": {"write": lambda *_: None},
            "SRV_Channels": {"get_output_scaled": lambda _, f: self.scaled[f], "set_output_pwm_chan_timeout": self.pulse},
        }  # fmt: skip

    def pulse(self, _: Any, channel: int, pwm: int, timeout: int) -> None:
        assert (timeout > 10, type(pwm)) == (True, int)
        self.sent.setdefault(channel + 1, []).append((self.ms / 1000.0, pwm))


def lua_update(text: str, plane: Plane) -> Any:
    lua = lupa.LuaRuntime(unpack_returned_tuples=True)
    for name, functions in plane.api().items():
        lua.globals()[name] = lua.table_from(functions)
    lua.globals().now = lambda: plane.ms
    lua.execute("""
      local uint = {}
      uint.__index = {tofloat = function(self) return self.value end}
      uint.__sub = function(a, b) return setmetatable({value = a.value - b.value}, uint) end
      function millis() return setmetatable({value = now()}, uint) end
    """)
    return lua.execute(text)


def flown_by(plane: Plane, seconds: float, upset: Any = lambda _: None) -> None:
    text = ARDUPILOT.write(wings())["maneuver.lua"].replace("local SCALE = 0.5 ", "local SCALE = 1.0 ")
    update, period = lua_update(text, plane)
    for k in range(round(1000.0 * seconds / period)):
        plane.ms, plane.aux = plane.ms + period, 2 if k > 20 else 0
        upset(plane)
        update, period = update()


def test_the_script_of_a_plane_adds_the_maneuver() -> None:
    """Elevator down and rudder left are positive here; ailerons that roll right are."""
    plane, course = Plane(), wings().maneuver
    flown_by(plane, 14.0)
    assert plane.said == ["maneuver: ready", "maneuver: begins", "maneuver: done"]
    assert set(plane.sent) == {1, 2, 4, 5}
    for n, control, base, sign in (
        (1, "elevator", 0.1, -1.0), (2, "aileron", -300 / 4500, -1.0), (5, "aileron", -300 / 4500, 1.0), (4, "rudder", 0.0, -1.0),
    ):  # fmt: skip
        t, pulses = np.array(plane.sent[n]).T
        reverse, t = -1.0 if n == 2 else 1.0, t - t[0] + 0.01
        x = reverse * np.where(pulses > 1480, (pulses - 1480) / 420.0, (pulses - 1480) / 380.0)
        moved = (x - base) * THROWS[control] * sign * reverse
        # within a sample: the largest change over 10 ms, and a pulse of one microsecond
        want = course.deflections()[control]
        late = [np.interp(t + d, course.time, want) for d in (-0.01, 0.0, 0.01)]
        slack = 0.003 * np.abs(late[1]).max() + THROWS[control] / 380.0
        assert (moved > np.min(late, axis=0) - slack).all()
        assert (moved < np.max(late, axis=0) + slack).all()
    lost = Plane()
    lost.parameters["SERVO4_FUNCTION"] = 70.0
    assert lua_update(ARDUPILOT.write(wings())["maneuver.lua"], lost) is None
    assert wings().airspeeds() == pytest.approx(np.array([28.0, 42.0]) * math.sqrt(1.20165 / 1.225), rel=1e-4)
    assert lost.said == ["maneuver: no servo of rudder: no SERVOn_FUNCTION is 21"]


def test_the_script_of_a_plane_ends_beyond_limits() -> None:
    """Or where a pilot ends it; before ArduPilot 4.7 and from then on, when angles carry their unit in their names."""
    for said, name, value, angles in (
        ("bank beyond the limit", "roll", 0.7, ""), ("bank beyond the limit", "roll", -0.25, "_rad"),
        ("pitch beyond the limit", "pitch", 0.35, ""), ("airspeed beyond the limit", "airspeed", 27.6, "_rad"),
        ("the mode changed", "mode", 0, ""), ("switched off", "aux", 0, "_rad"),
    ):  # fmt: skip
        plane = Plane()
        plane.angles = angles
        flown_by(plane, 5.0, lambda p, n=name, x=value: setattr(p, n, x if p.ms > 3000 else getattr(p, n)))
        assert plane.said[-1] == f"maneuver: {said}"
        assert max(t for t, _ in plane.sent[1]) <= 3.02
        assert plane.said.count("maneuver: begins") == 1, "it does not begin again while the switch stays up"
    still = Plane()
    still.airspeed = 0.5
    flown_by(still, 14.0)
    assert still.said[-1] == "maneuver: done", "surfaces move on the ground"


def waveform(p: dict[str, float], time: np.ndarray) -> np.ndarray:
    w_min, w_max = 2 * math.pi * p["SID_F_START_HZ"], 2 * math.pi * p["SID_F_STOP_HZ"]
    record, constant, b = p["SID_T_REC"], 2.0 / p["SID_F_START_HZ"], math.log(w_max / w_min)
    faded = np.minimum(time / p["SID_T_FADE_IN"], (record - time) / p["SID_T_FADE_OUT"]).clip(0.0, 1.0)
    late = (time - constant).clip(0.0)
    phase = w_min * (record - constant) / b * np.expm1(b * late / (record - constant))
    phase += w_min * (time - constant - late)
    return (0.5 - 0.5 * np.cos(math.pi * faded)) * np.sin(phase)


def test_parameters_of_sweeps_give_the_designed_signal() -> None:
    one = injection("quad-x", SWEEPS)
    files = ARDUPILOT.write(one)
    assert set(files) == {"sid_roll.param", "sid_heave.param", "ardupilot.param"}
    for spec in one.maneuver.input:
        lines = files[f"sid_{spec.control}.param"].splitlines()
        assert re.match("# .*manual throttle", lines[1])
        p = {key: float(value) for key, value in (line.split(",") for line in lines[2:])}
        assert p["SID_AXIS"] == {"roll": 10, "heave": 13}[spec.control]
        t = one.maneuver.time[::5]
        want = spec.amplitude * waveform(p, t - spec.start)
        assert np.allclose(spec.signal(t), want, atol=1e-3 * spec.amplitude)
    # the motors' share of the throttle: what accelerates upwards, over what holds the weight
    square = one.trim.inputs[0] * 1.0 / 9.81 / 2.0  # thrust grows with about the square of the command
    assert p["SID_MAGNITUDE"] == pytest.approx(square, rel=0.5)


class Link:
    target_system = target_component = 1
    mode, roll, pitch, asked, silent, refuses, pending = 4 << 16, 0.0, 0.0, "", False, False, 0

    def __init__(self, clock: Clock) -> None:
        self.clock, self.mav, self.modes = clock, self, list[tuple[int, int]]()
        self.sent: list[tuple[float, int, tuple[float, ...], float]] = []
        self.upset: tuple[int, str, Any] = (0, "", 0)

    def param_request_read_send(self, _: int, __: int, name: bytes, ___: int) -> None:
        self.asked = name.decode()

    def recv_match(self, type: Any = None, blocking: bool = False, timeout: float = 0.0) -> Any:  # noqa: A002
        if type == "PARAM_VALUE":
            return SimpleNamespace(param_id=self.asked, param_value=(GAINS | SCALING)[self.asked])
        if blocking:
            return SimpleNamespace(throttle=55, yaw=1.0, airspeed=35.0)
        self.pending = (self.pending + 1) % 4
        if self.silent or self.pending == 0 or type is None:
            return None
        message = SimpleNamespace(roll=self.roll, pitch=self.pitch, airspeed=35.0, custom_mode=self.mode)
        kind = ("ATTITUDE", "VFR_HUD", "HEARTBEAT")[self.pending - 1]
        message.get_type, message.get_srcComponent = lambda: kind, lambda: 1
        return message

    def command_long_send(self, *words: int) -> None:
        command, base, main, sub = words[2], *words[4:7]
        assert (command, base) == (176, 1)
        self.modes.append((main, sub))
        self.mode = self.mode if self.refuses else main << 16

    def set_attitude_target_send(self, *words: Any) -> None:
        mask, q, *rates, thrust = words[3:]
        assert math.isclose(sum(v * v for v in q), 1.0)
        self.sent.append((self.clock.now, mask, tuple(rates), thrust))
        if len(self.sent) == self.upset[0]:
            setattr(self, *self.upset[1:])


def px4(tmp_path: Path) -> tuple[Any, Link, list[dict[str, float]]]:
    script = module(tmp_path, PX4.write(wings()), "fly_px4.py")
    return script, Link(script.time), script.read_rows(tmp_path / "px4_setpoints.csv")


def test_the_script_of_px4_sends_rates_that_give_the_maneuver(tmp_path: Path) -> None:
    """Put into PX4's law of control with the expected rates, the set-points give the designed outputs."""
    script, link, rows = px4(tmp_path)
    assert script.fly(link, rows, 1.0)
    assert link.modes == [(6, 0), (4, 3)]
    lines = PX4.write(wings())["px4.params"].splitlines()[2:]
    assert [len(line.split("\t")) for line in lines] == [5] * len(lines)
    times, masks, rates, thrusts = (np.array(column) for column in zip(*link.sent, strict=True))
    assert set(thrusts) == {0.55}
    k, t, course = 30.0 / 35.0, times[masks == 128], wings().maneuver  # k: airspeed scaling
    assert np.allclose(t - t[0], np.arange(601) / 50.0, atol=0.01)
    assert np.diff(times).max() < 0.1, "the stream never stops for half a second"
    rows = ("RR", "aileron", "p", 1.0), ("PR", "elevator", "q", -1.0), ("YR", "rudder", "r", -1.0)
    for i, (head, control, channel, sign) in enumerate(rows):
        p, ff, sent = GAINS[f"FW_{head}_P"], GAINS[f"FW_{head}_FF"], rates[masks == 128, i]
        turning = np.interp(t - t[0], course.time, wings().expected(channel) - wings().expected(channel)[0])
        output = ff * k * sent + p * k**2 * (sent - turning)
        want = np.interp(t - t[0], course.time, course.deflections()[control])
        assert np.allclose(sign * output * THROWS[control], want, atol=1e-6)


def test_the_script_of_px4_ends_for_pilots_limits_and_lost_links(tmp_path: Path) -> None:
    """A pilot takes over before, during and after the maneuver, and the script does not change the mode again."""
    back, offboard = (4, 3), (6, 0)
    for count, name, value, modes, most in (
        (150, "mode", 1 << 16, [offboard], 155), (400, "mode", 1 << 16, [offboard], 405), (900, "mode", 1 << 16, [offboard], 905),
        (500, "roll", 0.7, [offboard, back], 501), (500, "roll", -0.25, [offboard, back], 501),
        (500, "pitch", 0.35, [offboard, back], 501), (400, "silent", True, [offboard, back], 430),  # half a second
    ):  # fmt: skip
        script, link, rows = px4(tmp_path)
        link.upset = (count, name, value)
        assert not script.fly(link, rows, 1.0)
        assert (link.modes, len(link.sent) < most) == (modes, True), count
    script, link, rows = px4(tmp_path)
    link.refuses = True
    assert not script.fly(link, rows, 1.0)
    assert {mask for _, mask, *_ in link.sent} == {7}, "attitude alone was sent"


def test_the_script_of_the_crazyflie_sends_the_expected_attitude(tmp_path: Path) -> None:
    one, sent, stopped, values = injection("quad-x", DOUBLETS), [], [], []
    script = module(tmp_path, CRAZYFLIE.write(one), "fly_crazyflie.py")
    clock = script.time
    commander = SimpleNamespace(send_setpoint=lambda *_: None)
    commander.send_hover_setpoint = lambda *v: sent.append((clock.now, *v))
    commander.send_zdistance_setpoint = commander.send_hover_setpoint
    commander.send_stop_setpoint = lambda: stopped.append(clock.now)
    cf = SimpleNamespace(commander=commander, param=SimpleNamespace(set_value=lambda *v: values.append(v)))
    rows = script.read_rows(tmp_path / "crazyflie_setpoints.csv")
    config = (tmp_path / "config.txt").read_text().splitlines()
    assert max(map(len, config)) < 32, "the firmware reads no longer lines"
    assert script.fly(cf, rows, lambda: ((0.0, 0.0), clock.now), 1.0)
    assert (len(stopped), values) == (1, [("usd.logging", "1"), ("usd.logging", "0")])
    table = np.array(sent)
    first = int(np.argmax(np.abs(table[:, 1]) > 0.0))
    began = table[first, 0] - rows[next(i for i, r in enumerate(rows) if r["roll_deg"])]["time_s"]
    during = table[(table[:, 0] >= began - 1e-6) & (table[:, 0] <= began + 8.0)]
    t = during[:, 0] - began
    for column, channel in ((1, "phi"), (2, "theta"), (3, "r")):
        want = np.degrees(np.interp(t, one.maneuver.time, one.expected(channel)))
        assert np.allclose(during[:, column], want, atol=0.05 + np.abs(np.diff(want)).max())
    assert table[-1, 4] < 0.1, "it lands"
    assert not script.fly(cf, rows, lambda: ((50.0, 0.0), clock.now))
    assert sent[-1][4] < 0.1, "it lands after a tilt beyond the limits, too"
    began = clock.now
    assert not script.fly(cf, rows, lambda: ((0.0, 0.0), min(clock.now, began + 3.0)))
    assert clock.now < began + 3.5, "without telemetry it sends no more"
    assert stopped[-1] == clock.now


def test_the_card_counts_the_steps() -> None:
    step, roll = ("elevator", "3-2-1-1", 1.0, 0.5), ("aileron", "doublet", 12.0, 1.0, math.radians(2.0))
    course = maneuver(20.0, (*step, math.radians(-2.5)), roll, rate=100.0, airspeed=35.0)
    one = replace(wings(), maneuver=course, beat=0.5, throws={"elevator": math.radians(25.0)})
    text = PILOT.write(one)["card.txt"]
    found = [line.split(maxsplit=2) for line in text.splitlines() if "nose" in line or "wing" in line]
    assert found == [["nose", "up", "one - two - three"], ["nose", "down", "one - two"], ["nose", "up", "one"],
                     ["nose", "down", "one"], ["right", "wing", "down  one - two"],
                     ["left", "wing", "down   one - two"]]  # fmt: skip
    assert "ELEVATOR 3-2-1-1: stop at 2.5 deg (10 % of the stick)" in text
    assert "AILERON doublet: stop at 2 deg\n" in text


def test_refusals() -> None:
    two, near = {"elevator": 0.4, "aileron": 0.3}, {**THROWS, "aileron": 0.02}
    for target, name, text, throws, said in (
        (PILOT, "quad-x", DOUBLETS, {}, "on rotors; its sticks command"), (PX4, "quad-x", DOUBLETS, {}, "on rotors; rates alone"),
        (CRAZYFLIE, "twin-boom", WINGS, {}, "this flight is on wings; choose --for pilot"),
        (PX4, "twin-boom", WINGS, two, "how far rudder move .* add --throw rudder=DEG"),
        (ARDUPILOT, "twin-boom", WINGS, {"canard": 0.4}, "--throw canard: there is no such surface"),
        (ARDUPILOT, "twin-boom", WINGS, {"elevator": 0.0}, "above 0 and up to 90"),
    ):  # fmt: skip
        one = injection(name, text)
        with pytest.raises(SimulationError, match=said):
            target.check("it", one.vehicle, one.trim, one.moved_controls, throws)
    wing = wings()
    bare: Any = SimpleNamespace(outputs=("V", "p"), controls=wing.vehicle.controls)
    with pytest.raises(SimulationError, match=r"needs the output q; add \[sensors.q\]"):
        PX4.check("px4", bare, wing.trim, wing.moved_controls, THROWS)
    sweeps = injection("quad-x", SWEEPS)
    flaps: Any = SimpleNamespace(deflections=lambda: {"flap": np.ones(3)}, input=())
    climb = DOUBLETS.replace('"yaw"', '"down"').replace("step = 0.4", "step = 1.5")

    def roll(**change: float) -> Injection:
        changed = sweeps.maneuver.input[0].model_copy(update=change)
        return replace(sweeps, maneuver=sweeps.maneuver.model_copy(update={"input": (changed,)}))

    for target, one, said in (
        (PX4, replace(wing, throws=near), "moves aileron 150 % of its throw; lower --amplitude"),
        (PILOT, replace(wing, beat=0.5, maneuver=flaps), "not flap; exclude it with --amplitude flap=0"),
        (CRAZYFLIE, injection("quad-x", climb), r"needs height_m .* sends 0.5 at most"),
        (ARDUPILOT, injection("quad-x", DOUBLETS), "add --shape sweep"),
        (ARDUPILOT, roll(duration=300.0), "SID_T_REC of roll would be 300, outside 0 to 255; shorten --duration"),
        (ARDUPILOT, roll(fade=7.0), "SID_T_FADE_OUT of roll would be 7, outside 0 to 5; shorten --duration"),
        (ARDUPILOT, roll(amplitude=500.0), "SID_MAGNITUDE of roll would be .*, outside 0 to 1; lower --amplitude"),
    ):  # fmt: skip
        with pytest.raises(SimulationError, match=said):
            target.write(one)
