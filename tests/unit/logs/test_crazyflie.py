"""Crazyflie micro-SD logs: what is written comes back; what is damaged is named by its place."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from stoop.errors import LogError
from stoop.exporters.log_bytes import Event, crazyflie_bytes
from stoop.logs import read
from stoop.logs.crazyflie import parse_crazyflie

PATH = Path("flight.usd")
N = 200


@pytest.fixture
def events() -> dict[str, Event]:
    rng = np.random.default_rng(4)
    time = 9.5 + 0.01 * np.arange(N)
    fixed: dict[str, npt.NDArray[Any]] = {
        "motor.m1": rng.integers(0, 65536, N).astype(np.uint32),
        "pm.vbatMV": rng.integers(3000, 4200, N).astype(np.uint16),
        "stateEstimate.x": rng.normal(size=N).astype(np.float32),
    }
    sparse: dict[str, npt.NDArray[Any]] = {
        "mode": rng.integers(0, 3, 7).astype(np.uint8),
        "half": rng.normal(size=7).astype(np.float16),
    }
    return {
        "fixedFrequency": Event(0xFFFF, time, fixed),
        "modeChanged": Event(3, 9.503 + 0.2 * np.arange(7), sparse),
    }


def by_hand() -> bytes:
    """A log of one event, byte for byte as the firmware's documentation describes it; CRC-32 of a known text aside."""
    return (
        b"\xbc" + struct.pack("<HH", 2, 1) + struct.pack("<H", 65535) + b"fixedFrequency\0"
        + struct.pack("<H", 2) + b"pm.vbatMV(H)\0acc.z(f)\0"
        + struct.pack("<HQHf", 65535, 1_500_000, 3700, 0.5)
    )  # fmt: skip


def test_layout_as_documented() -> None:
    stream = parse_crazyflie(PATH, by_hand()).streams["fixedFrequency"]
    assert stream.time.tolist() == [1.5]
    assert {name: column.tolist() for name, column in stream.columns.items()} == {
        "pm.vbatMV": [3700.0],
        "acc.z": [0.5],
    }


@pytest.mark.parametrize(("version", "tick"), [(1, 1e-3), (2, 1e-6)])
def test_comes_back(events: dict[str, Event], version: int, tick: float, tmp_path: Path) -> None:
    path = tmp_path / "log00"  # told by its first bytes: the card's files have no ending
    path.write_bytes(crazyflie_bytes(events, version))
    recording = read(path)
    assert recording.format == "crazyflie"
    assert recording.defects == ()
    for name, event in events.items():
        stream = recording.streams[name]
        np.testing.assert_allclose(stream.time, event.time, rtol=0.0, atol=tick)
        assert tuple(stream.columns) == tuple(event.columns)
        for column, values in event.columns.items():
            np.testing.assert_array_equal(stream.columns[column], values)


def test_only_the_events_asked_for(events: dict[str, Event]) -> None:
    recording = parse_crazyflie(PATH, crazyflie_bytes(events), frozenset({"modeChanged"}))
    assert set(recording.streams) == {"modeChanged"}


def test_cut_end(events: dict[str, Event]) -> None:
    whole = crazyflie_bytes(events)
    recording = parse_crazyflie(PATH, whole[:-30])
    (defect,) = recording.defects
    assert defect.kind == "truncated"
    place = int(str(defect).split("at byte ")[1].split(",")[0])
    assert len(whole) - 60 < place < len(whole) - 30
    assert recording.streams["fixedFrequency"].time.size >= N - 3


def test_wrong_value(events: dict[str, Event]) -> None:
    whole = bytearray(crazyflie_bytes(events))
    whole[-9] ^= 0x40
    recording = parse_crazyflie(PATH, bytes(whole))
    assert [defect.kind for defect in recording.defects] == ["corrupt"]
    assert "checksum" in str(recording.defects[0])
    assert recording.streams["fixedFrequency"].time.size == N


def test_lost_bytes_cost_only_their_events(events: dict[str, Event]) -> None:
    whole = crazyflie_bytes(events)
    middle = len(whole) // 2
    recording = parse_crazyflie(PATH, whole[:middle] + whole[middle + 5 :])
    assert any("unknown event at byte" in str(defect) for defect in recording.defects)
    assert recording.streams["fixedFrequency"].time.size >= N - 5


def test_two_logs_in_one_file_do_not_confuse_the_clock(events: dict[str, Event]) -> None:
    whole = crazyflie_bytes(events)
    stream = parse_crazyflie(PATH, whole + whole).streams["fixedFrequency"]
    assert np.all(np.diff(stream.time) > 0.0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\xbd\x02\x00", "first byte"),
        (b"\xbc\x03\x00\x00\x00", "version 3"),
        (b"\xbc\x02\x00\x01\x00\x01\x00name", "damaged header at byte 7"),
        (b"\xbc\x02\x00\x01\x00\x01\x00n\0\x01\x00x(y)\0", "no known type"),
        (b"\xbc\x02\x00\x01\x00\x01\x00n\0\xff\xff", "more variables"),
        (b"\xbc\x02\x00\x01\x00\x01\x00n\0\x02\x00x(f)\0x(f)\0", "twice"),
        (b"\xbc\x02\x00\x02\x00\x01\x00n\0\x00\x00\x01\x00m\0\x00\x00", "twice"),
        (b"\xbc\x02\x00\x01\x00\x01\x00\xff\xff\0\x00\x00", "not text"),
        (b"\xbc\x02\x00\x00\x00", "no event"),
    ],
)
def test_what_is_no_log_is_said_in_one_line(content: bytes, words: str) -> None:
    with pytest.raises(LogError, match=words) as caught:
        parse_crazyflie(PATH, content)
    assert "\n" not in str(caught.value)


def test_damaged_anywhere(events: dict[str, Event]) -> None:
    whole = crazyflie_bytes(events)
    rng = np.random.default_rng(8)
    for _ in range(300):
        content = bytearray(whole)
        for place in rng.integers(0, len(content), rng.integers(1, 30)):
            content[place] = rng.integers(256)
        with suppress(LogError):
            recording = parse_crazyflie(PATH, bytes(content[: rng.integers(1, len(content) + 1)]))
            assert all(np.all(np.diff(stream.time) > 0.0) for stream in recording.streams.values())


def test_nothing_but_unknown_events_ends_soon() -> None:
    head = b"\xbc\x02\x00\x01\x00\x01\x00n\0\x00\x00"
    hostile = head + (b"\x01\x00" + b"\xff" * 8 + b"\x07\x00") * 50_000
    recording = parse_crazyflie(PATH, hostile)
    assert len(recording.defects) < 30


def test_a_name_that_cannot_be_printed_is_damage(tmp_path: Path) -> None:
    event = Event(1, np.arange(3.0), {"a": np.zeros(3, "f4")})
    with pytest.raises(LogError, match="a name is not text"):
        parse_crazyflie(tmp_path / "a.usd", crazyflie_bytes({"fix\x06d": event}))
