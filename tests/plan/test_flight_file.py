"""A simulated flight goes out as the log of an autopilot, or as a table, and comes back the same."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.flown import maneuver
from orangebox.decoders import decoder_map
from pymavlink import DFReader
from pyulog import ULog

from stoop.base.variables import QUATERNION
from stoop.errors import OutputError
from stoop.flight import Flight, from_columns, load_flight
from stoop.logs.csv_tables import mapping_beside
from stoop.simulation.fly import simulate_flight
from stoop.vehicle.builtin import load_vehicle
from stoop_plan import blackbox_bytes
from stoop_plan.flight_logs import WRITERS, save_flight_as

SINGLE = 2.0**-22  #: of the largest value: numbers of 32 bits, twice rounded
AUTOPILOTS, CHILDREN = {".ulg", ".bin", ".usd", ".csv"}, {".mat", ".parquet"}
STEPS = {".bin": 0.5 / 500.0, ".usd": 0.5 / 65535.0}  #: of a command, half; ArduPilot logs whole us


@cache
def flown(name: str) -> Flight:
    vehicle = load_vehicle(name)
    doublet = ("roll" if vehicle.rotors else "elevator", "doublet", 0.5, 0.3, 8.0 if vehicle.rotors else 0.05)
    wind = (3.0, -2.0, 0.0) if vehicle.rotors else (0.0, 0.0, 0.0)
    return simulate_flight(vehicle, maneuver(3.0, doublet, rate=100.0, heading=4.0, wind=wind), seed=1)


def there_and_back(flight: Flight, target: Path) -> Flight:
    save_flight_as(flight, target)
    return load_flight(target)


@pytest.mark.parametrize(
    ("name", "endings"), [*((name, AUTOPILOTS) for name in ("twin-boom", "quad-x", "quadplane")), ("quad-x", CHILDREN)]
)  # fmt: skip
def test_every_channel_comes_back(name: str, endings: set[str], tmp_path: Path) -> None:
    flight = flown(name)
    for ending in endings:
        back = there_and_back(flight, tmp_path / f"flight{ending}")
        np.testing.assert_allclose(back.time, flight.time, atol=1e-9, err_msg=ending)
        for variable in map(str, flight.data.data_vars):
            if variable in QUATERNION:
                continue  # either sign is right; the angles tell
            x, y = flight.column(variable), back.column(variable)
            most = max(SINGLE * float(np.abs(x).max()), tolerance(variable, ending))
            if variable == "psi":  # of a heading up to 360 deg, or turned by a quarter
                most = SINGLE * 2.0 * np.pi
            assert float(np.abs(y - x).max()) <= most * 1.001, (variable, ending)


def tolerance(variable: str, ending: str) -> float:
    """Return half of a step of what is kept as a whole number; angles and positions come of two single numbers."""
    if variable.startswith(("motor_", "servo_")):
        return STEPS.get(ending, 0.0)
    if variable in ("elevator", "aileron", "rudder"):
        return {".bin": 0.5 * STEPS[".bin"]}.get(ending, 0.0)
    return {"phi": SINGLE, "theta": SINGLE, "pn": SINGLE, "pe": SINGLE, "pd": SINGLE}.get(variable, 0.0)


def test_a_mapping_only_where_one_is_needed(tmp_path: Path) -> None:
    """PX4 has a topic for all that a quadrotor records; that of an earlier flight must not stay beside it."""
    for ending, needed in ((".ulg", False), (".bin", True), (".usd", True), (".csv", True)):
        target = tmp_path / f"flight{ending}"
        mapping_beside(target).write_text('extends = "px4"\n', encoding="utf-8")
        assert (save_flight_as(flown("quad-x"), target) is not None) == needed, ending
        assert mapping_beside(target).exists() == needed, ending


def test_pyulog_reads_it(tmp_path: Path) -> None:
    flight, target = flown("quad-x"), tmp_path / "flight.ulg"
    save_flight_as(flight, target)
    topics = {d.name: d.data for d in ULog(str(target)).data_list}
    assert set(topics) == {"vehicle_attitude", "vehicle_angular_velocity", "sensor_combined", "vehicle_local_position",
                           "actuator_motors", "vehicle_air_data"}  # fmt: skip
    for topic, column, channel in (
        ("sensor_combined", "gyro_rad[1]", "q"), ("vehicle_local_position", "vy", "ve"),
        ("actuator_motors", "control[2]", "motor_3"),
    ):  # fmt: skip
        np.testing.assert_array_equal(topics[topic][column], flight.column(channel).astype("f4"))
    assert np.isnan(topics["actuator_motors"]["control[11]"]).all()
    assert topics["vehicle_local_position"]["v_xy_valid"].all()
    np.testing.assert_allclose(topics["vehicle_attitude"]["timestamp_sample"] * 1e-6, flight.time, atol=1e-6)


def test_pymavlink_reads_it(tmp_path: Path) -> None:
    flight, target = flown("quad-x"), tmp_path / "flight.bin"
    save_flight_as(flight, target)
    log, first = DFReader.DFReader_binary(str(target)), {}
    for kind in ("ATT", "RCOU", "MSG"):
        log.rewind()
        first[kind] = log.recv_match(type=kind)
    angles = [np.degrees(flight.column("phi")[0]), np.degrees(flight.column("psi")[0]) % 360.0]
    assert [first["ATT"].Roll, first["ATT"].Yaw] == pytest.approx(angles, rel=1e-6)
    assert round(1000 + 1000 * flight.column("motor_1")[0]) == first["RCOU"].C1
    assert log.formats[log.name_to_id["IMU"]].units[1:] == ["instance", *["rad/s"] * 3, *["m/s/s"] * 3]
    assert first["MSG"].Message == "stoop: simulated flight"
    log.close()


@pytest.mark.parametrize("child", [False, True])
def test_an_aircraft_with_every_command(child: bool, tmp_path: Path) -> None:
    """What no autopilot has a place for is kept all the same: a measured thrust, more motors than outputs."""
    time, rng = np.arange(200) * 0.01, np.random.default_rng(0)
    names = ["V", "alpha", "beta", "p", "q", "r", "thrust", "throttle", "flap", "elevator", "voltage", "rotor_1",
             "control_roll", "control_pitch", "control_yaw", "control_throttle", "pwm_3", "airspeed_pitot", "density",
             "pressure", "temperature", "wind_n", "wind_e", "injected", "p_dot"]  # fmt: skip
    names += [f"motor_{n}" for n in range(1, 17)] + [f"servo_{n}" for n in range(1, 9)]
    base = {"density": 1.2, "pressure": 9e4, "temperature": 280.0, "pwm_3": 1500.0, "V": 20.0}
    base |= {"voltage": 16.0, "rotor_1": 500.0}  # of which a blackbox log keeps whole steps
    columns = {n: base.get(n, 0.3) * (1.0 + 0.1 * rng.random(time.size)) for n in names}
    flight = from_columns("all", time, columns)
    for ending in CHILDREN if child else WRITERS.keys() - CHILDREN:
        back = there_and_back(flight, tmp_path / f"all{ending}")
        for n in names:
            assert back.column(n) == pytest.approx(flight.column(n), rel=2e-3, abs=1.01e-3), (ending, n)


def test_a_name_of_no_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"\.xyz: no kind of flight file; end its name in \.nc, \.ulg"):
        save_flight_as(flown("quad-x"), tmp_path / "flight.xyz")


def test_orangebox_reads_its_numbers() -> None:
    signed, unsigned = (decoder_map[kind] for kind in (0, 1))
    for x in (0, 1, -1, 63, -64, 64, 8191, -8192, 123_456_789, -(2**30) - 5, 2**31 - 1, -(2**31)):
        assert signed(iter(blackbox_bytes.signed_vb(x)), None) == x
    for x in (0, 127, 128, 2**31 + 7, 2**32 - 1):
        assert unsigned(iter(blackbox_bytes.unsigned_vb(x)), None) == x
