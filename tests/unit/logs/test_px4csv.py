"""A folder of PX4 topics: names of any prefix, several instances, one bad file among good ones."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from stoop.errors import LogError
from stoop.logs import read
from stoop.logs.csv_tables import topic_files

BODY = "timestamp,q[0]\n1000000,1.0\n1100000,0.5\n"


def write(folder: Path, *names: str, body: str = BODY) -> None:
    for name in names:
        path = folder / name
        path.write_bytes(gzip.compress(body.encode()) if name.endswith("gz") else body.encode())


def test_topics_are_found_behind_any_prefix(tmp_path: Path) -> None:
    known = {
        "vehicle_attitude",
        "vehicle_attitude_setpoint",
        "actuator_controls_0",
        "airspeed",
        "airspeed_validated",
    }
    few = {
        "airspeed",
        "vehicle_attitude",
        "estimator_aid_src_airspeed",
        "my_airspeed",
    }  # that end in another's name
    prefixes = ("log_5_2021-7-20-11-12-20_", "flight3_", "", "a_vehicle_", "wind_", "log_")
    for k, (prefix, topics) in enumerate((prefix, topics) for prefix in prefixes for topics in (known, few)):
        folder = tmp_path / f"{k}"
        folder.mkdir()
        write(folder, *(f"{prefix}{topic}_0.csv.gz" for topic in topics))
        assert {(file.prefix, file.topic) for file in topic_files(folder)} == {(prefix, t) for t in topics}


def test_time_is_the_stamp_in_seconds_and_not_shifted(tmp_path: Path) -> None:
    write(tmp_path, "log_vehicle_attitude_0.csv")
    recording = read(tmp_path)
    stream = recording.streams["vehicle_attitude"]
    assert recording.format == "px4-csv"
    np.testing.assert_allclose(stream.time, [1.0, 1.1], rtol=1e-15)
    assert np.array_equal(stream.columns["q[0]"], [1.0, 0.5])


def test_further_instances_are_numbered_and_unknown_topics_follow(tmp_path: Path) -> None:
    write(tmp_path, "log_airspeed_0.csv", "log_airspeed_1.csv", "log_battery_status_1.csv")
    write(tmp_path, "log_my_own_topic_0.csv", "log_new_airspeed_0.csv", "other.csv")
    own = {"my_own_topic", "new_airspeed"}
    assert set(read(tmp_path).streams) == {"airspeed", "airspeed/1", "battery_status", *own}


def test_one_bad_file_does_not_lose_the_others(tmp_path: Path) -> None:
    write(tmp_path, "log_airspeed_0.csv")
    bad = {
        "sensor_combined": "",
        "vehicle_attitude": "time,x\n1,2\n",
        "battery_status": "timestamp,x\nnan,2\n",
    }
    for topic, body in bad.items():
        write(tmp_path, f"log_{topic}_0.csv", body=body)
    recording = read(tmp_path)
    assert set(recording.streams) == {"airspeed"}
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
        write(folder, *names, *(name.replace("wind", "airspeed") for name in names), body=body)
        with pytest.raises(LogError, match=words) as caught:
            read(folder)
        assert str(folder) in str(caught.value)
