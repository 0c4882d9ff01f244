"""Logs of real autopilots: whatever pyulog finds in them, our own reader finds too, compiled or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.logs import read, ulog

SAMPLES = ("sample_log_small.ulg", "sample_appended_multiple.ulg")


@pytest.fixture(params=["plain", "compiled"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "compiled":
        monkeypatch.setattr(ulog, "LIMITS", ulog.Limits(small=0))
    return str(request.param)


def letters(text: str) -> str:
    """Leave out what a terminal would obey, and how parts are set apart."""
    return "".join(c for c in text if c.isprintable() and c != " ")


@pytest.mark.parametrize("name", SAMPLES)
def test_all_that_pyulog_finds(shared_data: Path, name: str, way: str) -> None:
    from pyulog import ULog

    path = shared_data / "px4-ulog-reader-samples" / name
    ours, theirs = read(path), ULog(str(path))
    assert {s.partition("/")[0] for s in ours.streams} == {d.name for d in theirs.data_list}
    for data in theirs.data_list:
        stream = ours.streams[f"{data.name}/{data.multi_id}" if data.multi_id else data.name]
        stamps = data.data["timestamp"] * 1e-6
        kept = np.flatnonzero(np.isin(stamps, stream.time))[: stream.time.size]
        if np.all(np.diff(stamps) > 0.0):
            assert stream.time.size == stamps.size
            for column in (c for c in data.data if "_padding" not in c and c != "timestamp"):
                np.testing.assert_array_equal(stream.columns[column], data.data[column][kept])
    assert ours.parameters == theirs.initial_parameters
    told = {k: str(v) for k, v in theirs.msg_info_dict.items() if not isinstance(v, bytes) and v != ""}
    assert told.items() <= ours.info.items()
    assert [line.partition("] ")[2] for line in ours.info["messages"].splitlines()] == [
        m.message for m in theirs.logged_messages
    ]
    for key, wholes in theirs.msg_info_multiple_dict.items():
        assert letters("".join("".join(whole) for whole in wholes)) == letters(ours.info[key])
    lost = sum(d.duration for d in theirs.dropouts)
    assert [str(d) for d in ours.defects if d.kind == "dropout"] == [
        f"{name}: the logger reports {len(theirs.dropouts)} dropouts, {1e-3 * lost:.2f} s in all"
    ] * bool(theirs.dropouts)
    assert {d.kind for d in ours.defects} <= {"dropout", "time order"}


def test_more_survives_damage_than_with_pyulog(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from pyulog import ULog

    whole = (shared_data / "px4-ulog-reader-samples" / SAMPLES[0]).read_bytes()
    path, rng = tmp_path / "damaged.ulg", np.random.default_rng(1)
    ours = theirs = 0
    for _ in range(12):
        content = bytearray(whole)
        place = int(rng.integers(60_000, len(whole) - 3000))
        content[place : place + 2000] = rng.integers(0, 256, 2000).astype(np.uint8).tobytes()
        for at in rng.integers(60_000, len(whole), 10):
            content[at] = rng.integers(0, 256)
        path.write_bytes(content)
        ours += sum(stream.time.size for stream in read(path).streams.values())
        theirs += sum(len(data.data["timestamp"]) for data in ULog(str(path)).data_list)
    capsys.readouterr()
    assert ours > theirs
    assert ours > 0.98 * 12 * 14603
