"""A mapping judged as a whole: simulated flights in wind, after ground time in which the estimator holds zeros."""

from __future__ import annotations

import functools
import tomllib
from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE, FOOT, KNOT
from stoop.flight import load
from stoop.flight.mapping_corrections import corrected_mapping
from stoop.flight.mapping_draft import draft
from stoop_studies.verify.lines import (
    Mangled,
    accusations,
    flown,
    lost,
    mapping_of,
    mapping_text,
    misread,
    save,
    swap,
    times,
    turned,
    verdict,
    write_log,
)

SEED = 2000


@functools.cache
def aircraft() -> tuple[FloatArray, dict[str, FloatArray]]:
    time, columns = flown(SEED, True)
    return time, {name: x for name, x in columns.items() if name != "pd"}


def logged(folder: Path, mangled: Mangled, without: tuple[str, ...] = ()) -> tuple[Path, Path]:
    time, truth = aircraft()
    columns = {name: x for name, x in mangled.apply(truth).items() if name not in without}
    path, places = write_log(folder, "CSV", time, columns)
    mapping = folder / "m.toml"
    mapping.write_text(mapping_text("CSV", places))
    return path, mapping


def test_a_right_mapping_has_no_fault_whatever_the_estimator_held_before_take_off(tmp_path: Path) -> None:
    assert load(*logged(tmp_path, times("right", 1.0))).faults == ()


@pytest.mark.parametrize(
    "mangled",
    [
        lost("vd"), swap("vn", "ve"), times("theta in degrees", 1.0 / DEGREE, "theta"), lost("elevator"),
        times("pitot low", 0.8, "V"), times("knots", 1.0 / KNOT, "V"), times("alpha in degrees", 1.0 / DEGREE, "alpha"),
        lost("beta"), times("q declared deg/s", DEGREE, "q"), swap("elevator", "rudder"),
    ],
    ids=lambda mangled: mangled.words,
)  # fmt: skip
def test_the_wrong_line_alone_is_named(tmp_path: Path, mangled: Mangled) -> None:
    assert verdict(accusations(*logged(tmp_path, mangled)), mangled.lines) == "named"


@pytest.mark.parametrize(
    "mangled",
    [
        times("vn and ve in knots", 1.0 / KNOT, "vn", "ve"), times("speeds in knots", 1.0 / KNOT, "vn", "ve", "vd", "V"),
        times("rates 10 % high", 1.1, "p", "q", "r"), times("rates 10 % low", 0.9, "p", "q", "r"),
    ],
    ids=lambda mangled: mangled.words,
)  # fmt: skip
def test_lines_that_are_wrong_together_are_named_together(tmp_path: Path, mangled: Mangled) -> None:
    ((said,),) = accusations(*logged(tmp_path, mangled))
    assert set(said) == set(mangled.lines)


def test_rates_that_the_attitude_follows_within_calibration_are_not_accused(tmp_path: Path) -> None:
    assert accusations(*logged(tmp_path, times("rates 2 % high", 1.02, "p", "q", "r"))) == []


@pytest.mark.parametrize("without", [(), ("ax", "ay", "az", "pn", "pe", "alpha", "beta")])
def test_speeds_over_ground_in_knots_do_not_accuse_the_airspeed(
    tmp_path: Path, without: tuple[str, ...]
) -> None:
    mangled = times("vn and ve in knots", 1.0 / KNOT, "vn", "ve")
    path, mapping = logged(tmp_path, mangled, without)
    assert verdict(accusations(path, mapping), mangled.lines) == "named"
    made = corrected_mapping(path, mapping)
    assert misread(path, made.text, aircraft()[1], ("vn", "ve", "vd", "V")) == []


def test_a_heading_in_degrees_beside_rates_in_degrees_is_no_radian(tmp_path: Path) -> None:
    time, truth = aircraft()
    names = ("psi", "p", "q", "r")
    kept = {n: x for n, x in truth.items() if n not in ("phi", "theta")}
    written = {**kept, **{n: truth[n] / DEGREE for n in names}}
    written["psi"] %= 360.0
    path, places = write_log(tmp_path, "MATLAB", time, written)
    mapping = tmp_path / "m.toml"
    mapping.write_text(mapping_text("MATLAB", places))
    made = corrected_mapping(path, mapping)
    units = {name: line["unit"] for name, line in tomllib.loads(made.text)["variables"].items()}
    assert [units[n] for n in names] == ["deg", "deg/s", "deg/s", "deg/s"]
    assert made.left == ()


@pytest.mark.parametrize(
    ("declared", "right", "mangled"),
    [
        ("rad", "deg", times("theta in degrees", 1.0 / DEGREE, "theta")),
        ("deg", "rad", times("an attitude in radians, declared deg", 1.0, "phi", "theta", "psi")),
    ],
    ids=["theta in degrees", "in radians, declared deg"],
)
def test_angles_of_circles_are_read_right_by_the_advice(
    tmp_path: Path, declared: str, right: str, mangled: Mangled
) -> None:
    """The grid, slower than the log, filters turns of another size, and angles that theta turned over."""
    time = np.arange(0.0, 60.0, 1.0 / 200.0)
    phi, theta, psi = 0.4 + 0.2 * np.sin(1.3 * time), 0.1 + 0.15 * np.sin(0.9 * time), 0.6 * time
    phi_dot, theta_dot, psi_dot = (np.gradient(x, time) for x in (phi, theta, psi))
    true = {
        "p": phi_dot - psi_dot * np.sin(theta),
        "q": theta_dot * np.cos(phi) + psi_dot * np.cos(theta) * np.sin(phi),
        "r": psi_dot * np.cos(theta) * np.cos(phi) - theta_dot * np.sin(phi),
        "phi": phi, "theta": theta, "psi": np.angle(np.exp(1j * psi)),
    }  # fmt: skip
    path = save({"t": time, **mangled.apply(true)}, tmp_path, "csv")
    units = {n: "rad/s" if n in "pqr" else declared for n in true}
    mapping = tmp_path / "m.toml"
    mapping.write_text(mapping_of(("t", "s"), {n: (n, unit) for n, unit in units.items()}))
    made = corrected_mapping(path, mapping)
    found = {n: line["unit"] for n, line in tomllib.loads(made.text)["variables"].items()}
    assert found == units | dict.fromkeys(mangled.lines, right)
    assert made.left == ()


def test_of_two_advices_the_changes_that_both_make_are_applied(tmp_path: Path) -> None:
    """Small deflections may be in degrees or in radians, and a large one beside them is in degrees whatever they are."""
    time, truth = aircraft()
    wrong = times("elevator in degrees", 1.0 / DEGREE, "elevator").apply(truth)
    path, places = write_log(tmp_path, "PX4", time, wrong)
    mapping = tmp_path / "m.toml"
    mapping.write_text(mapping_text("PX4", places))
    made = corrected_mapping(path, mapping)
    (applied,) = made.applied
    assert len(applied.values["alternatives"]) == 2
    assert misread(path, made.text, truth, ("elevator", "aileron", "rudder")) == []


def test_feet_and_feet_per_minute_are_drafted_together(tmp_path: Path) -> None:
    time, truth = aircraft()
    columns = {
        **{n: truth[n] for n in ("p", "q", "r", "phi", "theta", "psi", "V")},
        "alt": truth["altitude"] / FOOT, "climb": -truth["vd"] / FOOT * 60.0,
    }  # fmt: skip
    path = tmp_path / "log.csv"
    table = np.column_stack([time, *columns.values()])
    np.savetxt(path, table, "%.9g", ",", header=",".join(["t_s", *columns]), comments="")
    lines = tomllib.loads(draft(path).text)["variables"]
    assert (lines["altitude"]["unit"], lines["vd"]["unit"]) == ("ft", "ft/min")


def test_axes_of_east_north_up_are_drafted_whole(tmp_path: Path) -> None:
    time, truth = aircraft()
    every = ("q", "r", "ay", "az", "theta", "psi", "vn", "ve", "vd", "pn", "pe")
    path, places = write_log(tmp_path, "MATLAB", time, turned("flu in enu", *every, east=True).apply(truth))
    made = draft(path)
    assert misread(path, made.text, truth, every) == []
    lines = tomllib.loads(made.text)["variables"]
    assert (lines["vn"]["column"], lines["ve"]["column"]) == (places["ve"][0], places["vn"][0])


def test_a_heading_is_the_column_that_turns_as_its_rate_does(tmp_path: Path) -> None:
    time, truth = aircraft()
    course = np.roll(truth["psi"], 400)
    columns = {
        **{n: truth[n] for n in ("p", "q", "r", "phi", "theta", "vn", "ve", "vd")},
        "yaw_vane": truth["beta"], "yaw_old": course, "heading": truth["psi"],
    }  # fmt: skip
    path = tmp_path / "log.csv"
    table = np.column_stack([time, *columns.values()])
    np.savetxt(path, table, "%.9g", ",", header=",".join(["t_s", *columns]), comments="")
    lines = tomllib.loads(draft(path).text)["variables"]
    assert (lines["psi"]["column"], lines["beta"]["column"]) == ("heading", "yaw_vane")


def test_without_velocity_over_ground_forces_tell_of_the_airspeed(tmp_path: Path) -> None:
    knots = times("knots", 1.0 / KNOT, "V")
    place = logged(tmp_path, knots, ("vn", "ve", "vd", "pn", "pe", "altitude"))
    assert verdict(accusations(*place), knots.lines) == "named"


def test_a_pitot_beside_vanes_is_the_airspeed(tmp_path: Path) -> None:
    path, mapping = logged(tmp_path, times("right", 1.0))
    mapping.write_text(mapping.read_text().replace("V = {", "airspeed_pitot = {"))
    flight = load(path, mapping)
    np.testing.assert_array_equal(flight.column("V"), flight.column("airspeed_pitot"))
    assert "airspeed-of-pitot" in {one.code for one in flight.notices}
