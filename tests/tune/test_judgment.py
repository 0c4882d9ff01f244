"""How commands reach the surfaces of a vehicle, and what draws with unstable loops count as."""

import numpy as np
import pytest
from tune.made_up import SURFACES, TAIL, quad, rolling, v_tail, wing

from stoop.errors import StoopError
from stoop.flight import Flight, from_columns
from stoop.vehicle.document import with_entries
from stoop_analysis.draws import Draws
from stoop_studies.verify import scenes
from stoop_tune.control_laws import px4
from stoop_tune.control_laws.table import firmwares
from stoop_tune.gain_search import Design, Specification
from stoop_tune.judgment import Condition, commands_of, judge, with_handling, worst
from stoop_tune.loops import AxisLoop
from stoop_tune.tuning import conditions_of, pitot_readings

WING = {"FW_RR_P": 0.4, "FW_RR_I": 0.6, "FW_RR_FF": 0.0}


def test_outputs_of_a_v_tail_are_those_of_commands() -> None:
    """PX4 moves both tail surfaces fully up for a full pitch command, against each other for yaw; half a roll share a wing."""
    vehicle = v_tail(scenes.aircraft(), -0.4, 0.3, -0.4)
    by_outputs = commands_of(vehicle, firmwares(WING)[0], WING | TAIL)
    assert by_outputs.axes == ("roll", "pitch", "yaw")
    for row, control in zip(by_outputs.mixing, vehicle.controls, strict=False):
        axis, gain = SURFACES[control]
        np.testing.assert_allclose(row, [gain * (axis == other) for other in by_outputs.axes], atol=1e-12)
    same, parameters = commands_of(wing(), firmwares(WING)[0], WING), {"RLL_RATE_P": 0.1}
    np.testing.assert_allclose(by_outputs.mixing[:3], same.mixing[:3], atol=1e-12)
    for enabled, axes in (({}, ("roll", "pitch")), ({"YAW_RATE_ENABLE": 1.0}, ("roll", "pitch", "yaw"))):
        assert commands_of(wing(), firmwares(parameters)[0], parameters | enabled).axes == axes, "ArduPlane"


def test_motors_move_by_commands_or_by_pulses_of_their_range() -> None:
    """PX4 linearizes thrust behind `actuator_motors`, so that it counts for pulses alone; speeds of rotors are no command."""
    throttle = {"THR_MDL_FAC": 0.6, "MPC_THR_HOVER": 0.3}
    parameters = {"MC_ROLLRATE_P": 0.1, "PWM_MAIN_MIN1": 1100.0, "PWM_MAIN_MAX1": 1900.0} | throttle
    (firmware,) = firmwares(parameters)
    commands, pulses = (commands_of(quad(kind), firmware, parameters).mixing for kind in ("motor", "pwm"))
    assert np.abs(commands).max() == pytest.approx(1.0)
    np.testing.assert_allclose(pulses, 800.0 / np.sqrt(0.4**2 + 4.0 * 0.6 * 0.3) * commands)
    with pytest.raises(StoopError, match=r"turn by rotor_1; .* identify with the commands of the motors"):
        commands_of(quad("rotor"), firmware, parameters)


def test_thrust_of_betaflight_is_linearized_about_the_hover_of_the_altitude() -> None:
    """Commands and pulses that hover alike have one slope; where the air is thin motors hover nearer to their limit."""
    ends = {"motorOutput[0]": 158.0, "motorOutput[1]": 2047.0}
    parameters = {"pidsum_limit": 500.0, "thrust_linear": 40.0, **ends}
    (firmware,) = firmwares(parameters)

    def mixing(kind: str, altitude: float, **rotors: float) -> np.ndarray:
        return commands_of(quad(kind, **rotors), firmware, parameters, altitude).mixing

    commands, pulses = mixing("motor", 0.0), mixing("pwm", 0.0, gain=1e-3, idle=1000.0)
    np.testing.assert_allclose(pulses, 1000.0 * commands, rtol=1e-6)
    assert np.abs(mixing("motor", 2000.0) - commands).max() > 1e-3
    with pytest.raises(StoopError, match=r"turn by rotor_1; .* identify with the commands"):
        mixing("rotor", 0.0)


def test_a_draw_with_unstable_loops_has_no_margin() -> None:
    loops = {"roll": AxisLoop(px4.fixed_wing(WING, "roll"), 2.5)}
    (found,) = judge(Condition(20.0, 1.0, rolling([4.0, 4.0], servo=[1.0, -1.0])), loops, {})
    figures = found.figures()
    assert figures["gain margin"][1]["estimate"] > found.stable == 0.0
    for name in ("gain margin", "phase margin", "delay margin", "disk margin"):
        assert figures[name][1]["p5"] == pytest.approx(0.0)


def test_a_law_acts_on_what_gyros_read() -> None:
    """A gyro that reads 5 % high is a loop with 5 % more gain, in the margins as in flight; attitude is read as it is."""
    parameters = {f"MC_{a}RATE_{t}": 0.1 for a in ("ROLL", "PITCH", "YAW") for t in "PI"}
    parameters |= {"MC_ROLL_P": 0.0, "MC_PITCH_P": 0.0}
    none = Draws(("mass.mass",), np.empty((0, 1)), "covariance")
    (firmware,), found = firmwares(parameters), []
    for scale, gain in ((1.05, 1.0), (1.0, 1.05)):
        vehicle = with_entries(quad(), {("sensors", "p", "scale"): scale})
        rolling_on = dict.fromkeys(("MC_ROLLRATE_P", "MC_ROLLRATE_I"), gain * 0.1)
        values = parameters | rolling_on | {"MC_ROLLRATE_D": 0.0}
        conditions = conditions_of(vehicle, firmware, values, [0.0], 200.0, none)
        axes = commands_of(vehicle, firmware, values).axes
        found.append(Design(firmware, values, axes, conditions, Specification(), {}).judged(values)[0][0])
    for name in ("gain", "phase", "crossover", "rejection"):
        a, b = (getattr(one.margins, name)[0] for one in found)
        assert a == pytest.approx(b, rel=1e-9), name


def test_each_model_is_scaled_by_what_its_own_pitot_reads() -> None:
    rng, count = np.random.default_rng(0), 150
    damping, ratios = 4.0 * (1.0 + 0.1 * rng.standard_normal(count)), 1.0 + 0.1 * rng.standard_normal(count)
    law = px4.fixed_wing(WING | {"FW_RR_FF": 0.3}, "roll")

    def found(damping: np.ndarray, ratio: float | np.ndarray) -> dict[str, np.ndarray]:
        condition, loops = Condition(20.0, ratio, rolling(damping)), {"roll": AxisLoop(law, 2.5, ratio)}
        (one,) = with_handling(condition, loops, judge(condition, loops, {"roll": 1e-4}))
        return {name: x for name, (_, x) in one.values().items()}

    together = found(damping, ratios[:, None])
    for k in (0, 1, 99, 100, 149):
        alone = found(damping[[k]], float(ratios[k]))
        for name, values in together.items():
            assert values[k] == pytest.approx(alone[name][0], rel=1e-9), name


def test_an_airspeed_is_what_the_pitot_reads() -> None:
    """A pitot that reads 8 % high: the law is scaled by 37.8 m/s, the airplane flies at 35 m/s."""
    gains = {"FW_RR_P": 0.4, "FW_PR_P": 0.8, "FW_YR_P": 0.3, "FW_AIRSPD_TRIM": 35.0, "FW_AIRSPD_MAX": 50.0}
    throws = {"elevator": ("pitch", -0.35), "aileron": ("roll", 0.35), "rudder": ("yaw", -0.35)}
    entries = {("controls", s, "mix"): {f"control_{axis}": x} for s, (axis, x) in throws.items()}
    vehicle, none = (
        with_entries(scenes.aircraft(), entries),
        Draws(("mass.mass",), np.empty((0, 1)), "covariance"),
    )
    (firmware,) = firmwares(gains)
    (right,), (high,), (other,) = (
        conditions_of(vehicle, firmware, gains, [speed], 200.0, none, reading)
        for speed, reading in ((35.0, 1.0), (1.08 * 35.0, 1.08), (1.08 * 35.0, 1.0))
    )
    np.testing.assert_allclose(high.plants.A, right.plants.A, rtol=1e-12)
    np.testing.assert_allclose(high.ratio, other.ratio, rtol=1e-12)
    assert abs(other.plants.A - right.plants.A).max() > 0.01


HEADINGS = np.linspace(0.0, 1.5 * np.pi, 4001)  #: three quarters of a circle


def gliding(**columns: np.ndarray) -> Flight:
    """Return a flight at 20 m/s through a wind of 5 m/s from the west, turning, with columns over it."""
    motion = dict.fromkeys(("phi", "theta", "vd"), 0.0 * HEADINGS) | {"psi": HEADINGS}
    motion |= {"vn": 20.0 * np.cos(HEADINGS), "ve": 20.0 * np.sin(HEADINGS) + 5.0}
    return from_columns("glide", 0.02 * np.arange(len(HEADINGS)), motion | columns, source="dataset")


def test_the_reading_of_a_pitot_is_that_over_the_airspeed_of_the_model() -> None:
    """V was reconstructed by a wind that is 1 m/s off to the north; the fit found 0.9 m/s of it, its draws 0.5 and 1."""
    V = np.hypot(20.0 * np.cos(HEADINGS) + 1.0, 20.0 * np.sin(HEADINGS))
    flight = gliding(airspeed_pitot=1.08 * 20.0 + 0.0 * HEADINGS, V=V)
    vehicle = with_entries(scenes.aircraft(), {("sensors", "wind_error"): [0.9, 0.0, 0.0]})
    drawn = Draws(("sensors.wind_error.x",), np.array([[0.5], [1.0]]), "covariance")
    found = pitot_readings([flight], vehicle, drawn)
    assert found[2] == pytest.approx(1.08, abs=2e-3)
    speeds = 20.0 + np.array([0.1, 0.5, 0.0]) * np.mean(np.cos(HEADINGS))
    np.testing.assert_allclose(1.08 * 20.0 / found, speeds, rtol=2e-3)
    measured = with_entries(scenes.aircraft(), {("sensors", "V", "scale"): 0.95})
    drawn = Draws(("sensors.V.scale",), np.array([[0.93], [0.97]]), "covariance")
    for read, scales in ((gliding(V=19.0 + 0.0 * HEADINGS), [0.95, 0.93, 0.97]), (gliding(), [1.0])):
        np.testing.assert_allclose(pitot_readings([read], measured, drawn), scales)


def test_the_worst_airspeed_counts_with_the_5th_or_95th_of_its_draws() -> None:
    loops, judged = {"roll": AxisLoop(px4.fixed_wing(WING, "roll"), 2.5)}, []
    for slower in (1.0, 0.6):
        plants = rolling(np.full(22, 4.0), 30.0 * slower * np.linspace(0.8, 1.2, 22))
        judged += judge(Condition(20.0 * slower, 1.0, plants), loops, {"roll": 1e-4})
    for name, least, place in (("gain margin", min, 1), ("noise", max, 19)):
        expected = [float(np.sort(one.values()[name][1][1:])[place]) for one in judged]
        assert expected[0] != expected[1]
        assert worst(judged, "roll", name) == least(expected)
