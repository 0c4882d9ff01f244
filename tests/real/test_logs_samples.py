"""Logs of real autopilots: read whole, cut anywhere, damaged anywhere."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from stoop.errors import LogError
from stoop.logs import read

SAMPLES = ("sample_log_small.ulg", "sample_appended_multiple.ulg")


@pytest.fixture
def samples(shared_data: Path) -> Path:
    return shared_data / "px4-ulog-reader-samples"


@pytest.mark.parametrize("name", SAMPLES)
def test_the_same_numbers_as_pyulog(samples: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    from pyulog import ULog

    recording = read(samples / name)
    assert capsys.readouterr().out == ""
    theirs = ULog(str(samples / name))
    for data in theirs.data_list:
        key = f"{data.name}/{data.multi_id}" if data.multi_id else data.name
        stream = recording.streams[key]
        stamps = data.data["timestamp"] * 1e-6
        kept = np.searchsorted(stamps, stream.time) if np.all(np.diff(stamps) > 0.0) else None
        if kept is not None:
            for column, values in stream.columns.items():
                np.testing.assert_array_equal(values, np.asarray(data.data[column], dtype=np.float64)[kept])


@pytest.mark.parametrize("name", SAMPLES)
def test_cut_anywhere(samples: Path, name: str, tmp_path: Path) -> None:
    whole = (samples / name).read_bytes()
    path = tmp_path / "cut.ulg"
    rows = []
    for end in (*range(0, 3000, 151), *np.linspace(3000, len(whole), 25).astype(int)):
        path.write_bytes(whole[:end])
        try:
            rows.append(sum(stream.time.size for stream in read(path).streams.values()))
        except LogError as error:
            assert "\n" not in str(error)  # noqa: PT017  both outcomes are right
            rows.append(0)
    assert rows == sorted(rows)
    assert rows[-1] > 4000


def test_damaged_anywhere(samples: Path, tmp_path: Path) -> None:
    whole = (samples / SAMPLES[1]).read_bytes()
    rng = np.random.default_rng(11)
    path = tmp_path / "damaged.ulg"
    for _ in range(40):
        content = bytearray(whole)
        for place in rng.integers(0, len(whole) if rng.random() < 0.5 else 20_000, size=30):
            content[place] = rng.integers(0, 256)
        path.write_bytes(content)
        with suppress(LogError):
            read(path)


def test_a_folder_of_topics(shared_data: Path) -> None:
    recording = read(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    assert recording.defects == ()
    assert len(recording.streams) == 18
    gyro = recording.streams["vehicle_angular_velocity"]
    assert gyro.time.size == 63002
    assert gyro.time[0] == pytest.approx(68.282822, abs=1e-9)
    assert 1.0 / gyro.period == pytest.approx(400.0, rel=1e-3)


def test_a_csv_without_a_mapping_gets_one_to_start_from(shared_data: Path) -> None:
    path = shared_data / "a430-micro-fixedwing-mocap" / "short_loop_6_20230227_120302.csv"
    with pytest.raises(LogError, match="needs a mapping") as caught:
        read(path)
    assert 'column = "Systime"' in str(caught.value)
