"""Parameters of PX4 and ArduPilot: mixers, ranges, motors. Expected values are those of the autopilots' own tables."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.base.autopilots import ARDUPILOT
from stoop_draft.vehicle_draft.autopilot import Scale, read_setup

VTAIL_PX4 = {
    "CA_AIRFRAME": 1, "CA_ROTOR_COUNT": 1, "CA_ROTOR0_AX": 1.0, "CA_ROTOR0_AZ": 0.0, "CA_SV_CS_COUNT": 4,
    "CA_SV_CS0_TYPE": 1, "CA_SV_CS0_TRQ_R": -0.5, "CA_SV_CS0_TRQ_Y": 0.1,
    "CA_SV_CS1_TYPE": 2, "CA_SV_CS1_TRQ_R": 0.5,
    "CA_SV_CS2_TYPE": 7, "CA_SV_CS2_TRQ_P": 0.5, "CA_SV_CS2_TRQ_Y": 0.5,
    "CA_SV_CS3_TYPE": 8, "CA_SV_CS3_TRQ_P": 0.5, "CA_SV_CS3_TRQ_Y": -0.5,
    "PWM_MAIN_FUNC1": 101, "PWM_MAIN_MIN1": 1100, "PWM_MAIN_MAX1": 1900,
    "PWM_MAIN_FUNC3": 203, "PWM_MAIN_MIN3": 1000, "PWM_MAIN_MAX3": 2000,
    "PWM_MAIN_FUNC4": 204, "PWM_MAIN_MIN4": 1200, "PWM_MAIN_MAX4": 1800, "PWM_MAIN_REV": 0b1000,
}  # fmt: skip
ELEVONS_ARDUPILOT = {
    "SERVO1_FUNCTION": 77, "SERVO1_MIN": 1000, "SERVO1_MAX": 2000, "SERVO1_TRIM": 1480, "SERVO1_REVERSED": 1,
    "SERVO2_FUNCTION": 78, "SERVO2_MIN": 1100, "SERVO2_MAX": 1900, "SERVO2_TRIM": 1500, "SERVO2_REVERSED": 0,
    "SERVO3_FUNCTION": 70, "SERVO3_MIN": 1100, "SERVO3_MAX": 1900, "SERVO3_TRIM": 1100,
    "SERVO4_FUNCTION": 2, "FRAME_CLASS": 0,
}  # fmt: skip


def test_px4_surfaces() -> None:
    setup = read_setup(VTAIL_PX4)
    assert (setup.autopilot, setup.tail(), setup.rotors) == ("PX4", "v-tail", ())
    assert [one.shares for one in setup.surfaces] == [
        (-0.5, 0.0, 0.0), (0.5, 0.0, 0.0),  # the yaw that makes up for adverse yaw is no rudder
        (0.0, 0.5, 0.5), (0.0, 0.5, -0.5),  # left tail, its trailing edge up: nose up, nose right
    ]  # fmt: skip
    _, _, left_tail, right_tail = setup.surfaces
    assert left_tail.channels == {"servo_3": Scale(), "pwm_3": Scale(1500.0, 500.0)}
    assert right_tail.channels["pwm_4"] == Scale(1500.0, -300.0)  # reversed
    (motor,) = setup.pushers
    assert motor.channels == {"motor_1": Scale(), "pwm_1": Scale(1100.0, 800.0)}
    usual = read_setup({"CA_SV_CS_COUNT": 2, "CA_SV_CS0_TYPE": 5, "CA_SV_CS1_TYPE": 6})  # none are set
    assert [s.shares for s in usual.surfaces] == [(-0.5, 0.5, 0.0), (0.5, 0.5, 0.0)]
    assert usual.tail() == "flying-wing"
    both = {"PWM_AUX_FUNC1": 201, "PWM_MAIN_FUNC5": 201, "CA_SV_CS_COUNT": 1, "CA_SV_CS0_TYPE": 3}
    for pulse in ("pwm_5", "pwm_1"):  # of the group that moves
        assert pulse in read_setup(both, [pulse]).surfaces[0].channels


def test_px4_rotors() -> None:
    quad = {"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 4}
    places = ((0.15, 0.2, 0.05), (-0.15, -0.2, 0.05), (0.15, -0.2, -0.05), (-0.15, 0.2, -0.05))
    for i, place in enumerate(places):
        quad |= {f"CA_ROTOR{i}_{key}": x for key, x in zip(("PX", "PY", "KM"), place, strict=True)}
    rotors = read_setup(quad).rotors
    assert [r.position for r in rotors] == [(x, y, 0.0) for x, y, _ in places]
    assert [(r.spin, r.lifts) for r in rotors] == [("ccw", True)] * 2 + [("cw", True)] * 2


def test_ardupilot_elevons() -> None:
    setup = read_setup(ELEVONS_ARDUPILOT)
    left, right = setup.surfaces
    assert (setup.tail(), setup.others) == ("flying-wing", {"pwm_4": "flap"})
    assert (left.shares, left.channels) == ((-0.5, 0.5, 0.0), {"pwm_1": Scale(1480.0, -500.0)})
    assert right.channels == {"pwm_2": Scale(1500.0, 400.0)}
    assert setup.pushers[0].channels == {"pwm_3": Scale(1100.0, 800.0)}


def test_ardupilot_frames() -> None:
    """Rotors of a frame stand about its center, and as many turn each way; quadrotors by hand."""
    ranges = {f"SERVO{n}_FUNCTION": 32 + n for n in range(1, 5)} | {"MOT_PWM_MIN": 1050, "MOT_PWM_MAX": 1950}
    for frame, spins in ((1, ["ccw", "ccw", "cw", "cw"]), (3, ["cw", "cw", "ccw", "ccw"])):
        rotors = read_setup({**ranges, "FRAME_CLASS": 1, "FRAME_TYPE": frame}).rotors
        assert [r.spin for r in rotors] == spins
        signs = [tuple(math.copysign(1, x) for x in r.position[:2]) for r in rotors if r.position]
        assert (signs[0], signs[2]) == ((1, 1), (1, -1))
        assert rotors[0].channels["pwm_1"] == Scale(1050.0, 900.0)
    for frame, places in ARDUPILOT.frames.items():
        for part in (math.cos, math.sin):
            assert sum(part(math.radians(a)) for a, _ in places) == pytest.approx(0.0, abs=1e-9), frame
        assert sum(spin == "ccw" for _, spin in places) == len(places) / 2


MORE = ("CA_ROTOR0_PX", "CA_ROTOR0_KM", "MOT_PWM_MIN", "MOT_PWM_MAX", "Q_ENABLE")
NAMES = (*VTAIL_PX4, *ELEVONS_ARDUPILOT, *MORE)


@settings(max_examples=50)
@given(st.dictionaries(st.sampled_from(NAMES), st.floats(width=32) | st.integers(-(2**31), 2**31 - 1)))
def test_hostile_parameters(parameters: dict[str, Any]) -> None:
    setup = read_setup(parameters)
    scales = [s for one in (*setup.surfaces, *setup.rotors, *setup.pushers) for s in one.channels.values()]
    assert all(math.isfinite(s.zero) and math.isfinite(s.unit) and s.unit for s in scales)
    motors = [m for m in (*setup.rotors, *setup.pushers) if m.position]
    assert all(math.isfinite(x) for m in motors for x in (*m.position, *m.axis))
    assert all(math.isfinite(x) and abs(x) <= 10.0 for s in setup.surfaces for x in s.shares)
