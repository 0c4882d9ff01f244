"""CSV logs of any origin: a mapping names the columns, its units and signs are applied, every mistake is named."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.base.arrays import FloatArray
from stoop.errors import LogError, StoopError
from stoop.flight.apply_mapping import read_mapped
from stoop.logs import Recording, read
from stoop.logs.csv_tables import template

GOOD = """
[time]
column = "t_ms"
unit = "ms"
[variables]
p = {column = "roll rate", unit = "deg/s"}
az = {column = "acc", unit = "g", scale = -1.0}
temperature = {column = "T", unit = "K", offset = 273.15}
"""
LOG = "t_ms,roll rate,acc,T\n1000,90,1,20\n1010,-45,2,21\n"


def write(folder: Path, mapping: str = GOOD, log: str = LOG) -> tuple[Path, Path]:
    log_path, map_path = folder / "f.csv", folder / "m.toml"
    log_path.write_text(log)
    map_path.write_text(mapping)
    return log_path, map_path


Signals = dict[str, tuple[FloatArray, FloatArray]]


def mapped(log: Path, mapping: Path | None = None) -> tuple[Recording, Signals]:
    recording, found = read_mapped(log, mapping)
    assert found is not None
    return recording, {n: (group.time, x) for group in found.channels for n, x in group.values.items()}


def test_units_scale_and_offset(tmp_path: Path) -> None:
    pulses = 'pwm_1 = {column = "acc", unit = "ms"}\npwm_2 = {column = "acc", unit = "pwm"}\n'
    log, text = write(tmp_path, GOOD + pulses, LOG + "1020,1e308,1e308,1e308\n")
    recording, found = mapped(log, text)
    assert recording.format == "table"
    np.testing.assert_allclose(found["p"][0], [1.0, 1.01, 1.02])
    np.testing.assert_allclose(found["p"][1][:2], [math.pi / 2, -math.pi / 4])
    np.testing.assert_allclose(found["az"][1], [-9.80665, -2 * 9.80665, -math.inf])  # and no warning
    np.testing.assert_allclose(found["temperature"][1][:2], [293.15, 294.15])
    np.testing.assert_allclose(found["pwm_1"][1][:2], [1e3, 2e3])
    np.testing.assert_allclose(found["pwm_2"][1][:2], [1.0, 2.0])
    columns = read(log, text).streams["f.csv"].columns  # they stay as recorded
    np.testing.assert_array_equal(columns["roll rate"], [90.0, -45.0, 1e308])
    text.rename(tmp_path / "f.csv.toml")  # beside the log
    assert set(mapped(log)[1]) == {"p", "az", "temperature", "pwm_1", "pwm_2"}


def test_a_folder_of_files_with_their_own_clocks(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n0,1\n1,2\n")
    (tmp_path / "b.csv").write_text("t,y\n0.5,3\n1.5,4\n")
    (tmp_path / "other.csv").write_text("no table\n")  # no variable stands there: it is not read
    (tmp_path / "mapping.toml").write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n[variables]\n'
        'p = {column = "x", unit = "rad/s", file = "a.csv"}\n'
        'q = {column = "y", unit = "rad/s", file = "b.csv"}\n'
    )
    recording, found = mapped(tmp_path)
    assert np.array_equal(found["p"][0], [0.0, 1.0])
    assert np.array_equal(found["q"][0], [0.5, 1.5])
    assert recording.unread == {"other.csv": ()}


def test_each_mistake_in_a_mapping_is_named(tmp_path: Path) -> None:
    for old, new, words in (
        ("scale = -1.0", 'scale = "x"', r"variables\.az\.scale"),
        ("scale = -1.0", "scale = nan", r"variables\.az\.scale"),
        ('{column = "T", unit = "K", offset = 273.15}', '"T"', r"variables\.temperature: this must be a table"),
        (', unit = "deg/s"', "", r"variables\.p\.unit: missing"),
        ('"roll rate", ', '"roll rate", file = "g.csv", ', "g.csv"),
        ("[time]", "[time", "not valid TOML"),
        ("[variables]", '[variables]\npwm_1 = {column = "acc", unit = "deg"}', "is unknown; choose from pwm, us, ms, s"),
    ):  # fmt: skip
        assert old in GOOD
        with pytest.raises(LogError, match=words) as caught:
            mapped(*write(tmp_path, GOOD.replace(old, new, 1)))
        assert str(tmp_path / "m.toml") in str(caught.value)
        assert "\n" not in str(caught.value)
    log, _ = write(tmp_path, log="t_ms,roll rate,acc,T\n5,1,1,1\n5,1,1,1\n")
    with pytest.raises(LogError, match="fewer than two samples"):
        mapped(log, tmp_path / "m.toml")
    for reader in (read, read_mapped):
        with pytest.raises(LogError, match="cannot read the mapping file"):
            reader(log, tmp_path / "no.toml")


@pytest.mark.parametrize("file", ['"../a.csv"', '"c.csv"', "1"])
def test_a_file_outside_the_folder_is_refused(tmp_path: Path, file: str) -> None:
    folder = tmp_path / "log"
    folder.mkdir()
    (tmp_path / "a.csv").write_text("t,x\n0,1\n1,2\n")
    (folder / "b.csv").write_text("t,x\n0,1\n1,2\n")
    mapping = folder / "mapping.toml"
    mapping.write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n[variables]\n'
        'q = {column = "x", unit = "rad/s", file = "b.csv"}\n'
        f'p = {{column = "x", unit = "rad/s", file = {file}}}\n'
    )
    with pytest.raises(StoopError, match=r"variables\.p"):
        mapped(folder)


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


def test_defects_of_columns_in_use_only(tmp_path: Path) -> None:
    log = "t_ms,roll rate,acc,T,remark\n1000,90,x,20,hello\n1010,-45,2,21,you\n1005,1,1,1,z\n"
    defects = mapped(*write(tmp_path, log=log))[0].defects
    assert [(d.kind, d.place) for d in defects] == [("text", "f.csv acc"), ("time order", "f.csv")]
