"""Sensors along other axes than their mapping says are named together, and the advice, applied, gives the flight back."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest
from unit.checks.test_clean_flights import OWN

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.variables import SPECIFIC_FORCE
from stoop.checks.mapping import check_mapping
from stoop.flight.mapping_corrections import corrected_mapping
from stoop_studies.verify import lines
from stoop_studies.verify.lines import CALIBRATED, FRAMES, GROUND, Mangled, misread, times


@functools.cache
def recorded(winged: bool) -> tuple[FloatArray, dict[str, FloatArray]]:
    return lines.flown(3000, winged)


def columns(winged: bool, without: tuple[str, ...] = ()) -> tuple[FloatArray, dict[str, FloatArray]]:
    time, truth = recorded(winged)
    return time, {name: x for name, x in truth.items() if name not in ("pd", *without)}


def airborne(without: tuple[str, ...] = (), winged: bool = True) -> tuple[FloatArray, dict[str, FloatArray]]:
    time, truth = columns(winged, without)
    return time[time >= GROUND], {name: x[time >= GROUND] for name, x in truth.items()}


def logged(folder: Path, time: FloatArray, recorded: dict[str, FloatArray]) -> tuple[Path, Path]:
    path, places = lines.write_log(folder, "CSV", time, recorded)
    mapping = folder / "m.toml"
    mapping.write_text(lines.mapping_text("CSV", places))
    return path, mapping


def named_and_corrected(folder: Path, frame: Mangled, winged: bool) -> None:
    time, truth = columns(winged)
    path, mapping = logged(folder, time, dict(frame.apply(truth)))
    assert lines.verdict(lines.accusations(path, mapping), frame.lines) == "named"
    made = corrected_mapping(path, mapping)
    assert made.left == ()
    assert misread(path, made.text, frame.shown(truth), truth, CALIBRATED) == []


ROS = next(frame for frame in FRAMES if frame.words == "all in flu and enu")
#: as meters a second it is most of the speed, and where it is small the aircraft is no less in the air
FEET = times("climb in ft/min", 60.0 / 0.3048, "vd")


@pytest.mark.parametrize("frame", [ROS, FEET], ids=["ros", "feet"])
def test_axes_of_ros_and_a_climb_in_feet_are_named_and_corrected(tmp_path: Path, frame: Mangled) -> None:
    named_and_corrected(tmp_path, frame, winged=True)


@pytest.mark.parametrize("winged", [True, False], ids=["aircraft", "multirotor"])
@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: frame.words)
def test_other_axes_are_named_and_corrected(tmp_path: Path, frame: Mangled, winged: bool) -> None:
    named_and_corrected(tmp_path, frame, winged)


def found(time: FloatArray, shown: dict[str, FloatArray]) -> list[Notice]:
    own = {name: OWN[name] for name in shown}
    judged = check_mapping({name: (time, x) for name, x in shown.items()}, shown, 50.0, own)
    return [*judged.refused, *judged.notices]


@pytest.mark.parametrize("winged", [True, False], ids=["aircraft", "multirotor"])
def test_without_accelerometers_path_and_bank_tell_of_z(winged: bool) -> None:
    """Motion capture with z up, whose attitude is that of z down; what carries a multirotor says nothing of a climb."""
    time, truth = airborne((*SPECIFIC_FORCE, "altitude", "elevator", "aileron", "rudder"), winged)
    assert found(time, truth) == []
    if winged:
        assert [one.subject for one in found(time, {**truth, "vd": -truth["vd"]})] == ["vd"]
        turned = {**truth, **{n: -truth[n] for n in ("ve", "vd", "pe")}}  # ground axes are told by the bank
        assert {name for one in found(time, turned) for name in one.values["lines"]} == {"ve", "vd", "pe"}
        noise = 0.02 * np.random.default_rng(0).standard_normal(time.size)
        assert (
            found(time, {**truth, "theta": truth["theta"] + noise}) == []
        )  # it shrinks with a unit: no reason


def test_an_attitude_to_the_left_whose_pitch_counts_nose_up(tmp_path: Path) -> None:
    """As small loggers write it; nothing shows where north is."""
    time, truth = columns(True)
    left = times("left and up", -1.0, "q", "r", "ay", "az", "psi", "ve", "vd", "pe")
    path, mapping = logged(tmp_path, time, dict(left.apply(truth)))
    made = corrected_mapping(path, mapping)
    assert len(made.applied) == 1
    assert made.left == ()
    assert [] in [misread(path, made.text, x, truth, CALIBRATED) for x in (truth, lines._quarter(truth))]


def test_thrust_ahead_tells_pitch_from_its_rate() -> None:
    time, truth = airborne((*SPECIFIC_FORCE, "altitude"), winged=False)
    for name in ("q", "theta"):
        assert [one.values["lines"] for one in found(time, {**truth, name: -truth[name]})] == [(name,)]
