"""Properties of files, exports and proposals that no quick test held: each kills a planted defect that others missed."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from stoop.assessment.error_bars import _as_known
from stoop.assessment.prior_conflicts import LEVEL, _Linearized
from stoop.base import files
from stoop.base.autopilots import FRAMES
from stoop.exporters.ardupilot_parameters import frame
from stoop.exporters.fmu import Quantity, Unit, description
from stoop.exporters.matlab import _FLY
from stoop.fleet.changes import threshold
from stoop.flight.flight import from_columns
from stoop.flight.maneuvers import find_maneuvers
from stoop.tuning.judgment import worst
from stoop.vehicle_draft.strips import strips, to_flap


def test_a_file_is_replaced_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who has the old file open, or another name for it, keeps its content; the new one is on the disk before it is seen."""
    target, other = tmp_path / "a", tmp_path / "b"
    target.write_bytes(b"old")
    os.link(target, other)
    synced: list[tuple[int, bytes]] = []

    def fsync(handle: int) -> None:
        synced.append((os.fstat(handle).st_size, target.read_bytes()))

    monkeypatch.setattr(files.os, "fsync", fsync)
    files.write_bytes_atomic(target, b"newer")
    assert target.read_bytes() == b"newer"
    assert other.read_bytes() == b"old"
    assert synced == [(5, b"old")]


def test_the_script_of_matlab_integrates_inputs_that_are_linear_in_time_exactly() -> None:
    steps = re.findall(r"(k\d) = \{name\}_equations\((.*), (.*), p\);", _FLY)
    assert [name for name, *_ in steps] == ["k1", "k2", "k3", "k4"]
    (total,) = re.findall(r"    s = (s \+ h / 6 .*);", _FLY)
    known = {"s": 1.0, "h": 0.5, "a": 2.0, "b": 5.0}
    for name, _, inputs in steps:  # x' = u
        known[name] = eval(inputs, {}, known)  # noqa: S307
    assert eval(total, {}, known) == pytest.approx(1.0 + 0.5 * 3.5)  # noqa: S307
    known = {"s": 1.0, "h": 0.5, "a": 0.0, "b": 0.0}
    for name, state, _ in steps:  # x' = x, whose fourth order is the series of the exponential function
        known[name] = eval(state, {}, known)  # noqa: S307
    series = sum(0.5**n / math.factorial(n) for n in range(5))
    assert eval(total, {}, known) == pytest.approx(series)  # noqa: S307


def test_the_structure_of_a_unit_names_its_outputs() -> None:
    """FMI 2.0.4, section 2.2.8: the index of the first variable is 1; FMI 3.0 names value references."""
    kinds = ("independent", "parameter", "input", "output", "local", "output")
    unit = Unit("u", "u", tuple(Quantity(f"q{i}", "1", 0.0, kind) for i, kind in enumerate(kinds)), "")
    two, three = (ET.fromstring(description(unit, version)) for version in ("2.0", "3.0"))  # noqa: S314
    names = [one.attrib["name"] for one in two.findall("ModelVariables/ScalarVariable")]
    places = [int(one.attrib["index"]) for one in two.findall("ModelStructure/Outputs/Unknown")]
    assert [names[place - 1] for place in places] == ["q3", "q5"]
    references = [one.attrib["valueReference"] for one in three.findall("ModelStructure/Output")]
    variables = [one.attrib for one in three.findall("ModelVariables/Float64")]
    named = {one["valueReference"]: one["name"] for one in variables}
    assert [named[one] for one in references] == ["q3", "q5"]


def test_a_prior_is_contradicted_from_either_side_at_one_percent() -> None:
    """The two-sided normal quantile of 1 % is 2.58, the one-sided one 2.33."""
    assert LEVEL == 0.01
    for off, conflict in ((2.45, False), (-2.45, False), (2.7, True), (-2.7, True)):
        one = _Linearized(np.array([[1e4]]), np.array([[1e-4]]), np.array([0]), np.array([off]), np.ones(1))
        assert (one.worst(["a"], np.zeros(1), LEVEL) is not None) is conflict


def test_a_threshold_expects_the_alarms_that_were_asked_for() -> None:
    """Of statistics with an exponential tail, n exp(-x) exceed x."""
    drawn = -np.log((np.arange(10_000) + 0.5) / 10_000)
    for expected in (0.5, 5.0, 100.0):
        assert 10_000 * math.exp(-threshold(drawn, expected)) == pytest.approx(expected, rel=0.02)


def test_the_worst_noise_is_the_largest_and_the_worst_margin_the_smallest() -> None:
    spreads = ({"p5": 1.0, "p95": 3.0}, {"p5": 2.0, "p95": 2.5})
    figures = [{"noise": ("%", s), "gain margin": ("dB", s)} for s in spreads]
    judged: Any = [SimpleNamespace(axis="roll", figures=lambda f=f: f) for f in figures]
    assert worst(judged, "roll", "noise") == 3.0
    assert worst(judged, "roll", "gain margin") == 1.0


def test_a_maneuver_has_half_a_second_before_it_and_a_second_after() -> None:
    time = 0.01 * np.arange(4000)
    inside = (time >= 20.0) & (time < 22.0)
    elevator = np.where(inside, np.where(time < 21.0, 0.1, -0.1), 0.0)
    still = dict.fromkeys("pqr", np.zeros(time.size))
    flight = from_columns("f", time, {"V": np.full(time.size, 25.0), "elevator": elevator, **still})
    (found,) = find_maneuvers(flight)
    assert found.start == pytest.approx(20.0 - 0.5, abs=0.11)
    assert found.stop == pytest.approx(22.0 + 1.0, abs=0.11)


def test_ailerons_roll_and_elevons_together_do_not() -> None:
    """A positive deflection of ailerons rolls to the right."""
    shape = {
        "span": 2.0,
        "root_chord": 0.25,
        "taper": 1.0,
        "area": 0.5,
        "position": (0.06, 0.0, 0.0),
        "sweep": 0.0,
    }
    own = strips(SimpleNamespace(**shape), 0.0, np.zeros(3), (5.0, 4.0))  # type: ignore[arg-type]
    flap: Any = SimpleNamespace(chord=0.25, span=(0.5, 0.95))
    apart, together = (to_flap(own, flap, symmetric, 0.8, 0.5, 0.0) for symmetric in (False, True))
    assert apart.moment[0] > 0.01
    assert apart.roll == pytest.approx(apart.moment[0], rel=0.05)
    assert together.moment[0] == pytest.approx(0.0, abs=1e-12)
    assert together.force[2] < -0.1


def test_an_error_is_widened_up_to_the_prior() -> None:
    """What is known before the data bounds what a wider model leaves open, and never narrows an error."""
    std, variance = np.array([1.0, 1.0, 1.0]), np.array([100.0, 0.44, 100.0])
    np.testing.assert_allclose(_as_known(std, variance, np.array([2.0, np.inf, 0.5])), [2.0, 1.2, 1.0])


def test_frames_of_ardupilot_are_found_by_their_azimuths() -> None:
    """A rotor straight behind is at 180 degrees, a hair's breadth to the left of it at -180."""
    for (number, kind), places in FRAMES.items():
        rotors: list[Any] = []
        for azimuth, spin in places:
            at = math.cos(math.radians(azimuth + 1e-6)), math.sin(math.radians(azimuth + 1e-6)), 0.0
            rotors.append(SimpleNamespace(position=at, axis=(0.0, 0.0, -1.0), spin=spin))
        found = frame(rotors)
        assert (found.number, found.kind is None) == (number, False), (number, kind)
