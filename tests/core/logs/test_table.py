"""CSV logs: a mapping names columns, units and signs, every mistake is named; a folder of PX4 topics needs none."""

import gzip
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from helpers.made_logs import CLOCK
from hypothesis import given
from hypothesis import strategies as st

from stoop.base.arrays import FloatArray
from stoop.errors import LogError, StoopError
from stoop.flight.apply_mapping import Mapped
from stoop.logs import Recording, read
from stoop.logs.csv_tables import template, topic_files

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
Signals = dict[str, tuple[FloatArray, FloatArray]]
BODY = "timestamp,q[0]\n1000000,1.0\n1100000,0.5\n"


def write(folder: Path, mapping: str = GOOD, log: str = LOG) -> tuple[Path, Path]:
    log_path, map_path = folder / "f.csv", folder / "m.toml"
    log_path.write_text(log)
    map_path.write_text(mapping)
    return log_path, map_path


def mapped(log: Path, mapping: Path | None = None) -> tuple[Recording, Signals]:
    recording, found = Mapped.read(log, mapping)
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
    (folder := tmp_path / "log").mkdir()
    for path in (tmp_path / "out.csv", folder / "a.csv"):
        path.write_text("t,x\n0,1\n1,2\n")
    (folder / "b.csv").write_text("t,y\n0.5,3\n1.5,4\n")
    (folder / "other.csv").write_text("no table\n")  # no variable stands there: it is not read
    text = CLOCK + 'q = {column = "y", unit = "rad/s", file = "b.csv"}\n'
    text += 'p = {column = "x", unit = "rad/s", file = "a.csv"}\n'
    (folder / "mapping.toml").write_text(text)
    recording, found = mapped(folder)
    assert np.array_equal(found["p"][0], [0.0, 1.0])
    assert np.array_equal(found["q"][0], [0.5, 1.5])
    assert recording.unread == {"other.csv": ()}
    for outside in ('"../out.csv"', '"c.csv"', "1"):
        (folder / "mapping.toml").write_text(text.replace('"a.csv"', outside))
        with pytest.raises(StoopError, match=r"variables\.p"):
            mapped(folder)
    log = "t_ms,roll rate,acc,T,remark\n1000,90,x,20,hello\n1010,-45,2,21,you\n1005,1,1,1,z\n"
    defects = mapped(*write(tmp_path, log=log))[0].defects
    assert [(d.kind, d.place) for d in defects] == [("text", "f.csv acc"), ("time order", "f.csv")]


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
    for reader in (read, Mapped.read):
        with pytest.raises(LogError, match="cannot read the mapping file"):
            reader(log, tmp_path / "no.toml")


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
    assert len(tomllib.loads(template(header)).get("variables", {})) == len(header) - 1


def put(folder: Path, *names: str, body: str = BODY) -> None:
    for name in names:
        path = folder / name
        path.write_bytes(gzip.compress(body.encode()) if name.endswith("gz") else body.encode())


def test_topics_are_found_behind_any_prefix(tmp_path: Path) -> None:
    shared = {"vehicle_attitude", "airspeed"}
    known = shared | {"vehicle_attitude_setpoint", "actuator_controls_0", "airspeed_validated"}
    few = shared | {"estimator_aid_src_airspeed", "my_airspeed"}  # that end in another's name
    prefixes = ("log_5_2021-7-20-11-12-20_", "flight3_", "", "a_vehicle_", "wind_", "log_")
    for k, (prefix, topics) in enumerate((prefix, topics) for prefix in prefixes for topics in (known, few)):
        folder = tmp_path / f"{k}"
        folder.mkdir()
        put(folder, *(f"{prefix}{topic}_0.csv.gz" for topic in topics))
        assert {(file.prefix, file.topic) for file in topic_files(folder)} == {(prefix, t) for t in topics}


def test_topics_keep_their_clock_instances_are_numbered_and_bad_files_are_skipped(tmp_path: Path) -> None:
    put(tmp_path, "log_vehicle_attitude_0.csv", "log_airspeed_0.csv", "log_airspeed_1.csv")
    put(tmp_path, "log_battery_status_1.csv", "log_my_own_topic_0.csv", "log_new_airspeed_0.csv", "other.csv")
    bad = {"sensor_combined": "", "sensor_baro": "time,x\n1,2\n", "status": "timestamp,x\nnan,2\n"}
    for topic, body in bad.items():
        put(tmp_path, f"log_{topic}_0.csv", body=body)
    recording = read(tmp_path)
    own = {"my_own_topic", "new_airspeed"}
    assert set(recording.streams) == {"vehicle_attitude", "airspeed", "airspeed/1", "battery_status", *own}
    stream = recording.streams["vehicle_attitude"]
    assert recording.format == "px4-csv"
    np.testing.assert_allclose(stream.time, [1.0, 1.1], rtol=1e-15)
    assert np.array_equal(stream.columns["q[0]"], [1.0, 0.5])
    skipped = {d.place for d in recording.defects if d.kind == "skipped"}
    assert skipped == {f"log_{topic}_0.csv" for topic in bad}


def test_a_folder_without_a_log_or_with_two(tmp_path: Path) -> None:
    wind = "wind_0.csv"
    for k, (names, body, words) in enumerate((
        ([], "", "no PX4 topic"), (["readme.csv"], BODY, "no PX4 topic"), (["log_" + wind], "", "no topic holds data"),
        (["a_" + wind, "b_" + wind], BODY, r"more than one log \(a_, b_\)"),
        (["log_" + wind, "log_2_" + wind], BODY, r"more than one log \(log_, log_2_\)"),
    )):  # fmt: skip
        (folder := tmp_path / f"{k}").mkdir()
        put(folder, *names, *(name.replace("wind", "airspeed") for name in names), body=body)
        with pytest.raises(LogError, match=words) as caught:
            read(folder)
        assert str(folder) in str(caught.value)
