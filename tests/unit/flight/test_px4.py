"""PX4 topics under registry names: order of trust, validity, clocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.flight.apply_mapping import Mapped, apply_mapping
from stoop.flight.mapping import ready
from stoop.logs import Recording, Stream


def stream(rate: float, *names: str, **columns: FloatArray) -> Stream:
    time = np.arange(0.0, 4.0, 1.0 / rate)
    return Stream(time, {**{name: np.full(time.size, float(k)) for k, name in enumerate(names)}, **columns})


def mapped(streams: dict[str, Stream]) -> Mapped:
    return apply_mapping(ready("px4"), Recording(Path("log"), "ulog", streams))


def named(**streams: Stream) -> dict[str, tuple[str, FloatArray]]:
    return {name: (one.source, x) for one in mapped(streams).channels for name, x in one.values.items()}


GYRO = ("xyz[0]", "xyz[1]", "xyz[2]")
COMBINED = ("gyro_rad[0]", "gyro_rad[1]", "gyro_rad[2]", *(f"accelerometer_m_s2[{i}]" for i in range(3)))


def test_the_first_source_is_trusted_unless_a_later_one_is_much_faster() -> None:
    found = named(vehicle_angular_velocity=stream(400, *GYRO), sensor_combined=stream(200, *COMBINED))
    assert found["q"][0] == "vehicle_angular_velocity"
    assert found["az"][0] == "sensor_combined"
    assert found["az"][1][0] == 5.0
    faster = named(vehicle_angular_velocity=stream(50, *GYRO), sensor_combined=stream(200, *COMBINED))
    assert faster["q"][0] == "sensor_combined"
    assert named(vehicle_angular_velocity=stream(50, *GYRO[:2])) == {}, "it lacks a column"


GPS = ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s")


@pytest.mark.parametrize(("void", "lost", "kept"), [("v_xy_valid", "vn", "vd"), ("v_z_valid", "vd", "vn")])
def test_a_source_that_is_never_valid_gives_way(void: str, lost: str, kept: str) -> None:
    flags = {"v_xy_valid": np.ones(40), "v_z_valid": np.ones(40), void: np.zeros(40)}
    local = stream(10, "vx", "vy", "vz", **flags)
    found = named(vehicle_local_position=local, vehicle_gps_position=stream(5, *GPS))
    assert {found[name][0] for name in ("vn", "ve", "vd")} == {"vehicle_gps_position"}
    alone = named(vehicle_local_position=local)
    assert np.isnan(alone[lost][1]).all()
    assert np.isfinite(alone[kept][1]).all()
    at_times = stream(10, "vx", "vy", "vz", **{**flags, void: np.arange(40) % 2.0})
    assert np.array_equal(np.isnan(named(vehicle_local_position=at_times)[lost][1]), np.arange(40) % 2 == 0)


def test_a_source_without_a_value_supplies_nothing() -> None:
    nothing = np.full(40, np.nan)
    assert named(airspeed=stream(10, true_airspeed_m_s=nothing)) == {}
    slow = stream(1, true_airspeed_m_s=np.ones(4))
    found = named(airspeed=stream(10, true_airspeed_m_s=nothing), airspeed_validated=slow)
    assert found["airspeed_pitot"][0] == "airspeed_validated"
    variance = np.array([0.0, 0.0, 0.1, 0.1])  # without one the wind was not estimated
    wind = stream(1, "windspeed_north", "windspeed_east", variance_north=variance)
    assert np.isnan(named(wind_estimate=wind)["wind_n"][1]).tolist() == [True, True, False, False]
    columns = {"true_airspeed_m_s": np.ones(40), "air_temperature_celsius": np.full(40, 20.0)}
    assert named(airspeed=stream(10, **columns))["temperature"][1][0] == 293.15


def test_altitude_counts_from_the_sea() -> None:
    barometer = stream(20, baro_alt_meter=np.full(80, 33.0))
    assert named(vehicle_air_data=barometer)["altitude"][1][0] == 33.0
    for sea, altitude in ((86.0, 106.0), (np.nan, 33.0)):
        position = stream(10, z=np.full(40, -20.0), ref_alt=np.full(40, sea))
        found = named(vehicle_local_position=position, vehicle_air_data=barometer)["altitude"][1]
        assert (found == altitude).all()


def test_pulses_of_the_instance_that_moves_most() -> None:
    t = stream(10).time
    driven = {f"output[{i}]": np.full(t.size, x) for i, x in ((0, 1500.0), (1, 0.0), (4, 1000.0))}
    assert set(named(actuator_outputs=Stream(t, driven))) == {"pwm_1", "pwm_5"}
    still = Stream(t, {f"output[{i}]": np.full(t.size, 1500.0) for i in range(8)})
    moved = Stream(t, {"output[0]": 1500.0 + 200.0 * np.sin(t), "output[1]": np.full(t.size, np.nan)})
    idle = Stream(t, {"output[0]": np.zeros(t.size)})
    streams = {"actuator_outputs": still, "actuator_outputs/1": moved, "actuator_outputs/2": idle}
    found = named(**streams)
    assert {name: source for name, (source, _) in found.items()} == {"pwm_1": "actuator_outputs/1"}
    (left,) = mapped(streams).notices
    assert (left.code, left.subject) == ("instance-left-out", "actuator_outputs")
    assert named(**{"actuator_outputs/1": moved}).keys() == {"pwm_1"}
    for alone in ({"actuator_outputs/1": moved}, {"actuator_outputs": idle}):
        assert mapped(alone).notices == []


def test_actuators_without_pulses() -> None:
    nothing = np.full(40, np.nan)
    columns = {"control[0]": np.full(40, 0.1), "control[1]": np.full(40, -0.2), "control[2]": nothing}
    found = named(actuator_servos=stream(10, **columns), actuator_motors=stream(10, **columns))
    assert set(found) == {"servo_1", "servo_2", "motor_1", "motor_2"}
    assert found["servo_2"][1][0] == -0.2
    assert found["motor_1"][0] == "actuator_motors"


def test_commands_of_either_generation() -> None:
    old = named(actuator_controls_0=stream(100, *(f"control[{i}]" for i in range(4))))
    new = named(vehicle_torque_setpoint=stream(100, *GYRO), vehicle_thrust_setpoint=stream(100, *GYRO))
    names = {"control_roll", "control_pitch", "control_yaw", "control_throttle"}
    assert set(old) == set(new) == names
    assert [old[name][1][0] for name in ("control_roll", "control_throttle")] == [0.0, 3.0]


def test_the_stamp_of_the_sample_counts_where_it_can_be_believed() -> None:
    published = np.arange(1.0, 2.0, 0.01)

    def clock(stamps: FloatArray) -> FloatArray:
        columns = {**dict.fromkeys(GYRO, 0.0 * published), "timestamp_sample": stamps}
        return mapped({"vehicle_angular_velocity": Stream(published, columns)}).channels[0].time

    np.testing.assert_allclose(clock((published - 0.02) * 1e6), published - 0.02)
    for nonsense in (np.zeros(100), np.full(100, 1e6), (published + 0.1) * 1e6, (published - 3.0) * 1e6):
        assert clock(nonsense) is published
