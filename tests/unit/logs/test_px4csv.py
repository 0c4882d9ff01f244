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


@pytest.mark.parametrize("prefix", ["log_5_2021-7-20-11-12-20_", "flight3_", "", "a_vehicle_", "wind_"])
def test_topics_are_found_behind_any_prefix(tmp_path: Path, prefix: str) -> None:
    topics = (
        "vehicle_attitude",
        "vehicle_attitude_setpoint",
        "actuator_controls_0",
        "airspeed",
        "airspeed_validated",
    )
    write(tmp_path, *(f"{prefix}{topic}_0.csv.gz" for topic in topics))
    assert {file.topic for file in topic_files(tmp_path)} == set(topics)
    assert {file.prefix for file in topic_files(tmp_path)} == {prefix}


def test_time_is_the_stamp_in_seconds_and_not_shifted(tmp_path: Path) -> None:
    write(tmp_path, "log_vehicle_attitude_0.csv")
    recording = read(tmp_path)
    stream = recording.streams["vehicle_attitude"]
    assert recording.format == "px4-csv"
    np.testing.assert_allclose(stream.time, [1.0, 1.1], rtol=1e-15)
    assert np.array_equal(stream.columns["q[0]"], [1.0, 0.5])


def test_further_instances_are_numbered(tmp_path: Path) -> None:
    write(tmp_path, "log_airspeed_0.csv", "log_airspeed_1.csv", "log_battery_status_1.csv")
    assert set(read(tmp_path).streams) == {"airspeed", "airspeed/1", "battery_status"}


def test_unknown_topics_follow_the_prefix_of_the_known(tmp_path: Path) -> None:
    write(tmp_path, "log_airspeed_0.csv", "log_my_own_topic_0.csv", "other.csv")
    assert set(read(tmp_path).streams) == {"airspeed", "my_own_topic"}


def test_two_logs_in_one_folder_are_refused(tmp_path: Path) -> None:
    write(tmp_path, "a_airspeed_0.csv", "b_airspeed_0.csv")
    with pytest.raises(LogError, match=r"more than one log \(a_, b_\)"):
        read(tmp_path)


@pytest.mark.parametrize("prefix", ["log_", "", "wind_"])
def test_topics_that_end_in_the_name_of_another(tmp_path: Path, prefix: str) -> None:
    topics = {"airspeed", "vehicle_attitude", "estimator_aid_src_airspeed", "my_airspeed"}
    write(tmp_path, *(f"{prefix}{topic}_0.csv" for topic in topics))
    assert {(file.prefix, file.topic) for file in topic_files(tmp_path)} == {(prefix, t) for t in topics}


def test_a_few_topics_are_enough_to_tell_the_prefix(tmp_path: Path) -> None:
    write(tmp_path, "log_airspeed_0.csv", "log_new_airspeed_0.csv")
    assert set(read(tmp_path).streams) == {"airspeed", "new_airspeed"}


def test_two_logs_are_seen_when_one_name_extends_the_other(tmp_path: Path) -> None:
    write(tmp_path, *(f"{p}{topic}_0.csv" for p in ("log_", "log_2_") for topic in ("airspeed", "wind")))
    with pytest.raises(LogError, match=r"more than one log \(log_, log_2_\)"):
        read(tmp_path)


def test_one_bad_file_does_not_lose_the_others(tmp_path: Path) -> None:
    write(tmp_path, "log_airspeed_0.csv")
    write(tmp_path, "log_sensor_combined_0.csv", body="")
    write(tmp_path, "log_vehicle_attitude_0.csv", body="time,x\n1,2\n")
    write(tmp_path, "log_battery_status_0.csv", body="timestamp,x\nnan,2\n")
    recording = read(tmp_path)
    assert set(recording.streams) == {"airspeed"}
    assert {d.place for d in recording.defects if d.kind == "skipped"} == {
        "log_sensor_combined_0.csv",
        "log_vehicle_attitude_0.csv",
        "log_battery_status_0.csv",
    }


@pytest.mark.parametrize(
    ("names", "body", "words"),
    [
        ((), "", "no PX4 topic"),
        (("readme.csv",), BODY, "no PX4 topic"),
        (("log_airspeed_0.csv",), "", "no topic holds data"),
    ],
)
def test_a_folder_without_a_log(tmp_path: Path, names: tuple[str, ...], body: str, words: str) -> None:
    write(tmp_path, *names, body=body)
    with pytest.raises(LogError, match=words) as caught:
        read(tmp_path)
    assert str(tmp_path) in str(caught.value)
