"""Sensors along other axes than their mapping says are named together, and the advice, applied, gives the flight back."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.variables import SPECIFIC_FORCE, VELOCITY
from stoop.checks.mapping import check_mapping
from stoop.flight.mapping_corrections import corrected_mapping
from stoop_studies.verify.lines import (
    CALIBRATED,
    FRAMES,
    GROUND,
    Mangled,
    accusations,
    flown,
    mapping_text,
    misread,
    times,
    verdict,
    write_log,
)
from tests.unit.checks.test_clean_flights import OWN

SEED = 3000


@functools.cache
def recorded(winged: bool) -> tuple[FloatArray, dict[str, FloatArray]]:
    return flown(SEED, winged)


def columns(winged: bool, without: tuple[str, ...] = ()) -> tuple[FloatArray, dict[str, FloatArray]]:
    time, truth = recorded(winged)
    return time, {name: x for name, x in truth.items() if name not in ("pd", *without)}


def airborne(without: tuple[str, ...] = (), winged: bool = True) -> tuple[FloatArray, dict[str, FloatArray]]:
    time, truth = columns(winged, without)
    return time[time >= GROUND], {name: x[time >= GROUND] for name, x in truth.items()}


def logged(folder: Path, time: FloatArray, recorded: dict[str, FloatArray]) -> tuple[Path, Path]:
    path, places = write_log(folder, "CSV", time, recorded)
    mapping = folder / "m.toml"
    mapping.write_text(mapping_text("CSV", places))
    return path, mapping


@pytest.mark.parametrize("winged", [True, False], ids=["aircraft", "multirotor"])
@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: frame.words)
def test_other_axes_are_named_and_corrected(tmp_path: Path, frame: Mangled, winged: bool) -> None:
    time, truth = columns(winged)
    path, mapping = logged(tmp_path, time, dict(frame.apply(truth)))
    assert verdict(accusations(path, mapping), frame.lines) == "named"
    made = corrected_mapping(path, mapping)
    assert made.left == ()
    assert misread(path, made.text, frame.shown(truth), truth, CALIBRATED) == []


@pytest.mark.parametrize("winged", [True, False], ids=["aircraft", "multirotor"])
def test_without_accelerometers_path_and_bank_tell_of_z(winged: bool) -> None:
    """Motion capture with z up, whose attitude is that of z down."""
    time, truth = airborne((*SPECIFIC_FORCE, "altitude", "elevator", "aileron", "rudder"), winged)
    for shown, changed in ((truth, ()), ({**truth, "vd": -truth["vd"]}, ("vd",))):
        signals = {name: (time, x) for name, x in shown.items()}
        found = check_mapping(signals, shown, 50.0, {name: OWN[name] for name in shown})
        if winged:  # what carries a multirotor says nothing of a climb
            assert [one.subject for one in (*found.refused, *found.notices)] == list(changed)
        elif not changed:
            assert not (*found.refused, *found.notices)


def test_ground_axes_are_told_by_the_bank_where_no_force_is_known() -> None:
    time, truth = airborne((*SPECIFIC_FORCE, "altitude"))
    turned = {**truth, **{n: -truth[n] for n in (*VELOCITY[1:], "pe")}}
    found = check_mapping(
        {name: (time, x) for name, x in turned.items()}, turned, 50.0, {name: OWN[name] for name in turned}
    )
    assert {name for one in found.notices for name in one.values["lines"]} == {"ve", "vd", "pe"}


def test_noise_of_an_attitude_is_not_its_unit() -> None:
    """Differences of a noisy pitch angle shrink with its unit; that explains nothing."""
    time, truth = airborne()
    rng = np.random.default_rng(0)
    noisy = {**truth, "theta": truth["theta"] + 0.02 * rng.standard_normal(time.size)}
    found = check_mapping({name: (time, x) for name, x in noisy.items()}, noisy, 50.0, OWN)
    assert not (*found.refused, *found.notices)


def test_a_right_mapping_is_not_changed(tmp_path: Path) -> None:
    time, truth = columns(True)
    path, mapping = logged(tmp_path, time, dict(times("right", 1.0).apply(truth)))
    made = corrected_mapping(path, mapping)
    assert (made.text, made.applied, made.left) == (mapping.read_text(), (), ())
