"""Drafted mappings: a flight written with other names, units and signs comes back; pulses are motors or surfaces."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from helpers.command_line import Done
from helpers.flown import maneuver
from helpers.made_logs import body_rates, csv_log
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.base.arrays import FloatArray
from stoop.base.units import FACTORS
from stoop.cli.main import main
from stoop.flight import VARIABLES, load_flight
from stoop.logs import Recording, Stream
from stoop.simulation.fly import simulate_flight
from stoop.vehicle.builtin import load_vehicle
from stoop_draft.column_guesses import recognized
from stoop_draft.mapping_draft import Draft, Outputs, draft, draft_of

T = 0.01 * np.arange(4000)
DEG, G = 180.0 / np.pi, 1.0 / 9.80665
DIALECTS = {
    "degrees and g, z up": {
        "roll": ("phi", DEG), "pitch": ("theta", DEG), "yaw": ("psi", DEG), "roll_rate": ("p", DEG), "GyrY": ("q", DEG),
        "gyro_z": ("r", DEG), "acc_x": ("ax", G), "acc_y": ("ay", G), "acc_z": ("az", -G), "climb": ("vd", -1.0),
        "Alt": ("altitude", 1.0), "battery_mv": ("voltage", 1e3), "elev_deg": ("elevator", DEG),
    },
    "degrees with rates in radians": {
        "Roll": ("phi", DEG), "Pitch": ("theta", DEG), "Heading": ("psi", DEG), "p": ("p", 1.0), "q": ("q", 1.0), "r": ("r", 1.0),
        "linear_acceleration.x": ("ax", 1.0), "linear_acceleration.y": ("ay", 1.0), "linear_acceleration.z": ("az", 1.0),
        "vd": ("vd", -1.0), "altitude (ft)": ("altitude", 1.0 / 0.3048), "Vbat": ("voltage", 1.0), "de": ("elevator", DEG),
    },
    "a rate that counts the other way": {
        "phi_rad": ("phi", 1.0), "theta_rad": ("theta", 1.0), "psi_rad": ("psi", 1.0), "p_dps": ("p", DEG), "q_dps": ("q", DEG),
        "r_dps": ("r", -DEG), "az": ("az", 1.0), "h": ("altitude", 1.0), "vbatt [mV]": ("voltage", 1e3),
        "elevator": ("elevator", 1.0),
    },
}  # fmt: skip
#: columns as others write them: JSBSim's properties and labels, X-Plane, Garmin's engine monitor, EuRoC, FlightGear,
#: Crazyflie, motion capture -> variable, unit, and sign
FOREIGN = {
    "elev_cmd_deg": ("elevator", "deg", 1), "ail_cmd_deg": ("aileron", "deg", 1), "rud_cmd_deg": ("rudder", "deg", 1),
    "gps_vn_kt": ("vn", "kt", 1), "gps_climb_fpm": ("vd", "ft/min", -1), "rpm": ("rotor_1", "", 1),
    "z_n": ("pd", "", 1), "velocities/p-rad_sec": ("p", "rad/s", 1), "aero/alpha-deg": ("alpha", "deg", 1),
    "fcs/elevator-pos-rad": ("elevator", "rad", 1), "velocities/v-down-fps": ("vd", "ft/s", 1),
    "position/h-sl-ft": ("altitude", "ft", 1), "velocities/vtrue-kts": ("V", "kt", 1),
    "V_{North} (ft/s)": ("vn", "ft/s", 1), "Left Aileron Position (deg)": ("aileron", "deg", 1),
    "Altitude ASL (ft)": ("altitude", "ft", 1), "pitch,__deg": ("theta", "deg", 1), "VVI,__fpm": ("vd", "ft/min", -1),
    "Q,rad/s": ("q", "rad/s", 1), "elev1,__deg": ("elevator", "deg", 1), "E1 RPM": ("rotor_1", "rpm", 1),
    "NormAc": ("az", "", -1), "VSpd": ("vd", "", -1), "hding,_true": ("psi", "", 1),
    "w_RS_S_x [rad s^-1]": ("p", "rad/s", 1), "a_RS_S_z [m s^-2]": ("az", "m/s2", 1), "q_RS_w []": ("q0", "", 1),
    "p_RS_R_x [m]": ("pn", "m", 1), "/surface-positions/elevator-pos-norm": ("elevator", "1", 1),
    "/orientation/roll-deg": ("phi", "deg", 1), "stateEstimate.x": ("pn", "", 1), "baro.asl": ("altitude", "", 1),
    "ElevatorDeg": ("elevator", "deg", 1), "ThrottlePct": ("throttle", "percent", 1), "LonAc": ("ax", "", 1),
    "Longitudinal Acceleration [g]": ("ax", "g", 1), "Vertical Acceleration [g]": ("az", "g", -1),
    "ctrl.thrust": ("control_throttle", "", 1), "elev_us": ("elevator", "", 1),
    "rpm.m1": ("rotor_1", "", 1), "MotorPct2": ("motor_2", "percent", 1),
    "tx": ("pn", "", 1), "imu_p": ("p", "", 1), "alpha_vane_deg": ("alpha", "deg", 1),
}  # fmt: skip
NAMES = {
    "p": "p roll_rate_dps GyrX gyro[0] angular_velocity.x rollspeed w_x omega_b[0] omega[0]",
    "az": "az AccZ accel[2] accelerometer_m_s2[2] imu.linear_acceleration.z acc_z",
    "q0": "q0 qw q[0] orientation.w quat_w", "phi": "phi roll bank_angle roll_deg att[0] eul[0]",
    "ax": "a_b[0]", "ve": "v_n[1] vel_ned[1]",
    "psi": "psi yaw heading",
    "V": "V vt TAS", "airspeed_pitot": "airspeed ARSPD", "airspeed_equivalent": "IAS EAS calibrated_airspeed",
    "rotor_3": "rpm3 esc[2].rpm motor3_rpm RPM[2] Omega3 w3",
    "motor_2": "motor2 motor.m2 motors[1] esc2_us", "pwm_4": "pwm_4 C4 ch4 output[3]", "voltage": "vbat battery_voltage Volt",
    "control_roll": "ControlRoll ctrl_roll roll_control roll_cmd cmd_roll", "control_pitch": "control.pitch u_pitch",
    "control_yaw": "yaw_command control_yaw", "control_throttle": "throttle_cmd control_throttle_pct thr_control",
    "": "DesRoll roll_setpoint lat FrameNumber status xyz[0] p1 checksum",
}  # fmt: skip

FLOWN = maneuver(20.0, ("roll", "doublet", 3, 0.2, 8), ("pitch", "doublet", 9, 0.2, 8), rate=100.0)
QUAD = {f"SERVO{n}_FUNCTION": 32.0 + motor for n, motor in enumerate((3, 1, 4, 2), 1)}


def flown() -> dict[str, FloatArray]:
    phi, theta, psi = 0.5 * np.sin(1.7 * T), 0.3 * np.sin(2.3 * T), 0.8 * np.sin(0.7 * T)
    p, q, r = body_rates(phi, theta, *(np.gradient(x, T) for x in (phi, theta, psi)))
    height = 100.0 + 10.0 * np.sin(0.3 * T)
    return {
        "phi": phi, "theta": theta, "psi": psi, "p": p, "q": q, "r": r,
        "ax": 9.80665 * np.sin(theta), "ay": -9.80665 * np.sin(phi), "az": -9.80665 * np.cos(phi) * np.cos(theta),
        "vd": -np.gradient(height, T), "altitude": height, "voltage": 15.0 - 0.01 * T,
        "elevator": 0.2 * np.sin(3.0 * T),
    }  # fmt: skip


def drafted(folder: Path, columns: dict[str, FloatArray], clock: str = "t_ms", second: float = 1e3) -> Draft:
    return draft(csv_log(folder / "log.csv", {clock: T * second, **columns}))


def lines_of(made: Draft) -> dict[str, dict[str, object]]:
    return tomllib.loads(made.text)["variables"]  # type: ignore[no-any-return]


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_flight_comes_back_from_any_dialect(tmp_path: Path, dialect: str) -> None:
    truth, names = flown(), DIALECTS[dialect]
    made = drafted(tmp_path, {column: factor * truth[v] for column, (v, factor) in names.items()})
    (tmp_path / "log.csv.toml").write_text(made.text)
    flight = load_flight(tmp_path / "log.csv")
    assert flight.time[-1] == pytest.approx(T[-1])
    for variable, _ in names.values():
        np.testing.assert_allclose(flight.column(variable), truth[variable], atol=2e-6, err_msg=variable)


def test_clocks_are_told_by_name_or_steps_and_what_is_unsure_is_marked(tmp_path: Path) -> None:
    p = flown()["p"]
    for clock, per_second, unit in (
        ("Systime", 1.0, "s"), ("frame clock", 1e3, "ms"), ("timestamp", 1e6, "us"), ("time_ns", 1e9, "ns"),
    ):  # fmt: skip
        text = drafted(tmp_path, {"p": p}, clock, per_second).text
        assert tomllib.loads(text)["time"]["unit"] == unit
        assert ("# unsure: its steps are" in text) == (clock != "time_ns")
    truth = flown()
    columns = {"x": T, "acc_y": truth["ay"], "acc_z": -truth["az"], "roll": 0.1 * truth["phi"]}
    columns["noise"] = np.cos(99 * T)
    lines = drafted(tmp_path, columns).text.splitlines()
    told = {line.split(" = ")[0]: line.partition("# ")[2] for line in lines}
    assert "unsure: whether x is north" in told["pn"]
    assert "unsure: z points up, so y may point to the left" in told["ay"]
    assert told["az"] == "gravity reads 9.62; turned: its z points up"
    assert "unsure: rad by its size only" in told["phi"]
    assert '# NAME = {column = "noise", unit = "1"}  # -1 to 1' in lines


def test_units_of_a_log_without_units(tmp_path: Path) -> None:
    columns = {
        **{name: flown()[name] for name in ("ax", "ay", "az", "vd", "voltage")},
        "altitude (m)": flown()["altitude"] / 0.3048, "thrust": 1500.0 + 150.0 * np.sin(T), "m4_rpm": 5000 + T,
        "roll": DEG * flown()["phi"], "pitch": DEG * flown()["theta"], "yaw": 5.0 * np.sin(0.7 * T),
        "gx": DEG * flown()["p"], "gy": DEG * flown()["q"], "gz": 0.2 * np.sin(5.0 * T),
        "ch3": 1.5 + 0.1 * np.sin(T), "throttle": 50 + T, "aileron": np.clip(2 * np.sin(T), -1, 1),
        "motor_1": 60.0 + 10.0 * np.sin(T), "motor_5": 0.8 + 0.0 * T, "elev_us": 1500.0 + 200.0 * np.sin(T),
        "control_roll": 60.0 * np.sin(2 * T),
    }  # fmt: skip
    made = drafted(tmp_path, columns)
    text, lines = made.text, lines_of(made)
    told = {row.split(" = ")[0]: row for row in text.splitlines() if " = {" in row}
    units = {
        "p": "deg/s", "q": "deg/s", "r": "deg/s", "thrust": "N", "pwm_3": "ms", "rotor_4": "rpm", "throttle": "percent",
        "aileron": "1", "motor_1": "percent", "motor_5": "percent", "control_roll": "percent",
    }  # fmt: skip
    assert {name: lines[name]["unit"] for name in units} == units
    assert {lines[name]["column"] for name in "pqr"} == {"gx", "gy", "gz"}
    assert "; unsure: deg/s as " in told["r"]
    assert 'unsure: write unit = "ft", as other channels show' in told["altitude"]
    assert 'column = "thrust", unit = "N"}  # unsure: N by its name only' in told["thrust"]
    assert "unsure: percent as the others" in text
    assert "unsure: normalized, no angle: name it servo_N and add a calibration" in text
    assert "# [calibration.pwm_3]" in text
    pulses = lines["control_pitch"]
    assert (pulses["column"], pulses["scale"], pulses["offset"]) == ("elev_us", 2e-3, -3.0)


def test_a_rate_without_a_name_is_found_by_what_it_does(tmp_path: Path) -> None:
    truth = flown()
    columns = {"roll_deg": DEG * truth["phi"], "channel A": np.cos(5 * T), "channel B": -DEG * truth["p"]}
    made = drafted(tmp_path, columns)
    assert lines_of(made)["p"] == {"column": "channel B", "unit": "deg/s", "scale": -1.0}
    assert "unsure: by its numbers only: the derivative of phi" in made.text
    surface = flown()["elevator"]
    columns = {"fcs/elevator-cmd-norm": surface / 0.3, "fcs/elevator-pos-rad": surface}
    made = drafted(tmp_path, columns | {"load cell": np.cos(T)})
    assert lines_of(made)["elevator"]["column"] == "fcs/elevator-pos-rad"
    assert made.unknown == ("load cell",)


def test_units_that_the_file_states_are_taken() -> None:
    imu, nav = {"GyrX": flown()["p"], "Temp": 20.0 + 0 * T}, {"Roll": flown()["phi"]}
    units = {"IMU": {"GyrX": "rad/s", "Temp": "degC"}, "nav": {"Roll": "rad"}}
    streams = {"IMU": Stream(T, imu), "nav": Stream(T, nav)}
    made = draft_of(Recording(Path("x.mat"), "mat", streams, units=units))
    found = lines_of(made)
    assert found["p"] == {"stream": "IMU", "column": "GyrX", "unit": "rad/s"}
    assert found["temperature"]["unit"] == "degC"
    assert made.unsure == 0
    dead = draft_of(Recording(Path("x.mat"), "mat", {"IMU": Stream(T, imu | {"Temp": 0 * T})}))
    assert "temperature" in dead.text
    turn = {name: Stream(T, {"point.x": flown()[x], "point.y": flown()[y]}) for name, x, y in (
        ("/plane/euler", "phi", "theta"), ("/plane/bodyrate", "p", "q"), ("/rompc/att_error", "phi", "theta"))}  # fmt: skip
    found = lines_of(draft_of(Recording(Path("x.bag"), "rosbag", turn)))
    assert {name: (entry["stream"], entry["column"], entry["unit"]) for name, entry in found.items()} == {
        "phi": ("/plane/euler", "point.x", "rad"), "theta": ("/plane/euler", "point.y", "rad"),
        "p": ("/plane/bodyrate", "point.x", "rad/s"), "q": ("/plane/bodyrate", "point.y", "rad/s"),
    }  # fmt: skip
    info = {"clock of a": 'x\n[variables]\nq = {column = "evil", unit = "rad"}'}
    recording = Recording(Path("log.mat"), "mat", {"a": Stream(T, {"p": np.sin(T)})}, info=info)
    assert set(lines_of(draft_of(recording))) == {"p"}


def test_columns_as_others_write_them() -> None:
    assert {n: (g.variable, g.unit, g.scale) for n in FOREIGN if (g := recognized(n))} == FOREIGN
    own = {n: (g.variable, g.scale) for n in VARIABLES.keys() - {"height"} if (g := recognized(n))}
    assert own == {n: (n, 1.0) for n in VARIABLES.keys() - {"height"}}
    for variable, names in NAMES.items():
        for name in names.split():
            guess = recognized(name)
            assert (guess.variable if guess else "") == variable, name
    roles = ("theta_cmd", "roll_cmd_deg", "pitch position setpoint", "left", "cmd", "gps", "u_fps")
    for name in (*roles, "(" * 50_000, "a" + " " * 50_000 + "b", "motor " + "9" * 5000):  # in no time
        assert recognized(name) is None, name[:50]
    (motor,) = filter(None, [recognized("motor_1")])
    assert motor.unit == "", "its number is no unit"


@pytest.mark.parametrize(("stem", "turns"), [("u", True), ("x", False)])
def test_numbered_columns_are_motors_where_they_turn(tmp_path: Path, stem: str, turns: bool) -> None:
    """Four commands of a quadrotor, recorded 0.2 s before they act; and four that turn nothing."""
    steps = np.repeat(np.random.default_rng(3).standard_normal((3, 400)), 10, axis=1)
    roll, pitch, yaw = 0.05 * steps
    signs = ((-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, -1))
    motors = {f"{stem}{n}": 0.5 + a * roll + b * pitch + c * yaw for n, (a, b, c) in enumerate(signs, 1)}
    p, q = np.zeros(T.size), np.zeros(T.size)
    for k in range(21, T.size if turns else 0):
        p[k] = 0.9 * p[k - 1] + 0.6 * roll[k - 21]
        q[k] = 0.9 * q[k - 1] + 0.6 * pitch[k - 21]
    angles = {"phi": np.cumsum(p) * 0.01, "theta": np.cumsum(q) * 0.01}
    lines = lines_of(drafted(tmp_path, {"p": p, "q": q, **angles, **motors}))
    found = {n: row["column"] for n, row in lines.items() if n.startswith("motor")}
    assert found == ({f"motor_{n}": f"{stem}{n}" for n in range(1, 5)} if turns else {})


def test_rotors_are_written_as_the_rates(tmp_path: Path) -> None:
    for factor, unit in ((1.0, "rad/s"), (DEG, "rpm")):
        columns = flown() | {f"motor_speed[{n}]": 500.0 + 20.0 * np.sin(T + n) for n in range(4)}
        columns |= {name: factor * columns[name] for name in ("phi", "theta", "psi", "p", "q", "r")}
        made = drafted(tmp_path, columns)
        assert {row["unit"] for n, row in lines_of(made).items() if n.startswith("rotor")} == {unit}
        assert "unsure: rpm or rad/s" in made.text


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.text(min_size=1, max_size=12), st.floats(-1e6, 1e6), min_size=1, max_size=8))
def test_a_draft_is_valid_whatever_the_columns_are_called(columns: dict[str, float]) -> None:
    streams = {'a"\n': Stream(T[:100], {name: np.full(100, x) for name, x in columns.items()})}
    found = lines_of(draft_of(Recording(Path("x.mat"), "mat", streams)))
    assert found.keys() <= VARIABLES.keys()
    assert {entry["column"] for entry in found.values()} <= set(columns)
    assert all(entry["unit"] in FACTORS for entry in found.values())


def test_axes_that_point_to_the_left_are_doubted_with_z(tmp_path: Path) -> None:
    """A log forward, left, up whose only attitude is none: gravity turns z, and nothing confirms y."""
    signs = {"p": 1.0, "q": -1.0, "r": -1.0, "ax": 1.0, "ay": -1.0, "az": -1.0}
    text = drafted(tmp_path, {name: sign * flown()[name] for name, sign in signs.items()}).text
    rows = {row.split(" = ")[0]: row for row in text.splitlines() if " = {" in row}
    assert all("y may point to the left" in rows[name] for name in ("q", "r", "ay"))
    assert "y may point" not in rows["p"] + rows["ax"]


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
    motors = {f"SERVO{n}_FUNCTION": 28.0 + n for n in (5, 6, 7, 8)}
    use = {"SERVO1_FUNCTION": 4.0, **motors, "Q_M_PWM_MIN": 1000.0, "Q_M_PWM_MAX": 2000.0}
    text = draft_of(logged(waves(8), use)).text
    assert sorted(tomllib.loads(text)["variables"]) == [f"motor_{n}" for n in (1, 2, 3, 4)]
    assert "# from = {pwm_1 = 1.0}" in text
    assert "pwm_5 =" not in text


def test_pulses_that_turn_the_vehicle_are_motors_without_any_parameter() -> None:
    flown = simulate_flight(load_vehicle("hexa-x"), FLOWN, seed=2, name="f")
    pulses = {f"C{n}": np.round(1000.0 + 1000.0 * flown.column(f"motor_{n}")) for n in range(1, 7)}
    rates = {f"Gyr{axis}": flown.column(rate) for axis, rate in zip("XYZ", "pqr", strict=True)}
    force = {f"Acc{axis}": flown.column(f"a{axis.lower()}") for axis in "XYZ"}
    made = draft_of(logged(pulses, {}, **rates, **force))
    assert list(tomllib.loads(made.text)["variables"]) == [f"motor_{n}" for n in range(1, 7)]
    assert made.text.count("# unsure: a motor by what it turns, check its number") == made.unsure == 6
    assert "surface" not in made.text
    flown = simulate_flight(load_vehicle("quad-x"), FLOWN, seed=2, name="f")
    signals = {f"pwm_{n}": (flown.time, 1000.0 + 1000.0 * flown.column(f"motor_{n}")) for n in range(1, 5)}
    rates = {rate: (flown.time, flown.column(rate)) for rate in "pq"}
    outputs = Outputs(tuple(signals), {}, {**signals, **rates}, {})
    assert outputs.motor_lines() == []
    text = "\n".join(outputs.surface_lines())
    assert "pwm_1 pwm_2 pwm_3 pwm_4 turn the vehicle against one another" in text
    assert "surface" not in text


@pytest.mark.parametrize("strange", [float("nan"), float("inf"), -1e300, 33.5])
def test_strange_parameters_tell_nothing(strange: float) -> None:
    names = ("FUNCTION", "MIN", "TRIM", "MAX")
    told = {f"SERVO{n}_{name}": strange for n in range(1, 5) for name in names}
    assert draft_of(logged(waves(4), told)).text == draft_of(logged(waves(4), {})).text


def test_printed_written_and_read(tmp_path: Path, done: Done) -> None:
    t, log, target = 0.02 * np.arange(500), tmp_path / "f.csv", tmp_path / "m.toml"
    rows = np.column_stack([t, 20.0 * np.sin(t), 20.0 * np.cos(t)])
    np.savetxt(log, rows, delimiter=",", header="t_s,roll,roll_rate", comments="")
    mapping = tomllib.loads(done(["map", log]))
    assert mapping["time"] == {"column": "t_s", "unit": "s"}
    assert mapping["variables"]["p"] == {"column": "roll_rate", "unit": "deg/s"}
    assert "m.toml: 2 variables, 0 of them unsure" in done(["map", log, "-o", target])
    assert main(["map", str(log), "-o", str(target)]) == 2
    found = json.loads(done(["map", log, "--json", "-o", target, "--overwrite"]))
    assert found["mapping"] == target.read_text("utf-8")
    time, roll, _ = found["columns"]
    assert (time["column"], time["low"], time["high"]) == ("t_s", 0.0, 9.98)
    assert time["samples"] == sorted(time["samples"])
    assert (roll["stream"], roll["unit"]) == ("f.csv", "")
    assert roll["high"] == pytest.approx(20.0, abs=0.01)
    done(["info", log, "--mapping", target])
