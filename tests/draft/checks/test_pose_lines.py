"""Wrong lines of a log of pose alone: each is named, the drafted mapping corrects it, and a sound log is not accused."""

from pathlib import Path

import numpy as np
import pytest
from helpers.made_logs import csv_log

from stoop.base.arrays import FloatArray
from stoop.errors import FlightError
from stoop.flight import load
from stoop_draft.mapping_draft import draft
from stoop_studies.verify import capture

Columns = dict[str, FloatArray]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Columns, str]:
    flown, _ = capture.fly("wings", 0, tmp_path_factory.mktemp("room"))
    table = np.genfromtxt(flown.path, delimiter=",", names=True)
    return {n: table[n] for n in table.dtype.names}, draft(flown.path).text


def test_wrong_lines_are_named_and_drafts_correct_them(sound: tuple[Columns, str], tmp_path: Path) -> None:
    c, mapping = sound

    def but(*names: str) -> Columns:
        return {n: -c[n] for n in names}

    for wrong, found, corrected in (
        ({}, set(), True),
        ({n: 1000.0 * c[n] for n in ("x_n", "y_n", "z_n")}, {("mapping-unit", "pn")}, True),
        (but("z_n"), {("mapping-sign", "pd")}, True),
        (but("y_n"), {("mapping-sign", "pe")}, True),
        ({"x_n": c["y_n"], "y_n": c["x_n"]}, {("mapping-exchange", "pn")}, False),
        (but("roll"), {("mapping-sign", "phi")}, True),
        (but("y_n", "z_n", "pitch", "yaw"), {("mapping-frame", "theta")}, True),
        ({"roll": c["roll"] + 0.4 * (c["t"] > 35.0)}, {("pose-jumps", "log.csv")}, False),  # no line is wrong
    ):
        written = csv_log(tmp_path / "log.csv", c | wrong)
        for text, expected in ((mapping, found), (draft(written).text, set() if corrected else found)):
            assert warnings(written, text) == expected, (found, text)
    degrees = csv_log(tmp_path / "log.csv", c | {n: np.degrees(c[n]) for n in ("roll", "pitch", "yaw")})
    with pytest.raises(FlightError, match='write unit = "deg"'):
        warnings(degrees, mapping)
    assert warnings(degrees, draft(degrees).text) == set()


def warnings(path: Path, mapping: str) -> set[tuple[str, str]]:
    path.with_name("map.toml").write_text(mapping, encoding="utf-8")
    notices = load(path, path.with_name("map.toml")).notices
    return {(n.code, n.subject) for n in notices if n.severity == "warning"}
