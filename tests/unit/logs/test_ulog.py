"""ULog: a small log is read; a damaged one, wherever damaged, raises LogError only and prints nothing."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stoop.errors import LogError
from stoop.logs import read
from stoop.logs.ulog import MAGIC

any_file = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def definitions(*formats: str) -> bytes:
    head = MAGIC + b"\x01" + struct.pack("<Q", 1_000_000) + message("B", bytes(40))
    return head + b"".join(message("F", text.encode()) for text in formats)


def small_log(samples: int = 20) -> bytes:
    log = definitions("gyro:uint64_t timestamp;float[3] xyz;uint8_t n;", "baro:uint64_t timestamp;double p;")
    log += message("A", struct.pack("<BH", 0, 7) + b"gyro") + message("A", struct.pack("<BH", 1, 8) + b"gyro")
    log += message("A", struct.pack("<BH", 0, 9) + b"baro")
    for i in range(samples):
        stamp = 1_000_000 + 10_000 * i
        log += message("D", struct.pack("<HQfffB", 7, stamp, i, -i, 0.5 * i, i))
        log += message("D", struct.pack("<HQfffB", 8, stamp + 1, 1, 2, 3, 4))
        log += message("D", struct.pack("<HQd", 9, stamp, 0.1 * i))
    return log + message("O", struct.pack("<H", 250))


def write(folder: Path, content: bytes) -> Path:
    path = folder / "a.ulg"
    path.write_bytes(content)
    return path


def test_a_small_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = read(write(tmp_path, small_log()))
    assert recording.format == "ulog"
    assert set(recording.streams) == {"gyro", "gyro/1", "baro"}
    gyro = recording.streams["gyro"]
    np.testing.assert_allclose(gyro.time, 1.0 + 0.01 * np.arange(20))
    assert np.array_equal(gyro.columns["xyz[2]"], 0.5 * np.arange(20))
    assert gyro.columns["n"].dtype == np.float64
    assert np.array_equal(recording.streams["baro"].columns["p"], 0.1 * np.arange(20))
    assert [str(d) for d in recording.defects] == ["a.ulg: the logger reports 1 dropouts, 0.25 s in all"]
    assert capsys.readouterr().out == ""


def test_cut_at_every_byte(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = small_log(4)
    read_at_all = 0
    for end in range(len(whole)):
        try:
            recording = read(write(tmp_path, whole[:end]))
        except LogError:
            continue
        read_at_all += 1
        assert all(stream.time.size <= 4 for stream in recording.streams.values())
    assert read_at_all > 250
    assert capsys.readouterr().out == ""


def test_a_cut_log_says_so(tmp_path: Path) -> None:
    defects = read(write(tmp_path, small_log()[:-8])).defects
    assert [d.kind for d in defects] == ["truncated"]


@any_file
@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=4))
def test_damaged_bytes(tmp_path: Path, damage: list[tuple[int, int]]) -> None:
    content = bytearray(small_log(5))
    for place, byte in damage:
        content[place % len(content)] = byte
    with suppress(LogError):
        read(write(tmp_path, bytes(content)))


@any_file
@given(st.binary(max_size=300))
def test_any_bytes_after_the_magic(tmp_path: Path, content: bytes) -> None:
    with suppress(LogError):
        read(write(tmp_path, MAGIC + content))


def test_formats_that_hold_themselves(tmp_path: Path) -> None:
    log = definitions("a:uint64_t timestamp;a x;") + message("A", struct.pack("<BH", 0, 1) + b"a")
    with pytest.raises(LogError):
        read(write(tmp_path, log))


def test_formats_that_unfold_to_millions_of_fields(tmp_path: Path) -> None:
    nested = [f"f{i}:f{i + 1}[1000] x;" for i in range(6)]
    log = definitions(*nested, "f6:uint8_t[1000] x;") + message("A", struct.pack("<BH", 0, 1) + b"f0")
    with pytest.raises(LogError):
        read(write(tmp_path, log))


def test_many_subscriptions_of_a_wide_format(tmp_path: Path) -> None:
    log = definitions("w:uint64_t timestamp;uint8_t[60000] x;")
    log += b"".join(message("A", struct.pack("<BH", 0, n) + b"w") for n in range(300))
    with pytest.raises(LogError):
        read(write(tmp_path, log))
