"""A mapping judged as a whole: simulated flights in wind, after ground time in which the estimator holds zeros."""

import functools
import tomllib
from pathlib import Path

import numpy as np
import pytest
from draft.checks.test_clean_flights import OWN
from helpers.made_logs import csv_log

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.units import DEGREE, FOOT, KNOT
from stoop.base.variables import SPECIFIC_FORCE
from stoop.flight import load_flight
from stoop_draft.checks.mapping import check_mapping
from stoop_draft.mapping_corrections import corrected_mapping
from stoop_draft.mapping_draft import draft
from stoop_studies.verify import lines
from stoop_studies.verify.lines import CALIBRATED, FRAMES, Mangled, flown, misread, times

Columns = dict[str, FloatArray]

#: as meters a second it is most of the speed, and where it is small the aircraft is no less in the air
FEET = times("climb in ft/min", 60.0 / 0.3048, "vd")


def put(folder: Path, time: FloatArray, columns: Columns, form: str = "CSV") -> tuple[Path, Path]:
    path, places = lines.write_log(folder, form, time, columns)
    mapping = folder / "m.toml"
    mapping.write_text(lines.mapping_text(form, places))
    return path, mapping


@functools.cache
def aircraft(seed: int = 2000, winged: bool = True) -> tuple[FloatArray, Columns]:
    time, columns = flown(seed, winged)
    return time, {name: x for name, x in columns.items() if name != "pd"}


def logged(folder: Path, mangled: Mangled, without: tuple[str, ...] = ()) -> tuple[Path, Path]:
    time, truth = aircraft()
    columns = {name: x for name, x in mangled.apply(truth).items() if name not in without}
    return put(folder, time, columns)


def test_a_right_mapping_has_no_fault_whatever_the_estimator_held_before_take_off(tmp_path: Path) -> None:
    path, mapping = logged(tmp_path, times("right", 1.0))
    assert load_flight(path, mapping).faults == ()
    made = corrected_mapping(path, mapping)
    assert (made.text, made.applied, made.left) == (mapping.read_text(), (), ())
    mapping.write_text(mapping.read_text().replace("V = {", "airspeed_pitot = {"))
    flight = load_flight(path, mapping)  # a pitot beside vanes is the airspeed
    np.testing.assert_array_equal(flight.column("V"), flight.column("airspeed_pitot"))
    assert "airspeed-of-pitot" in {one.code for one in flight.notices}
    rates = times("rates 2 % high", 1.02, "p", "q", "r")  # which the attitude follows within calibration
    assert lines.accusations(*logged(tmp_path, rates)) == []


WRONG = [
    lines.lost("vd"), lines.swap("vn", "ve"), times("theta in degrees", 1.0 / DEGREE, "theta"), lines.lost("elevator"),
    times("pitot low", 0.8, "V"), times("knots", 1.0 / KNOT, "V"), times("alpha in degrees", 1.0 / DEGREE, "alpha"),
    lines.lost("beta"), times("q declared deg/s", DEGREE, "q"), lines.swap("elevator", "rudder"),
    times("vn and ve in knots", 1.0 / KNOT, "vn", "ve"), times("speeds in knots", 1.0 / KNOT, "vn", "ve", "vd", "V"),
    times("rates 10 % high", 1.1, "p", "q", "r"), times("rates 10 % low", 0.9, "p", "q", "r"),
]  # fmt: skip


@pytest.mark.parametrize("mangled", WRONG, ids=lambda mangled: mangled.words)
def test_wrong_lines_alone_and_together_are_named(tmp_path: Path, mangled: Mangled) -> None:
    ((said,),) = lines.accusations(*logged(tmp_path, mangled))
    assert set(said) == set(mangled.lines)


@pytest.mark.parametrize("without", [(), ("ax", "ay", "az", "pn", "pe", "alpha", "beta")])
def test_knots_over_ground_do_not_accuse_the_airspeed(tmp_path: Path, without: tuple[str, ...]) -> None:
    mangled = times("vn and ve in knots", 1.0 / KNOT, "vn", "ve")
    path, mapping = logged(tmp_path, mangled, without)
    assert lines.verdict(lines.accusations(path, mapping), mangled.lines) == "named"
    made = corrected_mapping(path, mapping)
    assert misread(path, made.text, aircraft()[1], ("vn", "ve", "vd", "V")) == []


def test_a_heading_in_degrees_beside_rates_in_degrees_is_no_radian(tmp_path: Path) -> None:
    time, truth = aircraft()
    names = ("psi", "p", "q", "r")
    kept = {n: x for n, x in truth.items() if n not in ("phi", "theta")}
    written = {**kept, **{n: truth[n] / DEGREE for n in names}}
    written["psi"] %= 360.0
    path, mapping = put(tmp_path, time, written, "MATLAB")
    made = corrected_mapping(path, mapping)
    units = {name: line["unit"] for name, line in tomllib.loads(made.text)["variables"].items()}
    assert [units[n] for n in names] == ["deg", "deg/s", "deg/s", "deg/s"]
    assert made.left == ()


def test_feet_a_minute_a_heading_and_axes_of_east_north_up_are_drafted(tmp_path: Path) -> None:
    """A heading is the column that turns as its rate does."""
    time, truth = aircraft()
    columns = {
        "t_s": time, **{n: truth[n] for n in ("p", "q", "r", "phi", "theta", "vn", "ve", "V")},
        "alt": truth["altitude"] / FOOT, "climb": -truth["vd"] / FOOT * 60.0,
        "yaw_vane": truth["beta"], "yaw_old": np.roll(truth["psi"], 400), "heading": truth["psi"],
    }  # fmt: skip
    drafted = tomllib.loads(draft(csv_log(tmp_path / "log.csv", columns)).text)["variables"]
    assert (drafted["altitude"]["unit"], drafted["vd"]["unit"]) == ("ft", "ft/min")
    assert (drafted["psi"]["column"], drafted["beta"]["column"]) == ("heading", "yaw_vane")
    every = ("q", "r", "ay", "az", "theta", "psi", "vn", "ve", "vd", "pn", "pe")
    turned = lines.turned("flu in enu", *every, east=True).apply(truth)
    path, places = lines.write_log(tmp_path, "MATLAB", time, turned)
    made = draft(path)
    assert misread(path, made.text, truth, every) == []
    drafted = tomllib.loads(made.text)["variables"]
    assert (drafted["vn"]["column"], drafted["ve"]["column"]) == (places["ve"][0], places["vn"][0])


def test_without_velocity_over_ground_forces_tell_of_the_airspeed(tmp_path: Path) -> None:
    knots = times("knots", 1.0 / KNOT, "V")
    place = logged(tmp_path, knots, ("vn", "ve", "vd", "pn", "pe", "altitude"))
    assert lines.verdict(lines.accusations(*place), knots.lines) == "named"


def airborne(winged: bool, *without: str) -> tuple[FloatArray, Columns]:
    time, truth = aircraft(3000, winged)
    up = time >= lines.GROUND
    return time[up], {name: x[up] for name, x in truth.items() if name not in without}


@pytest.mark.parametrize("winged", [True, False], ids=["aircraft", "multirotor"])
@pytest.mark.parametrize("frame", [*FRAMES, FEET], ids=lambda frame: frame.words)
def test_other_axes_are_named_and_corrected(tmp_path: Path, frame: Mangled, winged: bool) -> None:
    time, truth = aircraft(3000, winged)
    path, mapping = put(tmp_path, time, dict(frame.apply(truth)))
    assert lines.verdict(lines.accusations(path, mapping), frame.lines) == "named"
    made = corrected_mapping(path, mapping)
    assert made.left == ()
    assert misread(path, made.text, frame.shown(truth), truth, CALIBRATED) == []


def found(time: FloatArray, shown: Columns) -> list[Notice]:
    own = {name: OWN[name] for name in shown}
    judged = check_mapping({name: (time, x) for name, x in shown.items()}, shown, 50.0, own)
    return [*judged.refused, *judged.notices]


@pytest.mark.parametrize("winged", [True, False], ids=["aircraft", "multirotor"])
def test_without_accelerometers_path_and_bank_tell_of_z(winged: bool) -> None:
    """Motion capture with z up, whose attitude is that of z down; what carries a multirotor says nothing of a climb."""
    time, truth = airborne(winged, *SPECIFIC_FORCE, "altitude", "elevator", "aileron", "rudder")
    assert found(time, truth) == []
    if winged:
        assert [one.subject for one in found(time, {**truth, "vd": -truth["vd"]})] == ["vd"]
        other = truth | {n: -truth[n] for n in ("ve", "vd", "pe")}  # ground axes are told by the bank
        assert {name for one in found(time, other) for name in one.values["lines"]} == {"ve", "vd", "pe"}
        noise = 0.02 * np.random.default_rng(0).standard_normal(time.size)
        assert found(time, {**truth, "theta": truth["theta"] + noise}) == []  # shrunk by a unit: no reason


def test_an_attitude_to_the_left_whose_pitch_counts_nose_up(tmp_path: Path) -> None:
    """As small loggers write it; nothing shows where north is."""
    time, truth = aircraft(3000)
    left = times("left and up", -1.0, "q", "r", "ay", "az", "psi", "ve", "vd", "pe")
    path, mapping = put(tmp_path, time, dict(left.apply(truth)))
    made = corrected_mapping(path, mapping)
    assert len(made.applied) == 1
    assert made.left == ()
    assert [] in [misread(path, made.text, x, truth, CALIBRATED) for x in (truth, lines._quarter(truth))]


def test_thrust_ahead_tells_pitch_from_its_rate() -> None:
    time, truth = airborne(False, *SPECIFIC_FORCE, "altitude")
    for name in ("q", "theta"):
        assert [one.values["lines"] for one in found(time, {**truth, name: -truth[name]})] == [(name,)]
