"""Flights under the law of an autopilot: where loops begin to swing, wind, turns, limits, and what is refused."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from tune.made_up import quad, wing

from stoop import simulate
from stoop.base.files import write_files
from stoop.base.rotations import quaternions_of
from stoop.base.units import STANDARD_GRAVITY
from stoop.errors import ManeuverError, SimulationError, StoopError
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop_analysis.draws import Draws
from stoop_export import jsbsim_aircraft
from stoop_export.jsbsim_flight import Host, Record, begin, file_name
from stoop_tune.closed_loop import AttitudeLoop, Course, FlownUnderLaw, centered_means, fly_under_law
from stoop_tune.control_laws.recursion import LawRecursion
from stoop_tune.control_laws.table import firmware_of
from stoop_tune.gain_search import Design, Specification
from stoop_tune.judgment import commands_of
from stoop_tune.tuning import conditions_of

Parameters = Mapping[str, float]
WING = {"FW_RR_P": 0.4, "FW_RR_I": 0.3, "FW_RR_FF": 0.3, "FW_PR_P": 0.8, "FW_PR_I": 0.6, "FW_PR_FF": 1.0, "FW_YR_P": 0.3,
        "FW_AIRSPD_TRIM": 33.0, "FW_AIRSPD_MAX": 60.0, "FW_AIRSPD_STALL": 15.0}  # fmt: skip
PX4 = {**{f"MC_{a}RATE_{t}": g for a in ("ROLL", "PITCH") for t, g in (("P", 0.15), ("I", 0.2), ("D", 0.003))},
       "MC_YAWRATE_P": 0.2, "MC_YAWRATE_I": 0.1, "MC_ROLL_P": 6.0, "MC_PITCH_P": 6.0}  # fmt: skip
COPTER = {**{f"ATC_RAT_{a}_{t}": g for a in ("RLL", "PIT") for t, g in (("P", 0.135), ("I", 0.135), ("D", 0.0036))},
          "ATC_RAT_YAW_P": 0.2, "ATC_RAT_YAW_I": 0.02, "INS_GYRO_FILTER": 40.0}  # fmt: skip
PLANE = {**{f"{a}_RATE_{t}": g for a in ("RLL", "PTCH") for t, g in (("P", 0.15), ("I", 0.15), ("FF", 0.3))},
         "SCALING_SPEED": 33.0, "AIRSPEED_MIN": 15.0, "AIRSPEED_MAX": 60.0}  # fmt: skip
BETAFLIGHT = {"looptime": 1000.0, "pid_process_denom": 2.0, "pidsum_limit": 500.0, "motorOutput[0]": 158.0,
              "motorOutput[1]": 2047.0, "thrust_linear": 20.0, "dterm_lpf1_static_hz": 75.0, "gyro_lpf2_static_hz": 250.0,
              "levelPID[0]": 50.0, "dterm_lpf2_static_hz": 0.0, "gyro_lpf1_static_hz": 0.0,
              **{f"{a}PID[{k}]": g for a in ("roll", "pitch") for k, g in enumerate((45.0, 40.0, 30.0))},
              **{f"yawPID[{k}]": g for k, g in enumerate((45.0, 15.0, 0.0))}}  # fmt: skip
CRAZYFLIE = {**{f"pid_rate.{a}_k{t}": g for a in ("roll", "pitch") for t, g in (("p", 250.0), ("i", 500.0), ("d", 2.5))},
             "pid_rate.yaw_kp": 120.0, "pid_rate.yaw_ki": 16.7, "pid_attitude.roll_kp": 3.0,
             "pid_attitude.pitch_kp": 3.0}  # fmt: skip


def course(duration: float, *inputs: tuple[str, float, float, float], **more: float) -> Maneuver:
    """Return pulses of a control: its start, its duration, s, and its amplitude."""
    keys = ("control", "start", "duration", "amplitude")
    pulses = [dict(zip(keys, one, strict=True)) | {"shape": "pulse"} for one in inputs]
    return Maneuver.model_validate({"duration": duration, "rate": 100.0, "input": pulses} | more)


def flown(vehicle: Vehicle, maneuver: Maneuver, parameters: Parameters) -> FlownUnderLaw:
    return fly_under_law(vehicle, maneuver, firmware_of(parameters, bool(vehicle.rotors)), parameters)


def check_gain_margin(vehicle: Vehicle, parameters: Parameters, gains: list[str], airspeed: float) -> None:
    """Margins come from frequency responses; the flight knows none of them."""
    firmware = firmware_of(parameters, bool(vehicle.rotors))
    none = Draws(("mass.mass",), np.empty((0, 1)), "covariance")
    conditions = conditions_of(vehicle, firmware, parameters, [airspeed], 200.0, none)
    axes = commands_of(vehicle, firmware, parameters).axes
    roll = Design(firmware, parameters, axes, conditions, Specification(), {}).judged(parameters)[0][0]
    more = {"airspeed": airspeed} if airspeed else {}
    margin, maneuver = float(roll.margins.gain[0]), course(8.0, ("phi", 0.1, 0.2, 1e-4), **more)
    assert margin > 2.0
    grown = []
    for share in (0.96, 1.04):
        raised = {**parameters, **{n: share * margin * parameters.get(n, 0.0) for n in gains}}
        found = flown(vehicle, maneuver, raised)
        p = found.outputs[:, vehicle.outputs.index("p")]
        early, late = (np.std(p[(found.time > t) & (found.time < t + 1.0)]) for t in (3.0, 6.5))
        grown.append(late / early)
    assert grown[0] < 0.7 < 1.5 < grown[1]


def test_a_loop_begins_to_swing_at_its_gain_margin() -> None:
    check_gain_margin(quad(delay=0.013), PX4, [f"MC_ROLLRATE_{t}" for t in "PID"], 0.0)


OTHERS = {
    "copter": (partial(quad, delay=0.021), COPTER, [f"ATC_RAT_RLL_{t}" for t in "PID"], 0.0),
    "plane": (partial(wing, lag=0.05, delay=0.033), PLANE, ["RLL_RATE_P", "RLL_RATE_I", "RLL_RATE_FF"], 33.0),
    "betaflight": (partial(quad, delay=0.005, lag=0.025), BETAFLIGHT, [f"rollPID[{k}]" for k in range(3)], 0.0),
    "crazyflie": (partial(quad, delay=0.005, lag=0.025), CRAZYFLIE, [f"pid_rate.roll_k{t}" for t in "pid"], 0.0),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_loops_of_other_autopilots_begin_to_swing_at_theirs(name: str) -> None:
    vehicle, *rest = OTHERS[name]
    check_gain_margin(vehicle(), *rest)


@pytest.mark.parametrize(("name", "held"), [("betaflight", 2), ("crazyflie", 3)])
def test_angles_are_held_by_laws_of_each(name: str, held: int) -> None:
    maneuver = course(4.0, ("phi", 0.5, 1.5, 0.2), ("psi", 0.5, 1.5, 0.05))
    vehicle, parameters, *_ = OTHERS[name]
    found = flown(vehicle(), maneuver, parameters)
    during = int(np.argmin(np.abs(found.time - 1.9)))
    assert np.abs(found.attitude_error[during, :held]).max() < 0.04
    assert np.abs(found.attitude_error[-1, :held]).max() < 0.03


def test_a_step_of_the_wind_leaves_the_velocity_over_ground() -> None:
    found = flown(wing(), course(6.0, ("wind_e", 2.0, 2.0, 5.0)), WING)
    at = int(np.argmin(np.abs(found.time - 2.0)))
    speed, beta = (found.outputs[:, wing().outputs.index(n)] for n in ("V", "beta"))
    np.testing.assert_allclose(found.velocity[at], found.velocity[at - 1], atol=1e-3)
    assert beta[at] == pytest.approx(-np.arctan2(5.0, speed[at - 1]), abs=0.02)
    assert abs(beta[-1]) < 0.02
    assert np.abs(found.attitude_error[-1, :2]).max() < 0.05


def test_the_height_of_a_ground_effect_follows_the_flight() -> None:
    table = {("ground_effect",): {"channel": "height", "rotor": 1.0, "radius": 0.12}}
    vehicle = with_entries(quad(delay=0.013), table)
    found = flown(vehicle, course(3.0, ("phi", 0.5, 2.0, 0.3), altitude=1.0), PX4)
    height = found.inputs[:, vehicle.inputs.index("height")]
    altitude = found.states[:, vehicle.states.index("h")]
    assert np.ptp(altitude) > 0.05
    np.testing.assert_allclose(np.diff(height)[1:-1], np.diff(altitude)[1:-1], atol=0.02 * np.ptp(altitude))


def test_a_turn_is_coordinated() -> None:
    found = flown(vehicle := wing(), course(12.0, ("phi", 1.0, 20.0, 0.35)), WING)
    late = found.time > 10.0
    phi, beta, speed = (found.outputs[late, vehicle.outputs.index(n)].mean() for n in ("phi", "beta", "V"))
    heading = np.unwrap(found.outputs[late, vehicle.outputs.index("psi")])
    turned = (heading[-1] - heading[0]) / np.ptp(found.time[late])
    assert phi == pytest.approx(0.35, abs=0.01)
    assert turned == pytest.approx(STANDARD_GRAVITY * np.tan(phi) / speed, rel=0.03)
    assert abs(beta) < 0.02


def test_a_vehicle_recovers_from_motors_at_their_ends() -> None:
    found = flown(quad(delay=0.013), course(6.0, ("phi", 1.0, 1.5, 0.7), ("psi", 1.0, 1.5, 1.0)), PX4)
    assert found.saturated.any()
    assert found.clipped.any()
    assert np.abs(found.attitude_error[-1]).max() < 0.05


def test_gusts_move_what_calm_air_leaves() -> None:
    table = {("turbulence", axis): {"intensity": 1.0, "length": 100.0} for axis in "uvw"}
    calm, rough = wing(), with_entries(wing(), table)
    still, moved = (flown(v, course(8.0), WING) for v in (calm, rough))
    assert np.ptp(still.attitude_error[:, :2]) < 5e-4
    assert 1e-3 < np.std(moved.attitude_error[:, 0]) < 0.2
    intensity = np.std(moved.outputs[:, rough.outputs.index("beta")]) * 35.0
    assert 0.2 < intensity < 3.0


def test_recorded_channels_repeat_the_flight() -> None:
    """Open loop from the same start, by straight lines between the samples of 50 Hz that are recorded of 400 Hz."""
    vehicle = wing(lag=0.05, delay=0.03)
    pulses = ("phi", 1.0, 2.0, 0.3), ("control_pitch", 2.0, 0.5, 0.2)
    found = flown(vehicle, course(4.0, *pulses, rate=50.0), WING)
    inputs = {"time": found.time} | {c: found.inputs[:, vehicle.inputs.index(c)] for c in vehicle.recorded}
    again = simulate(vehicle, inputs)
    for name in ("p", "q", "r", "phi", "theta"):
        own = found.outputs[:, vehicle.outputs.index(name)]
        assert np.sqrt(np.mean((again.column(name) - own) ** 2)) < 0.01 * np.ptp(own), name


def test_means_of_held_channels_are_centered() -> None:
    held = np.array([[0.0], [0.0], [4.0], [4.0], [4.0], [8.0]])
    np.testing.assert_allclose(centered_means(held, 2)[:, 0], [0.0, 2.0, 4.0])
    np.testing.assert_allclose(centered_means(held, 3)[:, 0], [0.0, 10.0 / 3.0])
    np.testing.assert_allclose(centered_means(held, 1)[1:3, 0], [0.0, 2.0])


def test_a_flight_is_recorded_and_says_how_it_was_held() -> None:
    bank = course(1.0, ("phi", 0.2, 5.0, 0.1))
    flight, again = (simulate(wing(), bank, autopilot=WING, noise=True, seed=3) for _ in range(2))
    assert flight.rate == pytest.approx(100.0)
    assert {"control_roll", "p", "phi", "vn"} <= flight.names
    assert ["PX4 fixed wing" in str(n) for n in flight.notices if n.code == "flown-under-law"] == [True]
    np.testing.assert_array_equal(flight.column("p"), again.column("p"))


def test_what_no_law_flies_is_refused() -> None:
    reversed_aileron = with_entries(wing(), {("controls", "aileron", "mix"): {"control_roll": -0.3}})
    still, tilt, lost = course(1.0), course(20.0, ("phi", 0.1, 0.2, 0.1)), PX4 | {"MC_PITCH_P": 0.0}
    for vehicle, maneuver, parameters, error, said in (
        (quad(), still, WING, StoopError, "those of PX4 fixed wing, but the vehicle flies on rotors"),
        (quad(), still, lost, StoopError, "its attitude loop has no gain, and rates alone hold no attitude"),
        (wing(), course(1.0, ("psi", 0.1, 0.2, 0.1)), WING, ManeuverError, "moves 'psi', but under a law it may move phi"),
        (wing(), {"time": np.arange(5) * 0.1}, WING, ManeuverError, "its law flies a maneuver"),
        (reversed_aileron, tilt, WING, SimulationError, r"the attitude is lost at .* s: .* lower gains"),
        (wing(), course(0.01), PLANE, ManeuverError, r"at 50 Hz, the rate of the loop: .*shorter than one sample"),
        (wing(), still, {**WING, "FW_AIRSPD_MAX": 0.0}, StoopError, "FW_AIRSPD_MAX = 0"),
        (wing().reduced("longitudinal"), still, WING, StoopError, "an autopilot flies about all axes"),
    ):  # fmt: skip
        with pytest.raises(error, match=said):
            simulate(vehicle, maneuver, autopilot=parameters)
    with pytest.raises(ManeuverError, match="has its own time and steady flight"):
        simulate(wing(), still, autopilot=WING, airspeed=30.0)


def test_jsbsim_flies_the_same_under_the_law(tmp_path: Path) -> None:
    vehicle, firmware, pitch = wing(lag=0.04), firmware_of(WING, rotors=False), ("theta", 2.0, 2.0, 0.08)
    maneuver = course(8.0, ("phi", 1.0, 5.0, 0.4), pitch, ("theta", 4.0, 2.0, -0.08), rate=400.0)
    ours = fly_under_law(vehicle, maneuver, firmware, WING)

    given, moved = Course.of(vehicle, maneuver), commands_of(vehicle, firmware, WING)
    write_files(tmp_path, jsbsim_aircraft.folder(vehicle, None))
    record = Record(vehicle, given.point.start, given.time, given.inputs)
    simulation = begin(tmp_path, file_name(vehicle.name), record, None, Host(2000.0))
    loop = AttitudeLoop(firmware, WING, moved.axes, given)
    law = LawRecursion([firmware.law(WING, a) for a in moved.axes], np.zeros((3, 1)))
    rows, done = [], np.zeros((3, 1))
    for k in range(len(given.time)):
        rows.append(s := simulation.read())
        attitude = quaternions_of(np.array([s["phi"], s["theta"], s["psi"]]))
        speed = float(np.linalg.norm([s["u"], s["v"], s["w"]]))
        setpoints, _ = loop.setpoints(k, attitude, speed)
        done = law.commands(setpoints, np.array([[s["p"]], [s["q"]], [s["r"]]]), loop.scale(speed), done)
        simulation.advance(*[given.inputs[k] + moved.outputs @ done[:, 0]] * 2)
    for name in ("p", "q", "r", "phi", "theta"):
        theirs = np.array([row[name] for row in rows])
        own = ours.outputs[:, vehicle.outputs.index(name)]
        assert np.ptp(theirs) > 0.05, name
        assert np.sqrt(np.mean((own - theirs) ** 2)) < 1e-3 * np.ptp(theirs), name
