"""Flights that cannot tell what is asked: stoop says so in words, and its error bars are wide."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from stoop.checks.kinematics import check_rates
from stoop.checks.mapping import check_mapping
from stoop.checks.vehicle import inertia_notices
from stoop.errors import FlightError
from stoop.estimate.fit import Options
from stoop.flight import Flight, load
from stoop.vehicle.load import parse_vehicle
from stoop.workflow import identify
from stoop.workflow.fitted_model import FittedModel

BUDGET = Options(budget=400.0)

STANFORD_MAPPING = """
[time]
column = "t_s"
unit = "s"
[variables]
p = {column = "p_rps", unit = "rad/s", file = "plane_bodyrate.csv"}
q = {column = "q_rps", unit = "rad/s", file = "plane_bodyrate.csv"}
r = {column = "r_rps", unit = "rad/s", file = "plane_bodyrate.csv"}
phi = {column = "phi_rad", unit = "rad", file = "plane_euler.csv"}
theta = {column = "theta_rad", unit = "rad", file = "plane_euler.csv"}
psi = {column = "psi_rad", unit = "rad", file = "plane_euler.csv"}
aileron = {column = "aileron", unit = "1", file = "plane_actuators.csv"}
elevator = {column = "elevator", unit = "1", file = "plane_actuators.csv"}
rudder = {column = "rudder", unit = "1", file = "plane_actuators.csv"}
thrust = {column = "thrust_N", unit = "N", file = "plane_actuators.csv"}
"""
SKYWALKER = """
format = "stoop-vehicle/1"
name = "Skywalker"
[mass]
mass = 2.47
[mass.inertia]
xx = 0.110
yy = {yy}
zz = 0.258
[reference]
area = 0.39
chord = 0.22
span = 1.8
airspeed = 14.0
[environment]
density = 1.2
[propulsion]
kind = "channel"
[controls.elevator]
[controls.aileron]
[controls.rudder]
"""
A430_MAPPING = """
[time]
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
A430 = """
format = "stoop-vehicle/1"
name = "A430"
[mass]
mass = 0.1
[mass.inertia]
xx = 0.00400
yy = 0.00732
zz = 0.01093
xz = 0.00014
[reference]
area = 0.040809
chord = 0.09781
span = 0.43
airspeed = 6.0
[environment]
density = 1.2
[controls.elevator]
[controls.aileron]
"""


@pytest.fixture(scope="module")
def stanford(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Flight:
    mapping = tmp_path_factory.mktemp("maps") / "stanford.toml"
    mapping.write_text(STANFORD_MAPPING)
    return load(shared_data / "stanford-skywalker-10hz", mapping)


@pytest.fixture(scope="module")
def slow(stanford: Flight) -> FittedModel:
    return identify(
        parse_vehicle(SKYWALKER.replace("{yy}", "0.2"), "skywalker"),
        stanford,
        ["121.3:128.7"],
        options=BUDGET,
    )


def test_ten_hertz_without_air_data_is_said_before_anything_is_fitted(stanford: Flight) -> None:
    notes = " ".join(map(str, stanford.notices))
    assert "logged at only 10.2 Hz" in notes
    assert "no air data" in notes


def test_ten_hertz_without_air_data_is_not_invented(slow: FittedModel) -> None:
    result = slow.result
    words = " ".join(result.warnings)
    assert "No airspeed was measured" in words
    assert "Too few samples" in words
    told = [p for p in result.parameters.values() if p.identifiable]
    assert not told, "306 measurements for 80 unknowns"


def test_an_inertia_that_no_body_has_is_refused() -> None:
    """The moment about y that the swing tests give, 0.36, is larger than that about z; 0.5 breaks the triangle."""
    from stoop.errors import VehicleError

    with pytest.raises(VehicleError, match="which no body can have"):
        parse_vehicle(SKYWALKER.replace("{yy}", "0.5"), "skywalker")


def a430(shared_data: Path, name: str, folder: Path) -> Flight:
    mapping = folder / "a430.toml"
    mapping.write_text(A430_MAPPING)
    return load(shared_data / "a430-micro-fixedwing-mocap" / f"{name}.csv", mapping)


def test_inertia_ten_times_too_large_is_challenged() -> None:
    found = inertia_notices(parse_vehicle(A430, "a430"))
    assert [one.subject for one in found] == [f"mass.inertia.{axis}" for axis in ("xx", "yy", "zz")]
    assert {one.code for one in found} == {"inertia-large"}
    tenth = A430.replace("0.00400", "0.0004").replace("0.00732", "0.000732").replace("0.01093", "0.001093")
    assert not inertia_notices(parse_vehicle(tenth.replace("0.00014", "0.0"), "a430"))


def test_rates_that_stop_at_one_number_are_clipped_and_the_attitude_disagrees(
    shared_data: Path, tmp_path: Path
) -> None:
    flight = a430(shared_data, "short_straight_4_20230215_133852", tmp_path)
    clipped = {fault.variable for fault in flight.faults if fault.kind == "clipped"}
    assert clipped == {"p", "q", "r"}
    assert {f.variable for f in flight.faults if f.kind == "inconsistent"} == {"p", "q", "r"}


def test_a_clipped_rate_counts_as_not_measured_and_is_said(shared_data: Path, tmp_path: Path) -> None:
    flight = a430(shared_data, "short_loop_6_20230227_120302", tmp_path)
    job = identify(parse_vehicle(A430, "a430"), flight, ["3:6"], options=BUDGET)
    words = " ".join(job.result.warnings)
    assert "treated as not measured" in words
    assert "the attitude turns 1.20 times as fast as p indicates" in words
    assert "implausibly large" in words
    used = job.flights[0].column("q")
    assert np.nanmax(used) < 1.995
    assert np.isnan(used).any()


def test_a_window_without_excitation_is_said(shared_data: Path) -> None:
    from stoop.vehicle import load_vehicle

    vehicle = load_vehicle(Path(__file__).parents[2] / "examples" / "vtail.toml")
    job = identify(vehicle, shared_data / "altlnt-vtail-8kg-px4" / "flight2", ["115:118"], options=BUDGET)
    result = job.result
    doubted = [str(n) for n in result.notices if n.code in ("control-still", "contribution-in-doubt")]
    assert any("rudder" in text for text in doubted)
    assert result.verdict.grade == "do not use"
    told = {name: p for name, p in result.parameters.items() if p.identifiable}
    known = {name for name, p in told.items() if p.std_error < 0.5 * abs(p.estimate)}
    assert known <= {"Cm0", "Cn0", "propulsion.CT0"}, "at most what balances steady flight"
    for name, published in (("Cm0", -0.036), ("Cn0", 0.0)):  # docs/vehicle-new.md, docs/handbook.md
        assert name not in told or told[name].ci95_lower < published < told[name].ci95_upper


def test_a_window_with_next_to_no_samples_is_refused(shared_data: Path) -> None:
    from stoop.vehicle import load_vehicle

    vehicle = load_vehicle(Path(__file__).parents[2] / "examples" / "vtail.toml")
    flight = load(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    with pytest.raises(FlightError, match="choose another window"):
        identify(vehicle, flight, ["145:145.4"], options=BUDGET)


def test_a_sign_or_an_axis_of_the_rates_is_found(shared_data: Path) -> None:
    flight = load(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    data = {str(name): flight.column(str(name)) for name in flight.data.data_vars}
    assert check_mapping({}, data, flight.rate, {}).notices == ()
    assert check_rates(data, flight.rate, {}) == []
    (turned,) = check_mapping({}, {**data, "q": -data["q"]}, flight.rate, {}).notices
    assert (turned.code, turned.subject) == ("mapping-sign", "q")
    (swapped,) = check_mapping({}, {**data, "p": data["q"], "q": data["p"]}, flight.rate, {}).notices
    assert (swapped.code, swapped.values["lines"]) == ("mapping-exchange", ("p", "q"))


def test_a_stuck_sensor_counts_as_not_measured(shared_data: Path) -> None:
    from stoop.flight import without_faults
    from stoop.flight.faults import Fault

    flight = load(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    fault = Fault("stuck", "r", 0.0, 150.0, 152.0, "r stands still")
    blanked = without_faults(dataclasses.replace(flight, faults=(*flight.faults, fault)))
    inside = (flight.time >= 150.0) & (flight.time <= 152.0)
    assert np.isnan(blanked.column("r")[inside]).all()
    assert np.array_equal(blanked.column("r")[~inside], flight.column("r")[~inside], equal_nan=True)
