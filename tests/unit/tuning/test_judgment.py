"""How commands reach the surfaces of a vehicle, and what draws with unstable loops count as."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.assessment.draws import Draws
from stoop.control_laws import px4
from stoop.control_laws.table import firmwares
from stoop.errors import StoopError
from stoop.tuning.gain_search import Design, Specification
from stoop.tuning.judgment import Condition, commands_of, judge
from stoop.tuning.loops import AxisLoop, Plants
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries
from stoop.workflow.tuning import conditions_of
from stoop_studies.verify import scenes

WING = {"FW_RR_P": 0.4, "FW_RR_I": 0.6, "FW_RR_FF": 0.0}
TAIL = {
    "CA_SV_CS_COUNT": 4.0,
    "CA_SV_CS0_TYPE": 1.0,
    "CA_SV_CS1_TYPE": 2.0,
    "CA_SV_CS2_TYPE": 7.0,
    "CA_SV_CS3_TYPE": 8.0,
}
SURFACES = {"elevator": "pitch", "aileron": "roll", "rudder": "yaw"}
SERVOS = {
    "elevator": {"servo_3": -0.2, "servo_4": -0.2}, "aileron": {"servo_1": -0.15, "servo_2": 0.15},
    "rudder": {"servo_3": -0.2, "servo_4": 0.2},
}  # fmt: skip


def test_outputs_of_a_v_tail_are_those_of_commands() -> None:
    """PX4 moves both tail surfaces fully up for a full pitch command, against each other for yaw; half a roll share a wing."""
    vehicle = with_entries(scenes.aircraft(), {("controls", c, "mix"): mix for c, mix in SERVOS.items()})
    by_outputs = commands_of(vehicle, firmwares(WING)[0], WING | TAIL)
    gains = {"elevator": ("pitch", -0.4), "aileron": ("roll", 0.3), "rudder": ("yaw", -0.4)}
    assert by_outputs.axes == ("roll", "pitch", "yaw")
    for row, control in zip(by_outputs.mixing, vehicle.controls, strict=False):
        axis, gain = gains[control]
        expected = [gain if axis == other else 0.0 for other in by_outputs.axes]
        np.testing.assert_allclose(row, expected, atol=1e-12)
    direct = {("controls", c, "mix"): {f"control_{axis}": gain} for c, (axis, gain) in gains.items()}
    same = commands_of(with_entries(scenes.aircraft(), direct), firmwares(WING)[0], WING)
    np.testing.assert_allclose(by_outputs.mixing[:3], same.mixing[:3], atol=1e-12)


def test_motors_move_by_commands_or_by_pulses_of_their_range() -> None:
    """PX4 linearizes thrust behind `actuator_motors`, so that it counts for pulses alone; speeds of rotors are no command."""
    parameters = {
        "MC_ROLLRATE_P": 0.1,
        "PWM_MAIN_MIN1": 1100.0,
        "PWM_MAIN_MAX1": 1900.0,
        "THR_MDL_FAC": 0.6,
        "MPC_THR_HOVER": 0.3,
    }
    quad, firmware = builtin_vehicle("quad-x"), firmwares(parameters)[0]

    def moved_by(kind: str) -> Vehicle:
        names = enumerate(quad.file.rotor, 1)
        return with_entries(quad, {("rotor", name, "channel"): f"{kind}_{i}" for i, name in names})

    commands, pulses = (commands_of(moved_by(kind), firmware, parameters).mixing for kind in ("motor", "pwm"))
    assert np.abs(commands).max() == pytest.approx(1.0)
    np.testing.assert_allclose(pulses, 800.0 / np.sqrt(0.4**2 + 4.0 * 0.6 * 0.3) * commands)
    with pytest.raises(StoopError, match=r"turn by rotor_1; .* identify with the commands of the motors"):
        commands_of(moved_by("rotor"), firmware, parameters)


def test_yaw_of_arduplane_is_a_loop_where_it_is_enabled() -> None:
    direct = {("controls", c, "mix"): {f"control_{a}": 0.3} for c, a in SURFACES.items()}
    vehicle, parameters = with_entries(scenes.aircraft(), direct), {"RLL_RATE_P": 0.1}
    (firmware,) = firmwares(parameters)
    assert commands_of(vehicle, firmware, parameters).axes == ("roll", "pitch")
    enabled = parameters | {"YAW_RATE_ENABLE": 1.0}
    assert commands_of(vehicle, firmware, enabled).axes == ("roll", "pitch", "yaw")


def test_a_draw_with_unstable_loops_has_no_margin() -> None:
    """The second lane turns the other way."""
    A = np.array([[[-4.0, 30.0, 0.0], [0.0, -15.0, 0.0], [1.0, 0.0, 0.0]]] * 2)
    B = np.array([[[0.0], [15.0], [0.0]], [[0.0], [-15.0], [0.0]]])
    plants = Plants(("p", "aileron.lag", "phi"), A, B, np.zeros((2, 1)))
    loops = {"roll": AxisLoop(px4.fixed_wing(WING, "roll"), 2.5)}
    found = judge(Condition(20.0, 1.0, plants), loops, {})[0]
    assert found.stable == 0.0
    figures = found.figures()
    assert figures["gain margin"][1]["estimate"] > 0.0
    for name in ("gain margin", "phase margin", "delay margin", "disk margin"):
        assert figures[name][1]["p5"] == pytest.approx(0.0)


def test_a_law_acts_on_what_gyros_read() -> None:
    """A gyro that reads 5 % high is a loop with 5 % more gain, in the margins as in flight; attitude is read as it is."""
    parameters = {f"MC_{a}RATE_{t}": 0.1 for a in ("ROLL", "PITCH", "YAW") for t in "PI"} | {
        "MC_ROLL_P": 0.0,
        "MC_PITCH_P": 0.0,
    }
    quad, none = builtin_vehicle("quad-x"), Draws(("mass.mass",), np.empty((0, 1)), "covariance")
    channels = {("rotor", name, "channel"): f"motor_{i}" for i, name in enumerate(quad.file.rotor, 1)}
    (firmware,), found = firmwares(parameters), []
    for scale, gain in ((1.05, 1.0), (1.0, 1.05)):
        vehicle = with_entries(quad, channels | {("sensors", "p", "scale"): scale})
        values = parameters | {n: gain * parameters[n] for n in ("MC_ROLLRATE_P", "MC_ROLLRATE_I")}
        values |= {"MC_ROLLRATE_D": 0.0}
        conditions = conditions_of(vehicle, firmware, values, [0.0], 200.0, none)
        axes = commands_of(vehicle, firmware, values).axes
        found.append(Design(firmware, values, axes, conditions, Specification(), {}).judged(values)[0][0])
    for name in ("gain", "phase", "crossover", "rejection"):
        a, b = (getattr(one.margins, name)[0] for one in found)
        assert a == pytest.approx(b, rel=1e-9), name
