"""Real flights: channels, windows, faults, unfit logs that must warn, and fits that must not be trusted."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from real import simulated

from stoop.errors import FlightError
from stoop.estimate.fit import Options
from stoop.flight import OUTPUTS, Flight, load_flight, segments
from stoop.flight.faults import Fault
from stoop.flight.flight import AirData
from stoop.logs import read
from stoop.reconstruction.compatibility import Compatibility, corrected_flight
from stoop.vehicle import load_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop.workflow import fit
from stoop.workflow.reconstruction import write_compatibility
from stoop_draft.checks.kinematics import check_rates
from stoop_draft.checks.mapping import check_mapping
from stoop_plan.input_design.windows import find_windows

BUDGET = Options(budget=400.0)
CONTROLS = ("control_roll", "control_pitch", "control_yaw", "control_throttle")
ANGLES = ("alpha", "beta", "phi", "theta", "psi")
A430_MAPPING = """
time = { column = "Systime", unit = "s" }
[variables]
V = { column = "vt", unit = "m/s" }
elevator = { column = "de", unit = "deg" }
aileron = { column = "da", unit = "deg" }
""" + "".join(
    f'{n} = {{ column = "{n}", unit = "{"deg/s" if n in "pqr" else "deg"}" }}\n' for n in (*ANGLES, *"pqr")
)
FILES = {
    "euler": {"phi": ("phi_rad", "rad"), "theta": ("theta_rad", "rad"), "psi": ("psi_rad", "rad")},
    "bodyrate": {n: (f"{n}_rps", "rad/s") for n in "pqr"},
    "actuators": {**{n: (n, "1") for n in ("aileron", "elevator", "rudder")}, "thrust": ("thrust_N", "N")},
}  # fmt: skip
STANFORD_MAPPING = 'time = {column = "t_s", unit = "s"}\n[variables]\n'
for file, columns in FILES.items():
    for name, (column, unit) in columns.items():
        STANFORD_MAPPING += f'{name} = {{column = "{column}", unit = "{unit}", file = "plane_{file}.csv"}}\n'
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
    return load_flight(log, folder / "m.toml")


def test_channels_and_windows_of_the_v_tail(vtail_flight: Flight, shared_data: Path) -> None:
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
    job = fit(parse_vehicle(A430, "a430"), mapped(log, tmp_path, A430_MAPPING), ["3:6"], options=BUDGET)
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
    result = fit(parse_vehicle(SKYWALKER, "skywalker"), flight, ["121.3:128.7"], options=BUDGET).result
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
        fit(vehicle, vtail_flight, ["145:145.4"], options=BUDGET)
    result = fit(vehicle, vtail_flight, ["115:118"], options=BUDGET).result
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
    blanked = dataclasses.replace(vtail_flight, faults=(*vtail_flight.faults, fault)).without_faults()
    inside = (vtail_flight.time >= 150.0) & (vtail_flight.time <= 152.0)
    assert np.isnan(blanked.column("r")[inside]).all()
    assert np.array_equal(blanked.column("r")[~inside], data["r"][~inside], equal_nan=True)


def codes(flight: AirData | Compatibility) -> set[str]:
    return {found.code for found in flight.notices}


def air_of(flight: Flight) -> AirData:
    return flight.air  # type: ignore[return-value]


def check_pitot_and_wind(flight: Flight, low: tuple[float, float], wind: tuple[float, float]) -> None:
    """Check that the pitot is found to read low at 24 m/s by so much, and the wind, confirmed by the sideslip."""
    air = air_of(flight)
    assert air.rest_offset == pytest.approx(-3.0, abs=0.1)
    assert low[0] < 24.0 - (24.0 / air.pitot_scale + air.pitot_offset) < low[1]
    assert {"pitot-pressure-offset", "pitot-offset-inconsistent", "sideslip-wind-agrees"} <= codes(air)
    assert air.method == "pitot"
    assert np.hypot(air.wind_n - wind[0], air.wind_e - wind[1]) < 0.6
    assert max(air.wind_n_std, air.wind_e_std) < 0.3
    assert np.max(np.abs(air.accelerometer_bias)) < 0.2
    assert abs(np.degrees(air.heading_error)) < 2.0
    (fault,) = flight.faults
    assert (fault.kind, fault.variable) == ("offset at rest", "airspeed_pitot")
    assert fault.value == pytest.approx(-3.0, abs=0.1)


def check_windows(flight: Flight, flown: tuple[tuple[float, float], ...]) -> None:
    kept = [w for w in find_windows({flight.name: flight}).windows if w.accept]
    assert [w.axis for w in kept] == ["roll", "pitch", "yaw", "roll"]
    for window, (start, stop) in zip(kept, flown, strict=True):
        assert window.start == pytest.approx(start, abs=0.7)
        assert window.stop == pytest.approx(stop, abs=0.7)
    assert [w.axis for w in kept if w.use == "validate"] == ["roll"], "the axis that was flown twice"


def check_kinematics(flight: Flight, spans: list[tuple[float, float]], folder: Path) -> Compatibility:
    """Check the pitot, the wind and the navigation by kinematics alone, and a turned sign; the corrected flight is read again."""
    result, found = Compatibility.of(flight, spans)
    corrected = corrected_flight(found)
    air = air_of(flight)
    for axis, whole in (("n", air.wind_n), ("e", air.wind_e)):
        one = result.findings[f"wind.{axis}"]
        assert one.estimate == pytest.approx(whole, abs=4.0 * one.std_error)
    assert "winds-agree" in codes(result)
    assert not any("inconsistent" in code for code in codes(result))
    for name, limit in (("phi", 0.02), ("theta", 0.02), ("vn", 0.3), ("ve", 0.3), ("vd", 0.3)):
        assert result.channels[name].rms < min(limit, 0.2 * result.channels[name].movement)
    write_compatibility(result, flight, corrected, folder, "stoop compatibility")
    again = load_flight(folder / "flight.nc")
    assert 24.0 / air_of(again).pitot_scale + air_of(again).pitot_offset == pytest.approx(24.0, abs=1.0)
    for name in ("p", "phi", "ax", "V"):
        assert np.array_equal(again.column(name), corrected.column(name), equal_nan=True)
    assert "<h1>Data compatibility" in (folder / "compatibility.html").read_text()
    wrong = flight.data.assign(q=("time", -flight.column("q")))
    turned, _ = Compatibility.of(dataclasses.replace(flight, data=wrong), spans[:1])
    assert "attitude-inconsistent" in codes(turned)
    return result


def low_at_24(result: Compatibility) -> float:
    found = result.findings
    return 24.0 - found["airspeed_pitot.scale"].estimate * 24.0 - found["airspeed_pitot.bias"].estimate


def check_simulated_log(flight: Flight) -> None:
    low = 24.0 * (1.0 - simulated.SCALE) - simulated.OFFSET
    check_pitot_and_wind(flight, (low - 0.5, low + 0.5), simulated.WIND)
    check_windows(flight, ((146.6, 149.0), (152.4, 156.0), (159.4, 162.5), (167.5, 170.0)))
    hole = (flight.time > simulated.LOST[0][0]) & (flight.time < simulated.LOST[0][1])
    assert np.isnan(flight.column("beta")[hole]).all()
    assert any(found.values.get("kind") == "dropout" for found in flight.notices)


def test_compatibility_of_a_simulated_log(simulated_flight: Flight, tmp_path: Path) -> None:
    result = check_kinematics(simulated_flight, [(146.5, 158.0), (159.5, 166.0)], tmp_path)
    low = 24.0 * (1.0 - simulated.SCALE) - simulated.OFFSET
    assert low_at_24(result) == pytest.approx(low, abs=0.7)
    for name, truth in zip(("wind.n", "wind.e", "attitude.delay"), (*simulated.WIND, 0.0), strict=True):
        found = result.findings[name]
        assert abs(found.estimate - truth) < 4.0 * found.std_error, name


def test_pitot_and_wind_of_the_v_tail(vtail_flight: Flight) -> None:
    """Its pitot reads -3 m/s at rest and 5 to 6 m/s low in flight (SOURCE.md)."""
    check_pitot_and_wind(vtail_flight, (5.0, 6.0), (-1.2, -3.2))
    assert abs(air_of(vtail_flight).velocity_delay) < 0.005
    found = [(m.axis, round(m.start), round(m.stop)) for m in vtail_flight.find_maneuvers()]
    small = ("pitch", 160, 162)  # a quarter of the size of the other one
    assert found == [("roll", 140, 146), ("pitch", 146, 152), small, ("yaw", 162, 169), ("roll", 188, 195)]
    flown = ((140.5, 145.0), (146.0, 151.5), (161.6, 168.3), (188.1, 195.1))  # docs/vtail.md
    check_windows(vtail_flight, flown)


def test_forces_of_the_v_tail_are_straight_lines(vtail_flight: Flight) -> None:
    """In sideslip in the roll doublet, in angle of attack in the pitch doublet; beta holds only the integral of a_y."""
    columns = np.column_stack([vtail_flight.column(name) for name in ("ay", "beta", "az", "alpha", "V")])
    time, whole = vtail_flight.time, np.isfinite(columns).all(axis=1)
    side, beta, _, _, V = columns[whole & (time >= 140.0) & (time <= 145.0)].T
    assert np.corrcoef(side / V**2, beta)[0, 1] < -0.98
    assert -0.7 < np.polyfit(beta, 2.0 * 8.5 * side / (1.17 * V**2 * 0.66), 1)[0] < -0.45
    _, _, normal, alpha, V = columns[whole & (time >= 146.0) & (time <= 152.0)].T
    assert np.corrcoef(-normal / V**2, alpha)[0, 1] > 0.97


def test_compatibility_of_the_v_tail(vtail_flight: Flight, tmp_path: Path) -> None:
    spans = [(140.0, 152.0), (156.0, 172.0), (186.0, 200.0)]
    assert 4.5 < low_at_24(check_kinematics(vtail_flight, spans, tmp_path)) < 6.5


def test_a_healthy_pitot_is_left_healthy(shared_data: Path) -> None:
    """Solar Surfer: another airplane, another autopilot version, published as usable."""
    air = air_of(load_flight(shared_data / "mit-solar-surfer-px4csv"))
    assert air.method == "pitot"
    assert abs(air.pitot_scale - 1.0) < 2.5 * air.pitot_scale_std
    assert abs(air.pitot_offset) < 2.5 * air.pitot_offset_std
    assert "sideslip-wind-agrees" in codes(air)
