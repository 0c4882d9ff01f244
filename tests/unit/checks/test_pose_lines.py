"""Wrong lines of a log of pose alone: each is named, the drafted mapping corrects it, and a sound log is not accused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.errors import FlightError
from stoop.flight import load
from stoop.flight.mapping_draft import draft
from stoop_studies.verify import capture

Columns = dict[str, FloatArray]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Columns, str]:
    """Return the columns of a log of motion capture and a mapping that reads them right."""
    flown, _ = capture.fly("wings", 0, tmp_path_factory.mktemp("room"))
    table = np.genfromtxt(flown.path, delimiter=",", names=True)
    assert table.dtype.names is not None
    return {n: table[n] for n in table.dtype.names}, draft(flown.path).text


def millimeters(c: Columns) -> Columns:
    return c | {n: 1000.0 * c[n] for n in ("x_n", "y_n", "z_n")}


def z_up(c: Columns) -> Columns:
    return c | {"z_n": -c["z_n"]}


def left_handed(c: Columns) -> Columns:
    return c | {"y_n": -c["y_n"]}


def exchanged(c: Columns) -> Columns:
    return c | {"x_n": c["y_n"], "y_n": c["x_n"]}


def rolled(c: Columns) -> Columns:
    return c | {"roll": -c["roll"]}


def forward_left_up(c: Columns) -> Columns:
    return c | {n: -c[n] for n in ("y_n", "z_n", "pitch", "yaw")}


def redefined(c: Columns) -> Columns:
    return c | {"roll": c["roll"] + 0.4 * (c["t"] > 35.0)}


def unchanged(c: Columns) -> Columns:
    return c


@pytest.mark.parametrize(
    ("wrong", "found", "corrected"),
    [
        (unchanged, set(), True),
        (millimeters, {("mapping-unit", "pn")}, True),
        (z_up, {("mapping-sign", "pd")}, True),
        (left_handed, {("mapping-sign", "pe")}, True),
        (exchanged, {("mapping-exchange", "pn")}, False),
        (rolled, {("mapping-sign", "phi")}, True),
        (forward_left_up, {("mapping-frame", "theta")}, True),
        (redefined, {("pose-jumps", "log.csv")}, False),  # no line is wrong
    ],
)
def test_a_wrong_line_is_named(
    sound: tuple[Columns, str],
    tmp_path: Path,
    wrong: Callable[[Columns], Columns],
    found: set[tuple[str, str]],
    corrected: bool,
) -> None:
    columns, mapping = sound
    written = wrong(columns)
    rows = np.column_stack([*written.values()])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(written), comments="", fmt="%.7g")
    for text, expected in (
        (mapping, found),
        (draft(tmp_path / "log.csv").text, set() if corrected else found),
    ):
        (tmp_path / "map.toml").write_text(text, encoding="utf-8")
        notices = load(tmp_path / "log.csv", tmp_path / "map.toml").notices
        assert {(n.code, n.subject) for n in notices if n.severity == "warning"} == expected


def test_degrees_in_radians_are_refused(sound: tuple[Columns, str], tmp_path: Path) -> None:
    columns, mapping = sound
    written = columns | {n: np.degrees(columns[n]) for n in ("roll", "pitch", "yaw")}
    rows = np.column_stack([*written.values()])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(written), comments="", fmt="%.7g")
    (tmp_path / "map.toml").write_text(mapping, encoding="utf-8")
    with pytest.raises(FlightError, match='write unit = "deg"'):
        load(tmp_path / "log.csv", tmp_path / "map.toml")
    (tmp_path / "map.toml").write_text(draft(tmp_path / "log.csv").text, encoding="utf-8")
    assert not [
        n for n in load(tmp_path / "log.csv", tmp_path / "map.toml").notices if n.severity == "warning"
    ]
