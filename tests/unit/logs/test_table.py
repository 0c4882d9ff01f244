"""CSV by a mapping: units and signs applied, every mistake named with its key."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.errors import LogError
from stoop.logs import read
from stoop.logs.table import template

GOOD = """
[time]
column = "t_ms"
unit = "ms"
[variables]
p = {column = "roll rate", unit = "deg/s"}
az = {column = "acc", unit = "g", scale = -1}
temperature = {column = "T", unit = "K", offset = 273.15}
"""
LOG = "t_ms,roll rate,acc,T\n1000,90,1,20\n1010,-45,2,21\n"


def write(folder: Path, mapping: str = GOOD, log: str = LOG) -> tuple[Path, Path]:
    log_path, map_path = folder / "f.csv", folder / "m.toml"
    log_path.write_text(log)
    map_path.write_text(mapping)
    return log_path, map_path


def test_units_scale_and_offset(tmp_path: Path) -> None:
    recording = read(*write(tmp_path))
    stream = recording.streams["f.csv"]
    assert recording.format == "table"
    np.testing.assert_allclose(stream.time, [1.0, 1.01])
    np.testing.assert_allclose(stream.columns["p"], [math.pi / 2, -math.pi / 4])
    np.testing.assert_allclose(stream.columns["az"], [-9.80665, -2 * 9.80665])
    np.testing.assert_allclose(stream.columns["temperature"], [293.15, 294.15])


@pytest.mark.parametrize(("unit", "factor"), [("pwm", 1.0), ("us", 1.0), ("ms", 1e3), ("s", 1e6)])
def test_pulses_are_kept_in_microseconds(tmp_path: Path, unit: str, factor: float) -> None:
    mapping = GOOD + f'pwm_1 = {{column = "acc", unit = "{unit}"}}\n'
    stream = read(*write(tmp_path, mapping)).streams["f.csv"]
    np.testing.assert_allclose(stream.columns["pwm_1"], [factor, 2.0 * factor])


def test_a_pulse_needs_a_unit_of_time(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="is unknown; did you mean"):
        read(*write(tmp_path, GOOD + 'pwm_1 = {column = "acc", unit = "deg"}\n'))


def test_the_mapping_may_lie_beside_the_log(tmp_path: Path) -> None:
    log, mapping = write(tmp_path)
    mapping.rename(tmp_path / "f.csv.toml")
    assert set(read(log).streams["f.csv"].columns) == {"p", "az", "temperature"}


def test_a_folder_of_files_with_their_own_clocks(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n0,1\n1,2\n")
    (tmp_path / "b.csv").write_text("t,y\n0.5,3\n1.5,4\n")
    (tmp_path / "mapping.toml").write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n[variables]\n'
        'p = {column = "x", unit = "rad/s", file = "a.csv"}\n'
        'q = {column = "y", unit = "rad/s", file = "b.csv"}\n'
    )
    streams = read(tmp_path).streams
    assert np.array_equal(streams["a.csv"].time, [0.0, 1.0])
    assert np.array_equal(streams["b.csv"].time, [0.5, 1.5])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"t_ms"', '"t"', r"time\.column = 't' is not in .*; its columns are t_ms, roll rate, acc, T"),
        ('unit = "ms"', 'unit = "h"', "time.unit = 'h' is no unit of time"),
        ('"roll rate"', '"roll"', r"variables\.p\.column = 'roll' is not in"),
        ('"deg/s"', '"degs/s"', r"variables\.p\.unit = 'degs/s' is unknown; did you mean deg/s"),
        ("scale = -1", 'scale = "x"', r"variables\.az\.scale is not a number"),
        ("scale = -1", "scale = nan", r"variables\.az\.scale is not a number"),
        ("scale = -1", "gain = -1", r"variables\.az\.gain is unknown; the keys are column, file, offset"),
        ('{column = "T", unit = "K", offset = 273.15}', '"T"', r"variables\.temperature is not a table"),
        (', unit = "deg/s"', "", r"variables\.p\.unit is missing"),
        ('"roll rate", ', '"roll rate", file = "g.csv", ', "drop 'file'"),
        ("[time]", "[clock]", "unknown table 'clock'"),
        ("[variables]", "[time.x]", r"unknown|no table \[variables\]"),
        ("[time]", "[time", "not valid TOML"),
    ],
)
def test_each_mistake_in_a_mapping_is_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in GOOD
    with pytest.raises(LogError, match=words) as caught:
        read(*write(tmp_path, GOOD.replace(old, new, 1)))
    assert str(tmp_path / "m.toml") in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("file", "words"),
    [('""', "missing"), ('"../a.csv"', "not in"), ('"c.csv"', "not in"), ("1", "not a text")],
)
def test_a_file_outside_the_folder_is_refused(tmp_path: Path, file: str, words: str) -> None:
    folder = tmp_path / "log"
    folder.mkdir()
    (tmp_path / "a.csv").write_text("t,x\n0,1\n1,2\n")
    mapping = folder / "mapping.toml"
    mapping.write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n[variables]\n'
        f'p = {{column = "x", unit = "rad/s", file = {file}}}\n'
    )
    with pytest.raises(LogError, match=words):
        read(folder)


def test_without_a_mapping_the_error_holds_one_to_start_from(tmp_path: Path) -> None:
    log, mapping = write(tmp_path)
    with pytest.raises(LogError, match=r"needs a mapping .* f\.csv\.toml beside it") as caught:
        read(log)
    start = str(caught.value.args[0]).split("\n", 1)[1]
    assert tomllib.loads(start)["time"]["column"] == "t_ms"
    mapping.write_text(start)
    assert read(log, mapping).streams["f.csv"].time.size == 2


@given(st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=6, unique=True))
def test_a_template_is_valid_toml_whatever_the_columns_are_called(header: list[str]) -> None:
    try:
        parsed = tomllib.loads(template(header))
    except tomllib.TOMLDecodeError as error:
        raise AssertionError(template(header)) from error
    assert len(parsed.get("variables", {})) == len(header) - 1


def test_too_few_samples(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="fewer than two samples"):
        read(*write(tmp_path, log="t_ms,roll rate,acc,T\n5,1,1,1\n5,1,1,1\n"))


def test_a_missing_mapping(tmp_path: Path) -> None:
    log, _ = write(tmp_path)
    with pytest.raises(LogError, match="the mapping cannot be read"):
        read(log, tmp_path / "no.toml")


def test_defects_of_columns_in_use_only(tmp_path: Path) -> None:
    log = "t_ms,roll rate,acc,T,remark\n1000,90,x,20,hello\n1010,-45,2,21,you\n1005,1,1,1,z\n"
    defects = read(*write(tmp_path, log=log)).defects
    assert [(d.kind, d.place) for d in defects] == [("text", "f.csv acc"), ("time order", "f.csv")]


def test_numbers_beyond_any_size_are_infinite_without_a_warning(tmp_path: Path) -> None:
    recording = read(*write(tmp_path, log=LOG + "1020,1e308,1e308,1e308\n", mapping=GOOD.replace("-1", "-9")))
    assert recording.streams["f.csv"].columns["az"][-1] == -math.inf
