"""A mapping judged as a whole: simulated flights in wind, after ground time in which the estimator holds zeros."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE, KNOT
from stoop.flight import load
from stoop_studies.verify.lines import (
    Mangled,
    accusations,
    flown,
    lost,
    mapping_text,
    swap,
    times,
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
