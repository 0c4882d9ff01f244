"""Mappings: what is taken from which stream, what the ready ones find, and what a mistake is told as."""

import math
from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.errors import LogError, StoopError
from stoop.flight.apply_mapping import Mapped
from stoop.flight.mapping import FlightMapping
from stoop.logs import Recording, Stream

T = np.arange(200) * 0.01
GOOD = '[variables]\np = {stream = "g", column = "x", unit = "rad/s"}\n'
GYRO = ("xyz[0]", "xyz[1]", "xyz[2]")
GPS = ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s")


def stream(**columns: FloatArray | float) -> Stream:
    return Stream(T, {name: np.broadcast_to(np.asarray(x, float), T.shape) for name, x in columns.items()})


def mapped(folder: Path, text: str, **streams: Stream) -> Mapped:
    path = folder / "m.toml"
    path.write_text(text)
    return Mapped.of(FlightMapping.read(path), Recording(Path("log"), "mat", streams))


def values(found: Mapped) -> dict[str, FloatArray]:
    return {name: x for group in found.channels for name, x in group.values.items()}


def first(name: str, format_: str, streams: dict[str, Stream]) -> dict[str, float]:
    found = Mapped.of(FlightMapping.ready(name), Recording(Path("log"), format_, streams))
    return {variable: float(x[0]) for variable, x in values(found).items()}


def test_one_column_for_one_variable(tmp_path: Path) -> None:
    text = '[variables]\np = {stream = "gyro", column = "x", unit = "deg/s"}\nvoltage = {column = "mv", unit = "mV"}\n'
    found = mapped(tmp_path, text, gyro=stream(x=90.0, y=1.0), battery=stream(mv=16800.0))
    assert values(found)["p"][0] == pytest.approx(math.pi / 2)
    assert values(found)["voltage"][0] == pytest.approx(16.8)
    assert found.unmapped == {"gyro": ("y",)}
    assert found.places["p"].endswith("m.toml: variables.p")
    text = '[time]\ncolumn = "ms"\nunit = "ms"\n' + GOOD.replace("stream", "file").replace('"g"', '"gyro"')
    timed = mapped(tmp_path, text, gyro=stream(x=1.0, ms=5000.0 + 20.0 * np.arange(200)))
    assert timed.channels[0].time[:2].tolist() == pytest.approx([5.0, 5.02])
    assert timed.unmapped == {}
    text = (
        '[clock.b]\ncolumn = "us"\nunit = "us"\noffset = -1.0\n[variables]\np = {stream = "a", column = "x", '
        'unit = "rad/s"}\nq = {stream = "b", column = "x", unit = "rad/s"}\n'
    )
    found = mapped(tmp_path, text, a=stream(x=1.0), b=stream(x=1.0, us=4e6 + 1e4 * np.arange(200)))
    times = {group.source: group.time[0] for group in found.channels}
    assert times == {"a": 0.0, "b": 3.0}


def test_sources_in_order_of_trust(tmp_path: Path) -> None:
    text = (
        '[group.rates]\nvariables = ["p", "q", "r"]\nunit = "deg/s"\nsources = [{stream = "a", columns = "w[{0..2}]"}, '
        '{stream = "b", columns = ["x", "y", "z"], unit = "rad/s"}]\n'
    )
    first, second = stream(**{f"w[{i}]": 180.0 for i in range(3)}), stream(x=1.0, y=2.0, z=3.0)
    assert values(mapped(tmp_path, text, a=first, b=second))["q"][0] == pytest.approx(math.pi)
    assert values(mapped(tmp_path, text, b=second))["r"][0] == 3.0
    fast = Stream(np.arange(900) * 0.002, {k: np.ones(900) for k in "xyz"})
    assert mapped(tmp_path, text, a=first, b=fast).channels[0].source == "b", "it is much faster"
    assert values(mapped(tmp_path, text, b=stream(x=1.0, y=2.0))) == {}, "it lacks a column"
    text = '[group.esc]\nvariables = ["rotor_{1..4}"]\nunit = "rpm"\nunused = 0\n'
    text += 'sources = [{stream = "ESC/{0..3}", columns = "RPM"}]\n'
    streams = {"ESC": stream(RPM=600.0), "ESC/1": stream(RPM=1200.0), "ESC/3": stream(RPM=0.0)}
    found = values(mapped(tmp_path, text, **streams))
    assert set(found) == {"rotor_1", "rotor_2"}
    assert found["rotor_2"][0] == pytest.approx(40.0 * math.pi)


def test_a_mapping_may_extend_a_ready_one(tmp_path: Path) -> None:
    text = 'extends = "px4"\n[variables]\naz = {stream = "mine", column = "up", unit = "g", scale = -1}\n'
    imu = {f"accelerometer_m_s2[{i}]": float(i) for i in range(3)} | {f"gyro_rad[{i}]": 0.1 for i in range(3)}
    found = mapped(tmp_path, text, sensor_combined=stream(**imu), mine=stream(up=1.0))
    assert values(found)["az"][0] == pytest.approx(-9.80665)
    assert {"ax", "ay", "p", "q", "r"} < set(values(found))
    assert values(found)["ay"][0] == 1.0
    whole = mapped(tmp_path, 'extends = "px4"\n[group.specific_force]\nvariables = ["ax"]\nsources = [{stream = "mine", '
                   'columns = "up"}]\n', sensor_combined=stream(**imu), mine=stream(up=5.0))  # fmt: skip
    assert "ay" not in values(whole)
    lines = (f'{n} = {{stream = "mocap", column = "{n}", unit = "deg"}}\n' for n in ("phi", "theta", "psi"))
    text = 'extends = "px4"\n[variables]\n' + "".join(lines)
    estimate = stream(**{f"q[{i}]": 0.5 for i in range(4)})
    found = mapped(tmp_path, text, vehicle_attitude=estimate, mocap=stream(phi=10.0, theta=20.0, psi=30.0))
    (group,) = found.channels
    assert set(group.values) == {"phi", "theta", "psi"}  # in one group: they are interpolated as a quaternion


def test_ready_mappings_name_only_what_there_is() -> None:
    streams = {"RCOU": stream(C1=1500.0, C2=0.0), "XKF2": stream(VWN=0.0, VWE=0.0)}
    found = Mapped.of(FlightMapping.ready("ardupilot"), Recording(Path("l"), "dataflash", streams))
    assert set(values(found)) == {"pwm_1"}
    for name in set(FlightMapping.READY.values()):
        assert FlightMapping.ready(name).groups
        assert not FlightMapping.ready(name).surfaces.mixes
    turning = stream(**{"esc[0].esc_rpm": 3000.0, "esc[1].esc_rpm": 0.0})
    rotors = {"esc_status": turning, "rpm": stream(rpm_estimate=9.0)}
    for thrust in (0.6, 0.0):
        asked = stream(**{"xyz[0]": 0.0, "xyz[1]": 0.0, "xyz[2]": -thrust})
        found = first("px4", "ulog", {"vehicle_thrust_setpoint": asked, **rotors})
        assert found == pytest.approx({"control_throttle": thrust, "rotor_1": 100.0 * math.pi})


def test_ardupilot() -> None:
    streams = {
        "ATT": stream(Roll=10.0, Pitch=-5.0, Yaw=350.0),
        "IMU": stream(GyrX=0.1, GyrY=0.2, GyrZ=0.3, AccX=0.0, AccY=1.0, AccZ=-9.8),
        "XKF1": stream(VN=1.0, VE=2.0, VD=3.0, PN=4.0, PE=5.0, PD=6.0),
        "XKF2": stream(VWN=-1.0, VWE=2.5),
        "ARSP": stream(Airspeed=20.0, Temp=15.0),
        "RCO2": stream(C15=1100.0),
        "RCOU": stream(**{f"C{i}": 1000.0 + i for i in range(1, 15)}),
        "ESC/1": stream(RPM=6000.0),
        "SIDD": stream(Targ=np.sin(T)),
        "AETR": stream(Ail=4500.0, Elev=-2250.0, Rudd=0.0, Thr=40.0),
        "BAT": stream(Volt=15.9, Curr=7.0),
        "BARO": stream(Press=101325.0, Temp=40.0),
        "POS": stream(Alt=88.0),
    }
    found = first("ardupilot", "dataflash", streams)
    expected = {
        "phi": math.radians(10), "theta": math.radians(-5), "psi": math.radians(350), "q": 0.2, "az": -9.8, "vd": 3.0,
        "pe": 5.0, "wind_e": 2.5, "airspeed_equivalent": 20.0, "temperature": 288.15, "pwm_14": 1014.0, "pwm_15": 1100.0,
        "rotor_2": 200.0 * math.pi, "injected": 0.0, "control_roll": 1.0, "control_pitch": -0.5, "control_throttle": 0.4,
        "voltage": 15.9, "current": 7.0, "pressure": 101325.0, "altitude": 88.0,
    }  # fmt: skip
    assert {name: found[name] for name in expected} == pytest.approx(expected)


def test_crazyflie() -> None:
    card = stream(**{
        "stateEstimate.vx": 1.0, "stateEstimate.vy": 2.0, "stateEstimate.vz": 3.0, "stateEstimate.ax": 0.0,
        "stateEstimate.ay": 0.0, "stateEstimate.az": 1.0, "motor.m1": 65535.0, "motor.m2": 0.0, "pm.vbatMV": 3700.0,
        "gyro.x": 180.0, "gyro.y": 180.0, "gyro.z": 180.0, "acc.x": 0.0, "acc.y": 0.5, "acc.z": 1.0,
        "stateEstimate.roll": 10.0, "stateEstimate.pitch": 5.0, "stateEstimate.yaw": 90.0, "rpm.m2": 60.0,
    })  # fmt: skip
    found, g = first("crazyflie", "crazyflie", {"any": card}), 9.80665
    expected = {
        "vn": 2.0, "ve": 1.0, "vd": -3.0, "ad": -g, "motor_1": 1.0, "motor_2": 0.0, "voltage": 3.7, "p": math.pi,
        "q": -math.pi, "r": -math.pi, "ay": -0.5 * g, "az": -g, "phi": math.radians(10), "theta": math.radians(5),
        "psi": 0.0, "rotor_2": 2.0 * math.pi,
    }  # fmt: skip
    assert {name: found[name] for name in expected} == pytest.approx(expected, abs=1e-12)


def test_betaflight_and_inav() -> None:
    """A nose that rises, to the right: gyro and accelerometer point forward, left, up; INAV's pitch counts down."""
    main = stream(**{
        "gyroADC[0]": 180.0, "gyroADC[1]": 180.0, "gyroADC[2]": 180.0, "accSmooth[0]": 0.1, "accSmooth[1]": 0.5,
        "accSmooth[2]": 1.0, "attitude[0]": 100.0, "attitude[1]": -50.0, "attitude[2]": 900.0, "motor[0]": 0.6,
        "navVel[0]": 100.0, "navVel[1]": 200.0, "navVel[2]": 300.0, "navPos[2]": 500.0, "navPos[0]": 0.0,
        "navPos[1]": 0.0, "AirSpeed": 1500.0, "eRPM[1]": 60.0, "servo[2]": 1400.0,
        "axisSum[0]": 0.0, "axisSum[1]": 500.0, "axisSum[2]": 0.0,
        "vbat": 15.5,
    })  # fmt: skip
    found, g = first("betaflight", "blackbox", {"main": main}), 9.80665
    expected = {
        "p": math.pi, "q": -math.pi, "r": -math.pi, "ax": 0.1 * g, "ay": -0.5 * g, "az": -g, "phi": math.radians(10),
        "theta": math.radians(5), "psi": math.radians(90), "motor_1": 0.6, "vn": 1.0, "ve": 2.0, "vd": -3.0,
        "pd": -5.0, "airspeed_equivalent": 15.0, "rotor_2": 2.0 * math.pi, "pwm_3": 1400.0, "control_pitch": -0.5,
        "voltage": 15.5,
    }  # fmt: skip
    assert {name: found[name] for name in expected} == pytest.approx(expected, abs=1e-12)
    half = math.sqrt(0.5)  # nose up by a right angle turns about the left axis by minus that
    up = {f"imuQuaternion[{part}]": x for part, x in (("w", half), (0, 0.0), (1, -half), (2, 0.0))}
    turned = first("betaflight", "blackbox", {"main": stream(**up)})
    assert abs(turned["q0"] * half + turned["q2"] * half) == pytest.approx(1.0)  # either sign


def test_each_mistake_is_one_line(tmp_path: Path) -> None:
    for text, words in (
        (GOOD.replace("p =", "pp ="), r"variables\.pp is no variable of stoop"),
        (GOOD.replace('"x"', '"xx"'), r"variables\.p\.column = 'xx' is not in g; did you mean x\? its columns are x, y"),
        (GOOD.replace('"g"', '"h"'), r"variables\.p\.stream = 'h' is not in the log; it holds g, k"),
        (GOOD.replace('stream = "g", ', ""), r"variables\.p\.column = 'x' is in g, k; name one of them by stream"),
        (GOOD.replace("rad/s", "m/s"), r"'m/s' is a speed, but p is a rate of turn; write one of rad/s"),
        (GOOD.replace("rad/s", "rads"), r"unit = 'rads' is unknown; did you mean"),
        (GOOD.replace('"x",', '"x", frame = "enu",'), r"frame = enu says nothing about p"),
        (GOOD.replace('"x",', '"x", frame = "xyz",'), r"variables\.p\.frame: it must be 'frd', 'flu'"),
        (GOOD.replace('"x",', '"x", gain = 1,'), r"variables\.p\.gain: unknown key"),
        (GOOD.replace("[variables]", "[variable]"), "variable: unknown key; .*did you mean variables"),
        (GOOD + 'vn = {stream = "g", column = "x", unit = "m/s", frame = "enu"}', "vn alone; name vn, ve, vd together"),
        ('extends = "px5"', "there is no ready mapping 'px5'; did you mean px4"),
        ("", "it names no variable"),
        ('[group.a]\nvariables = ["p", "q"]\nstream = "g"\ncolumns = "x"', "2 variables, but 1 columns"),
        ('[group.a]\nvariables = ["pwm_{1..900}"]\nstream = "g"\ncolumns = "x"', "stands for nothing, or for more than"),
        ('[group.a]\nvariables = ["p"]\nstream = "g"\ncolumns = "x"\nchoose = "best"', r"group\.a\.choose: it must be 'fastest'"),
        ('[group.a]\nvariables = ["p"]\nstream = "g"\ncolumns = [{}]', r"group\.a\.columns"),
        ("[group]\na = 1", r"group\.a: this must be a table"),
        ('[clock.g]\ncolumn = "t"\nunit = "s"\n' + GOOD, r"clock\.g\.column = 't' is not in g"),
        ('[time]\ncolumn = "t"\nunit = "h"\n' + GOOD, r"time\.unit: it must be 's', 'ms'"),
    ):  # fmt: skip
        with pytest.raises(StoopError, match=words) as caught:
            mapped(tmp_path, text, g=stream(x=1.0, y=2.0), k=stream(x=1.0))
        assert "\n" not in str(caught.value)
    with pytest.raises(LogError, match="cannot read the mapping file"):
        FlightMapping.read(tmp_path / "no.toml")
    path = tmp_path / "m.toml"
    path.write_text(GOOD.replace("rad/s", "deg/s"))
    log = Recording(Path("log"), "dataflash", {"g": stream(x=1.0)}, units={"g": {"x": "rad/s"}})
    (found,) = Mapped.of(FlightMapping.read(path), log).notices
    assert (found.code, found.subject) == ("unit-contradicted", "g.x")
    assert (found.values["unit"], found.values["stated"]) == ("deg/s", "rad/s")


def sampled(rate: float, *names: str, **columns: FloatArray) -> Stream:
    time = np.arange(0.0, 4.0, 1.0 / rate)
    return Stream(time, {**{name: np.full(time.size, float(k)) for k, name in enumerate(names)}, **columns})


def as_px4(streams: dict[str, Stream]) -> Mapped:
    return Mapped.of(FlightMapping.ready("px4"), Recording(Path("log"), "ulog", streams))


def named(**streams: Stream) -> dict[str, tuple[str, FloatArray]]:
    return {name: (one.source, x) for one in as_px4(streams).channels for name, x in one.values.items()}


@pytest.mark.parametrize(("void", "lost", "kept"), [("v_xy_valid", "vn", "vd"), ("v_z_valid", "vd", "vn")])
def test_a_source_that_is_never_valid_gives_way(void: str, lost: str, kept: str) -> None:
    flags = {"v_xy_valid": np.ones(40), "v_z_valid": np.ones(40), void: np.zeros(40)}
    local = sampled(10, "vx", "vy", "vz", **flags)
    found = named(vehicle_local_position=local, vehicle_gps_position=sampled(5, *GPS))
    assert {found[name][0] for name in ("vn", "ve", "vd")} == {"vehicle_gps_position"}
    alone = named(vehicle_local_position=local)
    assert np.isnan(alone[lost][1]).all()
    assert np.isfinite(alone[kept][1]).all()
    at_times = sampled(10, "vx", "vy", "vz", **{**flags, void: np.arange(40) % 2.0})
    assert np.array_equal(np.isnan(named(vehicle_local_position=at_times)[lost][1]), np.arange(40) % 2 == 0)


def test_a_source_without_a_value_supplies_nothing_and_altitude_counts_from_the_sea() -> None:
    nothing = np.full(40, np.nan)
    assert named(airspeed=sampled(10, true_airspeed_m_s=nothing)) == {}
    slow = sampled(1, true_airspeed_m_s=np.ones(4))
    found = named(airspeed=sampled(10, true_airspeed_m_s=nothing), airspeed_validated=slow)
    assert found["airspeed_pitot"][0] == "airspeed_validated"
    variance = np.array([0.0, 0.0, 0.1, 0.1])  # without one the wind was not estimated
    wind = sampled(1, "windspeed_north", "windspeed_east", variance_north=variance)
    assert np.isnan(named(wind_estimate=wind)["wind_n"][1]).tolist() == [True, True, False, False]
    columns = {"true_airspeed_m_s": np.ones(40), "air_temperature_celsius": np.full(40, 20.0)}
    assert named(airspeed=sampled(10, **columns))["temperature"][1][0] == 293.15
    barometer = sampled(20, baro_alt_meter=np.full(80, 33.0))
    assert named(vehicle_air_data=barometer)["altitude"][1][0] == 33.0
    for sea, altitude in ((86.0, 106.0), (np.nan, 33.0)):
        position = sampled(10, z=np.full(40, -20.0), ref_alt=np.full(40, sea))
        found = named(vehicle_local_position=position, vehicle_air_data=barometer)["altitude"][1]
        assert (found == altitude).all()


def test_pulses_of_the_instance_that_moves_most_and_commands_without_pulses() -> None:
    t = sampled(10).time
    driven = {f"output[{i}]": np.full(t.size, x) for i, x in ((0, 1500.0), (1, 0.0), (4, 1000.0))}
    assert set(named(actuator_outputs=Stream(t, driven))) == {"pwm_1", "pwm_5"}
    still = Stream(t, {f"output[{i}]": np.full(t.size, 1500.0) for i in range(8)})
    moved = Stream(t, {"output[0]": 1500.0 + 200.0 * np.sin(t), "output[1]": np.full(t.size, np.nan)})
    idle = Stream(t, {"output[0]": np.zeros(t.size)})
    streams = {"actuator_outputs": still, "actuator_outputs/1": moved, "actuator_outputs/2": idle}
    found = named(**streams)
    assert {name: source for name, (source, _) in found.items()} == {"pwm_1": "actuator_outputs/1"}
    (left,) = as_px4(streams).notices
    assert (left.code, left.subject) == ("instance-left-out", "actuator_outputs")
    assert named(**{"actuator_outputs/1": moved}).keys() == {"pwm_1"}
    for alone in ({"actuator_outputs/1": moved}, {"actuator_outputs": idle}):
        assert as_px4(alone).notices == []
    nothing = np.full(40, np.nan)
    columns = {"control[0]": np.full(40, 0.1), "control[1]": np.full(40, -0.2), "control[2]": nothing}
    found = named(actuator_servos=sampled(10, **columns), actuator_motors=sampled(10, **columns))
    assert set(found) == {"servo_1", "servo_2", "motor_1", "motor_2"}
    assert found["servo_2"][1][0] == -0.2
    assert found["motor_1"][0] == "actuator_motors"
    old = named(actuator_controls_0=sampled(100, *(f"control[{i}]" for i in range(4))))
    new = named(vehicle_torque_setpoint=sampled(100, *GYRO), vehicle_thrust_setpoint=sampled(100, *GYRO))
    names = {"control_roll", "control_pitch", "control_yaw", "control_throttle"}
    assert set(old) == set(new) == names
    assert [old[name][1][0] for name in ("control_roll", "control_throttle")] == [0.0, 3.0]


def test_the_stamp_of_the_sample_counts_where_it_can_be_believed() -> None:
    published = np.arange(1.0, 2.0, 0.01)

    def clock(stamps: FloatArray) -> FloatArray:
        columns = {**dict.fromkeys(GYRO, 0.0 * published), "timestamp_sample": stamps}
        return as_px4({"vehicle_angular_velocity": Stream(published, columns)}).channels[0].time

    np.testing.assert_allclose(clock((published - 0.02) * 1e6), published - 0.02)
    for nonsense in (np.zeros(100), np.full(100, 1e6), (published + 0.1) * 1e6, (published - 3.0) * 1e6):
        assert clock(nonsense) is published
