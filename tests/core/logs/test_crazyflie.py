"""Crazyflie micro-SD logs: what is written comes back; what is damaged is named by its place."""

from pathlib import Path

import numpy as np
import pytest

from stoop.errors import LogError
from stoop.logs import read
from stoop.logs.crazyflie import parse_crazyflie
from stoop_plan.log_bytes import Event, crazyflie_bytes

PATH = Path("flight.usd")
N = 200


def events() -> dict[str, Event]:
    rng = np.random.default_rng(4)
    fixed = {"m1": rng.integers(0, 65536, N).astype(np.uint32), "x": np.float32(rng.normal(size=N))}
    sparse = {"mode": rng.integers(0, 3, 7).astype(np.uint8), "half": np.float16(rng.normal(size=7))}
    changed = Event(3, 9.503 + 0.2 * np.arange(7), sparse)
    return {"fixedFrequency": Event(0xFFFF, 9.5 + 0.01 * np.arange(N), fixed), "modeChanged": changed}


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
    some = parse_crazyflie(PATH, path.read_bytes(), frozenset({"modeChanged"}))
    assert set(some.streams) == {"modeChanged"}


def test_damage_costs_only_its_events() -> None:
    whole = crazyflie_bytes(events())
    cut = parse_crazyflie(PATH, whole[:-30])
    (defect,) = cut.defects
    assert defect.kind == "truncated"
    assert len(whole) - 60 < int(str(defect).split("at byte ")[1].split(",")[0]) < len(whole) - 30
    assert cut.streams["fixedFrequency"].time.size >= N - 3
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
