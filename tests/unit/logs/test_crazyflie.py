"""Crazyflie micro-SD logs: what is written comes back; what is damaged is named by its place."""

from __future__ import annotations

import struct
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


def events() -> dict[str, Event]:
    rng = np.random.default_rng(4)
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
        "fixedFrequency": Event(0xFFFF, 9.5 + 0.01 * np.arange(N), fixed),
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
    assert {name: x.tolist() for name, x in stream.columns.items()} == {"pm.vbatMV": [3700.0], "acc.z": [0.5]}


@pytest.mark.parametrize(("version", "tick"), [(1, 1e-3), (2, 1e-6)])
def test_comes_back(version: int, tick: float, tmp_path: Path) -> None:
    path = tmp_path / "log00"  # told by its first bytes: the card's files have no ending
    path.write_bytes(crazyflie_bytes(events(), version))
    recording = read(path)
    assert recording.format == "crazyflie"
    assert recording.defects == ()
    for name, event in events().items():
        stream = recording.streams[name]
        np.testing.assert_allclose(stream.time, event.time, rtol=0.0, atol=tick)
        assert tuple(stream.columns) == tuple(event.columns)
        for column, values in event.columns.items():
            np.testing.assert_array_equal(stream.columns[column], values)
    assert set(parse_crazyflie(PATH, path.read_bytes(), frozenset({"modeChanged"})).streams) == {
        "modeChanged"
    }


def test_cut_end() -> None:
    whole = crazyflie_bytes(events())
    recording = parse_crazyflie(PATH, whole[:-30])
    (defect,) = recording.defects
    assert defect.kind == "truncated"
    place = int(str(defect).split("at byte ")[1].split(",")[0])
    assert len(whole) - 60 < place < len(whole) - 30
    assert recording.streams["fixedFrequency"].time.size >= N - 3


def test_damage_costs_only_its_events() -> None:
    whole = crazyflie_bytes(events())
    middle = len(whole) // 2
    lost = parse_crazyflie(PATH, whole[:middle] + whole[middle + 5 :])
    assert any("unknown event at byte" in str(defect) for defect in lost.defects)
    assert lost.streams["fixedFrequency"].time.size >= N - 5
    changed = parse_crazyflie(PATH, whole[:-9] + bytes([whole[-9] ^ 0x40]) + whole[-8:])
    assert [defect.kind for defect in changed.defects] == ["corrupt"]
    assert "checksum" in str(changed.defects[0])
    assert changed.streams["fixedFrequency"].time.size == N
    twice = parse_crazyflie(PATH, whole + whole).streams["fixedFrequency"]  # two logs in one file
    assert np.all(np.diff(twice.time) > 0.0)
    head = b"\xbc\x02\x00\x01\x00\x01\x00n\0\x00\x00"  # nothing but unknown events ends soon
    hostile = parse_crazyflie(PATH, head + (b"\x01\x00" + b"\xff" * 8 + b"\x07\x00") * 50_000)
    assert len(hostile.defects) < 30


def test_what_is_no_log_is_said_in_one_line() -> None:
    unprintable = Event(1, np.arange(3.0), {"a": np.zeros(3, "f4")})
    for content, words in (
        (b"", "empty"),
        (b"\xbd\x02\x00", "first byte"),
        (b"\xbc\x03\x00\x00\x00", "version 3"),
        (b"\xbc\x02\x00\x01\x00\x01\x00name", "damaged header at byte 7"),
        (b"\xbc\x02\x00\x01\x00\x01\x00n\0\x01\x00x(y)\0", "no known type"),
        (b"\xbc\x02\x00\x01\x00\x01\x00n\0\xff\xff", "more variables"),
        (b"\xbc\x02\x00\x01\x00\x01\x00n\0\x02\x00x(f)\0x(f)\0", "twice"),
        (b"\xbc\x02\x00\x02\x00\x01\x00n\0\x00\x00\x01\x00m\0\x00\x00", "twice"),
        (b"\xbc\x02\x00\x01\x00\x01\x00\xff\xff\0\x00\x00", "not text"),
        (crazyflie_bytes({"fix\x06d": unprintable}), "a name is not text"),
        (b"\xbc\x02\x00\x00\x00", "no event"),
    ):
        with pytest.raises(LogError, match=words) as caught:
            parse_crazyflie(PATH, content)
        assert "\n" not in str(caught.value)
