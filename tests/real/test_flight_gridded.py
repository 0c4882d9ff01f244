"""Real flights: channels, gaps, windows, faults, maneuvers, and unfit logs that must warn."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from stoop.errors import FlightError
from stoop.flight import OUTPUTS, Flight, find_maneuvers, load, save, segments
from stoop.logs import read

CONTROLS = ("control_roll", "control_pitch", "control_yaw", "control_throttle")
A430 = """[time]
column = "Systime"
unit = "s"
[variables]
V = {column = "vt", unit = "m/s"}
alpha = {column = "alpha", unit = "deg"}
beta = {column = "beta", unit = "deg"}
phi = {column = "phi", unit = "deg"}
theta = {column = "theta", unit = "deg"}
psi = {column = "psi", unit = "deg"}
p = {column = "p", unit = "deg/s"}
q = {column = "q", unit = "deg/s"}
r = {column = "r", unit = "deg/s"}
elevator = {column = "de", unit = "deg"}
aileron = {column = "da", unit = "deg"}
"""
SKYWALKER = """[time]
column = "t_s"
unit = "s"
[variables]
phi = {column = "phi_rad", unit = "rad", file = "plane_euler.csv"}
theta = {column = "theta_rad", unit = "rad", file = "plane_euler.csv"}
psi = {column = "psi_rad", unit = "rad", file = "plane_euler.csv"}
p = {column = "p_rps", unit = "rad/s", file = "plane_bodyrate.csv"}
q = {column = "q_rps", unit = "rad/s", file = "plane_bodyrate.csv"}
r = {column = "r_rps", unit = "rad/s", file = "plane_bodyrate.csv"}
thrust = {column = "thrust_N", unit = "N", file = "plane_actuators.csv"}
aileron = {column = "aileron", unit = "rad", file = "plane_actuators.csv"}
"""


@pytest.fixture(scope="session")
def vtail(vtail_flight: Flight) -> Flight:
    return vtail_flight


def test_loading_takes_seconds_at_most(shared_data: Path, vtail: Flight) -> None:
    begun = time.process_time()
    load(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    assert time.process_time() - begun < 20.0  # processor time; 0.8 s on a quiet core


def test_all_channels_are_there(vtail: Flight) -> None:
    wanted = {*OUTPUTS, *CONTROLS, *(f"pwm_{n}" for n in range(1, 6)), "vn", "ve", "vd", "pn", "pe", "pd"}
    wanted |= {"airspeed_pitot", "wind_n", "wind_e", "altitude", "density", "temperature", "voltage", "q0"}
    assert wanted <= set(vtail.data.data_vars)
    assert vtail.name == "flight2"
    assert vtail.rate == 100.0
    assert 68.0 < vtail.time[0] < 69.0
    assert vtail.air is not None


def test_gridded_rates_follow_the_recorded_ones(shared_data: Path, vtail: Flight) -> None:
    stream = read(shared_data / "altlnt-vtail-8kg-px4" / "flight2").streams["vehicle_angular_velocity"]
    taken = stream.columns["timestamp_sample"] * 1e-6
    window = (taken > 160.0) & (taken < 168.0)
    grid = np.interp(taken[window], vtail.time, vtail.column("p"))
    recorded = stream.columns["xyz[0]"][window]
    assert np.corrcoef(grid, recorded)[0, 1] > 0.98
    assert abs(np.mean(grid - recorded)) < 1e-3


def test_windows_split_at_the_dropouts(vtail: Flight) -> None:
    spans = {}
    for start, stop in ((140.0, 145.0), (146.0, 152.0), (160.0, 168.3), (187.0, 196.0)):
        found, notes = segments(vtail, start, stop, CONTROLS, OUTPUTS)
        spans[start] = [(round(float(s.t[0]), 2), round(float(s.t[-1]), 2)) for s in found]
        assert all(np.isfinite(s.u).all() for s in found)
        assert np.mean([np.isfinite(s.z).mean() for s in found]) > 0.95
        assert len(notes) == {140.0: 2, 146.0: 1, 160.0: 0, 187.0: 0}[start]
    assert spans == {
        140.0: [(140.14, 142.46), (142.76, 144.99)],
        146.0: [(146.08, 152.0)],
        160.0: [(160.0, 168.3)],
        187.0: [(187.0, 196.0)],
    }


def test_the_pilot_s_doublets_are_found(vtail: Flight) -> None:
    found = [(m.axis, round(m.start), round(m.stop)) for m in find_maneuvers(vtail)]
    small = ("pitch", 160, 162)  # a quarter of the size of the other one
    assert found == [("roll", 140, 146), ("pitch", 146, 152), small, ("yaw", 162, 169), ("roll", 188, 195)]


def test_the_pitot_is_suspected(vtail: Flight) -> None:
    (fault,) = vtail.faults
    assert (fault.kind, fault.variable) == ("offset at rest", "airspeed_pitot")
    assert fault.value == pytest.approx(-3.0, abs=0.1)


def test_a_real_flight_survives_our_own_file(vtail: Flight, tmp_path: Path) -> None:
    save(vtail, tmp_path / "flight2.nc")
    back = load(tmp_path / "flight2.nc")
    assert back.data.identical(vtail.data)
    assert (back.air, back.sources, back.notices, back.faults) == (
        vtail.air,
        vtail.sources,
        vtail.notices,
        vtail.faults,
    )


@pytest.mark.parametrize("folder", ["altlnt-hexacopter-px4", "mit-solar-surfer-px4csv"])
def test_other_folders_of_topics(shared_data: Path, folder: str) -> None:
    flight = load(shared_data / folder)
    assert {"p", "q", "r", "ax", "phi", "vn", "control_roll"} <= set(flight.data.data_vars)
    quaternion = np.column_stack([flight.column(f"q{k}") for k in range(4)])
    known = np.isfinite(quaternion).all(axis=1)
    np.testing.assert_allclose(np.linalg.norm(quaternion[known], axis=1), 1.0, atol=1e-12)


def test_a_ulog(shared_data: Path) -> None:
    flight = load(shared_data / "px4-ulog-reader-samples" / "sample_log_small.ulg")
    assert {"p", "ax", "phi", "control_roll", "pwm_1"} <= set(flight.data.data_vars)
    assert 6.0 < flight.time[-1] - flight.time[0] < 7.0
    assert any(found.values.get("kind") == "dropout" for found in flight.notices)


def test_motion_capture_in_degrees(shared_data: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "a430.toml"
    for log in sorted((shared_data / "a430-micro-fixedwing-mocap").glob("*.csv")):
        mapping.write_text(A430)
        flight = load(log, mapping)
        assert np.nanmax(np.abs(flight.column("theta"))) < 1.6
        for wrong in ("deg/s", "deg"):
            mapping.write_text(A430.replace(f'"{wrong}"', f'"{wrong.replace("deg", "rad")}"'))
            with pytest.raises(FlightError, match=r"degrees|deg/s where radians belong"):
                load(log, mapping)


def test_dirty_motion_capture_is_called_dirty(shared_data: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "a430.toml"
    mapping.write_text(A430)
    flight = load(
        shared_data / "a430-micro-fixedwing-mocap" / "short_straight_4_20230215_133852.csv", mapping
    )
    kinds = {(fault.kind, fault.variable) for fault in flight.faults}
    assert {("clipped", "p"), ("clipped", "r"), ("stuck", "V"), ("stuck", "psi")} <= kinds
    clipped = next(fault for fault in flight.faults if fault.variable == "p")
    assert abs(clipped.value) == pytest.approx(2.0, abs=1e-3), "clipped to either side"


def test_ten_hertz_without_air_data_must_warn(shared_data: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "m.toml"
    mapping.write_text(SKYWALKER)
    flight = load(shared_data / "stanford-skywalker-10hz", mapping)
    assert not {"V", "alpha", "beta"} & set(flight.data.data_vars)
    assert "no-air-data" in {found.code for found in flight.notices}
    assert "slow-rates" in {found.code for found in flight.notices}
    _, notices = segments(flight, 60.0, 80.0, ("aileron", "thrust"), OUTPUTS)
    assert "slow-input" in {found.code for found in notices}
    mapping.write_text(SKYWALKER.replace('"rad/s"', '"deg/s"'))
    with pytest.raises(
        FlightError, match=r"phi changes 59\.4 times .*; write unit = \"rad/s\" for variables\.p, "
    ):
        load(shared_data / "stanford-skywalker-10hz", mapping)
