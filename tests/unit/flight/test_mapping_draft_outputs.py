"""What a drafted mapping makes of pulses: motors of a copter, surfaces of a plane."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from unit.flown import maneuver

from stoop.base.arrays import FloatArray
from stoop.flight.mapping_draft import Outputs, draft_of
from stoop.logs import Recording, Stream
from stoop.simulation.fly import simulate_flight
from stoop.vehicle.builtin import resolve_vehicle

FLOWN = maneuver(20.0, ("roll", "doublet", 3, 0.2, 8), ("pitch", "doublet", 9, 0.2, 8), rate=100.0)
QUAD = {f"SERVO{n}_FUNCTION": 32.0 + motor for n, motor in enumerate((3, 1, 4, 2), 1)}


def logged(pulses: dict[str, FloatArray], parameters: dict[str, float], **imu: FloatArray) -> Recording:
    t = 0.01 * np.arange(len(next(iter(pulses.values()))))
    streams = {"RCOU": Stream(t, pulses)} | ({"IMU": Stream(t, imu)} if imu else {})
    return Recording(Path("f.bin"), "dataflash", streams, parameters=parameters)


def waves(count: int) -> dict[str, FloatArray]:
    t = 0.01 * np.arange(3000)
    return {f"C{n}": 1500.0 + 100.0 * np.sin((1.0 + n) * t) for n in range(1, count + 1)}


def test_parameters_say_which_output_is_which_motor() -> None:
    made = draft_of(logged(waves(4), {**QUAD, "MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1940.0}))
    found = tomllib.loads(made.text)["variables"]
    order = {"motor_3": "C1", "motor_1": "C2", "motor_4": "C3", "motor_2": "C4"}
    assert {name: line["column"] for name, line in found.items()} == order
    for line in found.values():
        assert 1100.0 * line["scale"] + line["offset"] == pytest.approx(0.0, abs=1e-7)
        assert 1940.0 * line["scale"] + line["offset"] == pytest.approx(1.0)
    assert "by MOT_PWM_MIN and MOT_PWM_MAX" in made.text
    assert "surface" not in made.text
    assert made.unsure == 0
    ends = {"MOT_PWM_MIN": 0.0, "SERVO2_MIN": 1200.0, "SERVO2_MAX": 1800.0}
    unsure = draft_of(logged(waves(4), {**QUAD, **ends}))
    assert "# unsure: 0 at 1200 us, 1 at 1800 us, by SERVO2_MIN and SERVO2_MAX" in unsure.text
    assert unsure.text.count("# unsure: 0 at 1000 us, 1 at 2000 us, as is usual: write your own") == 3
    assert unsure.unsure == 4


def test_parameters_say_which_surface_an_output_moves() -> None:
    use = {"SERVO1_FUNCTION": 4.0, "SERVO2_FUNCTION": 19.0, "SERVO3_FUNCTION": 70.0, "SERVO4_FUNCTION": 19.0}
    ends = {"SERVO2_MIN": 1000.0, "SERVO2_TRIM": 1401.0, "SERVO2_MAX": 2000.0}
    text = draft_of(logged(waves(4), {**use, **ends})).text
    assert "# [surface.aileron]\n# from = {pwm_1 = 1.0}" in text
    assert "# [surface.elevator]\n# from = {pwm_2 = 0.5, pwm_4 = 0.5}" in text
    assert "# points = [[1000, -0.4], [1401, 0.0], [2000, 0.4]]" in text
    assert "pwm_3 =" not in text
    assert "variables" not in tomllib.loads(text)


def test_a_quadplane_has_motors_and_surfaces() -> None:
    motors = {f"SERVO{n}_FUNCTION": 28.0 + n for n in (5, 6, 7, 8)}
    use = {"SERVO1_FUNCTION": 4.0, **motors, "Q_M_PWM_MIN": 1000.0, "Q_M_PWM_MAX": 2000.0}
    text = draft_of(logged(waves(8), use)).text
    assert sorted(tomllib.loads(text)["variables"]) == [f"motor_{n}" for n in (1, 2, 3, 4)]
    assert "# from = {pwm_1 = 1.0}" in text
    assert "pwm_5 =" not in text


def test_pulses_that_turn_the_vehicle_are_motors_without_any_parameter() -> None:
    flown = simulate_flight(resolve_vehicle("hexa-x"), FLOWN, seed=2, name="f")
    pulses = {f"C{n}": np.round(1000.0 + 1000.0 * flown.column(f"motor_{n}")) for n in range(1, 7)}
    rates = {f"Gyr{axis}": flown.column(rate) for axis, rate in zip("XYZ", "pqr", strict=True)}
    force = {f"Acc{axis}": flown.column(f"a{axis.lower()}") for axis in "XYZ"}
    made = draft_of(logged(pulses, {}, **rates, **force))
    assert list(tomllib.loads(made.text)["variables"]) == [f"motor_{n}" for n in range(1, 7)]
    assert made.text.count("# unsure: a motor by what it turns, check its number") == made.unsure == 6
    assert "surface" not in made.text


@pytest.mark.parametrize("strange", [float("nan"), float("inf"), -1e300, 33.5])
def test_strange_parameters_tell_nothing(strange: float) -> None:
    names = ("FUNCTION", "MIN", "TRIM", "MAX")
    told = {f"SERVO{n}_{name}": strange for n in range(1, 5) for name in names}
    assert draft_of(logged(waves(4), told)).text == draft_of(logged(waves(4), {})).text


def test_motors_that_have_no_line_of_their_own_are_named_to_the_vehicle_file() -> None:
    flown = simulate_flight(resolve_vehicle("quad-x"), FLOWN, seed=2, name="f")
    signals = {f"pwm_{n}": (flown.time, 1000.0 + 1000.0 * flown.column(f"motor_{n}")) for n in range(1, 5)}
    rates = {rate: (flown.time, flown.column(rate)) for rate in "pq"}
    outputs = Outputs(tuple(signals), {}, {**signals, **rates}, {})
    assert outputs.motor_lines() == []
    text = "\n".join(outputs.surface_lines())
    assert "pwm_1 pwm_2 pwm_3 pwm_4 turn the vehicle against one another" in text
    assert "surface" not in text
