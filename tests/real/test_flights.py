"""Real flights: channels, windows, faults, unfit logs that must warn, and fits that must not be trusted."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from real import simulated

from stoop.checks.kinematics import check_rates
from stoop.checks.mapping import check_mapping
from stoop.errors import FlightError
from stoop.estimate.fit import Options
from stoop.flight import OUTPUTS, Flight, load, save, segments, without_faults
from stoop.flight.faults import Fault
from stoop.logs import read
from stoop.vehicle import load_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop.workflow import identify

BUDGET = Options(budget=400.0)
CONTROLS = ("control_roll", "control_pitch", "control_yaw", "control_throttle")
ANGLES = ("alpha", "beta", "phi", "theta", "psi")
A430_MAPPING = (
    '[time]\ncolumn = "Systime"\nunit = "s"\n[variables]\nV = {column = "vt", unit = "m/s"}\n'
    'elevator = {column = "de", unit = "deg"}\naileron = {column = "da", unit = "deg"}\n'
) + "".join(
    f'{name} = {{column = "{name}", unit = "{unit}"}}\n'
    for names, unit in ((ANGLES, "deg"), ("pqr", "deg/s"))
    for name in names
)
FILES = {
    "euler": {"phi": ("phi_rad", "rad"), "theta": ("theta_rad", "rad"), "psi": ("psi_rad", "rad")},
    "bodyrate": {n: (f"{n}_rps", "rad/s") for n in "pqr"},
    "actuators": {**{n: (n, "1") for n in ("aileron", "elevator", "rudder")}, "thrust": ("thrust_N", "N")},
}  # fmt: skip
STANFORD_MAPPING = '[time]\ncolumn = "t_s"\nunit = "s"\n[variables]\n' + "".join(
    f'{name} = {{column = "{column}", unit = "{unit}", file = "plane_{file}.csv"}}\n'
    for file, columns in FILES.items()
    for name, (column, unit) in columns.items()
)
SKYWALKER = """
format = "stoop-vehicle/1"
name = "Skywalker"
mass = { mass = 2.47, inertia = { xx = 0.110, yy = 0.2, zz = 0.258 } }
reference = { area = 0.39, chord = 0.22, span = 1.8, airspeed = 14.0 }
environment = { density = 1.2 }
propulsion = { kind = "channel" }
controls = { elevator = {}, aileron = {}, rudder = {} }
"""
A430 = """
format = "stoop-vehicle/1"
name = "A430"
mass = { mass = 0.1, inertia = { xx = 0.00400, yy = 0.00732, zz = 0.01093, xz = 0.00014 } }
reference = { area = 0.040809, chord = 0.09781, span = 0.43, airspeed = 6.0 }
environment = { density = 1.2 }
controls = { elevator = {}, aileron = {} }
"""


def mapped(log: Path, folder: Path, text: str) -> Flight:
    (folder / "m.toml").write_text(text)
    return load(log, folder / "m.toml")


def test_channels_and_windows_of_the_v_tail(vtail_flight: Flight, shared_data: Path, tmp_path: Path) -> None:
    flight = vtail_flight
    wanted = {*OUTPUTS, *CONTROLS, *(f"pwm_{n}" for n in range(1, 6)), "vn", "ve", "vd", "pn", "pe", "pd"}
    wanted |= {"airspeed_pitot", "wind_n", "wind_e", "altitude", "density", "temperature", "voltage", "q0"}
    assert wanted <= set(flight.data.data_vars)
    assert (flight.name, flight.rate) == ("flight2", 100.0)
    assert 68.0 < flight.time[0] < 69.0
    stream = read(shared_data / "altlnt-vtail-8kg-px4" / "flight2").streams["vehicle_angular_velocity"]
    taken = stream.columns["timestamp_sample"] * 1e-6
    window = (taken > 160.0) & (taken < 168.0)
    recorded = stream.columns["xyz[0]"][window]
    grid = np.interp(taken[window], flight.time, flight.column("p"))
    assert np.corrcoef(grid, recorded)[0, 1] > 0.98
    assert abs(np.mean(grid - recorded)) < 1e-3
    for start, stop, told, spans in (
        (140.0, 145.0, 2, [(140.14, 142.46), (142.76, 144.99)]), (146.0, 152.0, 1, [(146.08, 152.0)]),
        (160.0, 168.3, 0, [(160.0, 168.3)]), (187.0, 196.0, 0, [(187.0, 196.0)]),
    ):  # fmt: skip
        found, notes = segments(flight, start, stop, CONTROLS, OUTPUTS)
        assert [(round(float(s.t[0]), 2), round(float(s.t[-1]), 2)) for s in found] == spans
        assert all(np.isfinite(s.u).all() for s in found)
        assert np.mean([np.isfinite(s.z).mean() for s in found]) > 0.95
        assert len(notes) == told
    save(flight, tmp_path / "flight2.nc")
    back = load(tmp_path / "flight2.nc")
    assert back.data.identical(flight.data)
    for name in ("air", "sources", "notices", "faults"):
        assert getattr(back, name) == getattr(flight, name)


def test_motion_capture_in_degrees(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "a430-micro-fixedwing-mocap"
    for log in sorted(folder.glob("*.csv"))[::3]:
        assert np.nanmax(np.abs(mapped(log, tmp_path, A430_MAPPING).column("theta"))) < 1.6
        for wrong in ("deg/s", "deg"):
            with pytest.raises(FlightError, match=r"degrees|deg/s where radians belong"):
                mapped(log, tmp_path, A430_MAPPING.replace(f'"{wrong}"', f'"{wrong.replace("deg", "rad")}"'))
    dirty = mapped(folder / "short_straight_4_20230215_133852.csv", tmp_path, A430_MAPPING)
    kinds = {(fault.kind, fault.variable) for fault in dirty.faults}
    assert {("clipped", n) for n in "pqr"} | {("stuck", "V"), ("stuck", "psi")} <= kinds
    assert {name for kind, name in kinds if kind == "inconsistent"} == {*"pqr"}
    clipped = next(fault for fault in dirty.faults if fault.variable == "p")
    assert abs(clipped.value) == pytest.approx(2.0, abs=1e-3), "clipped to either side"


def test_a_clipped_rate_counts_as_not_measured_and_is_said(shared_data: Path, tmp_path: Path) -> None:
    log = shared_data / "a430-micro-fixedwing-mocap" / "short_loop_6_20230227_120302.csv"
    job = identify(parse_vehicle(A430, "a430"), mapped(log, tmp_path, A430_MAPPING), ["3:6"], options=BUDGET)
    words = " ".join(job.result.warnings)
    assert "treated as not measured" in words
    assert "the attitude turns 1.20 times as fast as p indicates" in words
    assert "implausibly large" in words
    used = job.flights[0].column("q")
    assert np.nanmax(used) < 1.995
    assert np.isnan(used).any()


def test_ten_hertz_without_air_data_is_said_and_not_invented(shared_data: Path, tmp_path: Path) -> None:
    log = shared_data / "stanford-skywalker-10hz"
    flight = mapped(log, tmp_path, STANFORD_MAPPING)
    assert not {"V", "alpha", "beta"} & set(flight.data.data_vars)
    assert {"no-air-data", "slow-rates"} <= {found.code for found in flight.notices}
    assert "logged at only 10.2 Hz" in " ".join(map(str, flight.notices))
    _, notices = segments(flight, 60.0, 80.0, ("aileron", "thrust"), OUTPUTS)
    assert "slow-input" in {found.code for found in notices}
    result = identify(parse_vehicle(SKYWALKER, "skywalker"), flight, ["121.3:128.7"], options=BUDGET).result
    words = " ".join(result.warnings)
    assert "No airspeed was measured" in words
    assert "Too few samples" in words
    assert not [p for p in result.parameters.values() if p.identifiable], "306 measurements for 80 unknowns"
    told = r"phi changes 59\.4 times .*; write unit = \"rad/s\" for variables\.p, "
    with pytest.raises(FlightError, match=told):
        mapped(log, tmp_path, STANFORD_MAPPING.replace('"rad/s"', '"deg/s"'))


def test_a_window_without_excitation_is_said(vtail_flight: Flight) -> None:
    vehicle = load_vehicle(simulated.EXAMPLE)
    with pytest.raises(FlightError, match="choose another window"):
        identify(vehicle, vtail_flight, ["145:145.4"], options=BUDGET)
    result = identify(vehicle, vtail_flight, ["115:118"], options=BUDGET).result
    doubted = [str(n) for n in result.notices if n.code in ("control-still", "contribution-in-doubt")]
    assert any("rudder" in text for text in doubted)
    assert result.verdict.grade == "do not use"
    told = {name: p for name, p in result.parameters.items() if p.identifiable}
    known = {name for name, p in told.items() if p.std_error < 0.5 * abs(p.estimate)}
    assert known <= {"Cm0", "Cn0", "propulsion.CT0"}, "at most what balances steady flight"
    for name, published in (("Cm0", -0.036), ("Cn0", 0.0)):  # docs/vehicle-new.md, docs/handbook.md
        assert name not in told or told[name].ci95_lower < published < told[name].ci95_upper


def test_signs_and_faults_of_the_v_tail(vtail_flight: Flight) -> None:
    data = {str(name): vtail_flight.column(str(name)) for name in vtail_flight.data.data_vars}
    turned, swapped = {**data, "q": -data["q"]}, {**data, "p": data["q"], "q": data["p"]}
    assert check_rates(data, vtail_flight.rate, {}) == []
    for columns, codes in ((data, []), (turned, ["mapping-sign"]), (swapped, ["mapping-exchange"])):
        found = check_mapping({}, columns, vtail_flight.rate, {}).notices
        assert [one.code for one in found] == codes
    fault = Fault("stuck", "r", 0.0, 150.0, 152.0, "r stands still")
    blanked = without_faults(dataclasses.replace(vtail_flight, faults=(*vtail_flight.faults, fault)))
    inside = (vtail_flight.time >= 150.0) & (vtail_flight.time <= 152.0)
    assert np.isnan(blanked.column("r")[inside]).all()
    assert np.array_equal(blanked.column("r")[~inside], data["r"][~inside], equal_nan=True)
