"""A mapping judged as a whole: simulated flights in wind, after ground time in which the estimator holds zeros."""

from __future__ import annotations

import functools
import tomllib
from pathlib import Path

import numpy as np
import pytest
from unit.flight.made_logs import csv_log

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
    mapping_text,
    misread,
    swap,
    times,
    turned,
    verdict,
    write_log,
)


@functools.cache
def aircraft() -> tuple[FloatArray, dict[str, FloatArray]]:
    time, columns = flown(2000, True)
    return time, {name: x for name, x in columns.items() if name != "pd"}


def logged(folder: Path, mangled: Mangled, without: tuple[str, ...] = ()) -> tuple[Path, Path]:
    time, truth = aircraft()
    columns = {name: x for name, x in mangled.apply(truth).items() if name not in without}
    path, places = write_log(folder, "CSV", time, columns)
    mapping = folder / "m.toml"
    mapping.write_text(mapping_text("CSV", places))
    return path, mapping


def test_a_right_mapping_has_no_fault_whatever_the_estimator_held_before_take_off(tmp_path: Path) -> None:
    path, mapping = logged(tmp_path, times("right", 1.0))
    assert load(path, mapping).faults == ()
    made = corrected_mapping(path, mapping)
    assert (made.text, made.applied, made.left) == (mapping.read_text(), (), ())
    mapping.write_text(mapping.read_text().replace("V = {", "airspeed_pitot = {"))
    flight = load(path, mapping)  # a pitot beside vanes is the airspeed
    np.testing.assert_array_equal(flight.column("V"), flight.column("airspeed_pitot"))
    assert "airspeed-of-pitot" in {one.code for one in flight.notices}
    rates = times("rates 2 % high", 1.02, "p", "q", "r")  # which the attitude follows within calibration
    assert accusations(*logged(tmp_path, rates)) == []


@pytest.mark.parametrize(
    "mangled",
    [
        lost("vd"), swap("vn", "ve"), times("theta in degrees", 1.0 / DEGREE, "theta"), lost("elevator"),
        times("pitot low", 0.8, "V"), times("knots", 1.0 / KNOT, "V"), times("alpha in degrees", 1.0 / DEGREE, "alpha"),
        lost("beta"), times("q declared deg/s", DEGREE, "q"), swap("elevator", "rudder"),
    ],
    ids=lambda mangled: mangled.words,
)  # fmt: skip
def test_any_wrong_line_alone_is_named(tmp_path: Path, mangled: Mangled) -> None:
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


def test_feet_a_minute_and_a_heading_are_drafted(tmp_path: Path) -> None:
    """A heading is the column that turns as its rate does."""
    time, truth = aircraft()
    columns = {
        "t_s": time, **{n: truth[n] for n in ("p", "q", "r", "phi", "theta", "vn", "ve", "V")},
        "alt": truth["altitude"] / FOOT, "climb": -truth["vd"] / FOOT * 60.0,
        "yaw_vane": truth["beta"], "yaw_old": np.roll(truth["psi"], 400), "heading": truth["psi"],
    }  # fmt: skip
    lines = tomllib.loads(draft(csv_log(tmp_path / "log.csv", columns)).text)["variables"]
    assert (lines["altitude"]["unit"], lines["vd"]["unit"]) == ("ft", "ft/min")
    assert (lines["psi"]["column"], lines["beta"]["column"]) == ("heading", "yaw_vane")


def test_axes_of_east_north_up_are_drafted_whole(tmp_path: Path) -> None:
    time, truth = aircraft()
    every = ("q", "r", "ay", "az", "theta", "psi", "vn", "ve", "vd", "pn", "pe")
    path, places = write_log(tmp_path, "MATLAB", time, turned("flu in enu", *every, east=True).apply(truth))
    made = draft(path)
    assert misread(path, made.text, truth, every) == []
    lines = tomllib.loads(made.text)["variables"]
    assert (lines["vn"]["column"], lines["ve"]["column"]) == (places["ve"][0], places["vn"][0])


def test_without_velocity_over_ground_forces_tell_of_the_airspeed(tmp_path: Path) -> None:
    knots = times("knots", 1.0 / KNOT, "V")
    place = logged(tmp_path, knots, ("vn", "ve", "vd", "pn", "pe", "altitude"))
    assert verdict(accusations(*place), knots.lines) == "named"
