"""DataFlash: the same numbers as pymavlink; damage is listed with its place; nothing crashes, whatever the bytes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from naive.dataflash import same_as_pymavlink

from stoop.errors import LogError
from stoop.exporters.log_bytes import Table, dataflash_bytes
from stoop.logs import Recording, read
from stoop.logs import dataflash_survey as scan
from stoop.logs.dataflash import parse_dataflash
from stoop.logs.dataflash_text import parse_dataflash_text

from .dataflash_case import SAMPLES, as_text, small_log, tables

any_file = settings(
    deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150
)
HERE = Path("a.bin")


def write(folder: Path, content: bytes, name: str = "a.bin") -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def test_the_same_numbers_as_pymavlink(tmp_path: Path) -> None:
    path = write(tmp_path, small_log())
    recording = read(path)
    assert recording.defects == ()
    assert same_as_pymavlink(recording, path) == SAMPLES * (2 * 4 + 2 + 2 + 1 + 5) + 2 * 2


def test_what_the_log_says_of_itself(tmp_path: Path) -> None:
    recording = read(write(tmp_path, small_log()))
    assert recording.format == "dataflash"
    assert set(recording.streams) == {"IMU", "IMU/1", "ATT", "POS", "BAT", "MODE", "TST"}
    assert recording.parameters == {"ARSPD_RATIO": 2.0, "INS_POS1_X": pytest.approx(-0.05, rel=1e-6)}
    assert recording.info["firmware"] == "ArduPlane V4.5.7 (1a2b)"
    assert recording.info["messages"] == "ArduPlane V4.5.7 (1a2b)\nHi"
    assert recording.units["IMU/1"] == {"GyrX": "rad/s", "GyrY": "rad/s", "GyrZ": "rad/s"}
    assert recording.units["ATT"] == {"Roll": "deg", "Yaw": "deg"}
    assert recording.units["BAT"] == {"Volt": "mV"}
    assert recording.streams["IMU"].time[0] == 1.0


@pytest.mark.parametrize("parse", [parse_dataflash, parse_dataflash_text])
def test_only_what_is_wanted(parse: Callable[..., Recording]) -> None:
    content = small_log() if parse is parse_dataflash else as_text(tables())
    recording = parse(HERE, content, frozenset({"ATT", "BAT"}))
    assert set(recording.streams) == {"ATT", "BAT"}
    assert set(recording.unread) == {"IMU", "POS", "MODE", "TST"}


def test_bytes_and_text_leave_the_same_unread() -> None:
    silent = Table(
        "RPM", "TimeUS,rpm1", "Qf", "sq", "F-", {"TimeUS": [], "rpm1": []}
    )  # defined, and never sent
    log = [*tables(), silent]
    for topics in (None, frozenset({"ATT"}), frozenset({"ATT", "RPM"})):
        both = (
            parse_dataflash(HERE, dataflash_bytes(log), topics),
            parse_dataflash_text(HERE, as_text(log), topics),
        )
        assert list(both[0].unread.items()) == list(both[1].unread.items())
        assert "RPM" not in both[0].unread


def test_text_holds_the_same(tmp_path: Path) -> None:
    log = tables()[1:]  # no units here, and thus no instances
    path = write(tmp_path, as_text(log), "a.log")
    recording = read(path)
    assert recording.defects == ()
    att = log[0].values
    np.testing.assert_array_equal(recording.streams["ATT"].columns["Roll"], att["Roll"])
    assert same_as_pymavlink(recording, path) > 5 * SAMPLES


def test_text_with_units_parameters_and_commas() -> None:
    text = (
        b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT,1,2,UNIT,QbZ,TimeUS,Id,Label\n"
        b"FMT,2,2,MULT,Qbd,TimeUS,Id,Mult\nFMT,3,2,FMTU,QBNN,TimeUS,FmtType,UnitIds,MultIds\n"
        b"FMT, 5, 2, PARM, QNf, TimeUS,Name,Value\nFMT, 6, 2, MSG, QZ, TimeUS,Message\nFMT,7,2,GYR,QBf,TimeUS,I,GyrX\n"
        b"UNIT, 0, 69, rad/s\nUNIT, 0, 35, instance\nMULT, 0, 67, 0.001\nFMTU, 0, 7, s#E, F-C\n"
        b"PARM, 1, A_B, 3.5\nMSG, 2, ArduCopter V4.3, hello, world\nGYR, 5, 1, 2.5\nGYR, 5, 0, 3.5\nGYR, 9, 0, nan\n"
        b"GYR, 11, 0\nXYZ, 1, 2\n\x00\xff\nGYR, 12, 0, abc\n"
    )
    recording = parse_dataflash_text(Path("a.log"), text)
    assert recording.parameters == {"A_B": 3.5}
    assert recording.info["firmware"] == "ArduCopter V4.3, hello, world"
    assert recording.units["GYR/1"] == {"GyrX": "mrad/s"}
    np.testing.assert_array_equal(recording.streams["GYR"].columns["GyrX"], [3.5, np.nan, np.nan])
    assert {(d.kind, d.place) for d in recording.defects} == {
        ("corrupt", f"a.log byte {text.index(bytes([0, 255]))}"), ("corrupt", "GYR"), ("text", "GYR"),
        ("skipped", f"a.log byte {text.index(b'XYZ')}"),
    }  # fmt: skip


@pytest.mark.parametrize("number", [b"nan", b"inf", b"x", b"", b"1e400", b"9" * 400])
def test_instances_that_no_number_counts(number: bytes) -> None:
    """NaN is equal to nothing, not even to itself."""
    text = (
        b"FMT,1,2,UNIT,QbZ,TimeUS,Id,Label\nFMT,3,2,FMTU,QBNN,TimeUS,FmtType,UnitIds,MultIds\n"
        b"FMT,7,2,GYR,QBf,TimeUS,I,GyrX\nUNIT, 0, 35, instance\nFMTU, 0, 7, s#E, F-0\n"
    )
    text += b"".join(b"GYR, %d, %s, %d\n" % (k, number if k % 3 == 0 else b"0", k) for k in range(1, 10))
    streams = parse_dataflash_text(Path("a.log"), text).streams
    assert streams["GYR"].columns["GyrX"].tolist() == [1.0, 2.0, 4.0, 5.0, 7.0, 8.0]
    name = "GYR/inf" if number in (b"inf", b"1e400", b"9" * 400) else "GYR/nan"
    assert streams[name].columns["GyrX"].tolist() == [3.0, 6.0, 9.0]


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_instances_that_no_number_counts_in_binary(number: float) -> None:
    kinds = np.where(np.arange(9) % 3, 0.0, number)
    table = Table("IMU", "TimeUS,I,GyrX", "Qff", "s#E", "F-0",
                  {"TimeUS": 1000 * np.arange(1, 10), "I": kinds, "GyrX": np.arange(9)})  # fmt: skip
    streams = parse_dataflash(Path("a.bin"), dataflash_bytes([table], {}, [])).streams
    assert streams["IMU"].time.size == 6
    assert streams[f"IMU/{number:g}"].columns["GyrX"].tolist() == [0.0, 3.0, 6.0]


def test_damage_is_listed_by_its_place() -> None:
    whole = small_log()
    first = whole.index(b"\xa3\x95", len(whole) // 2)
    damaged = whole[:first] + bytes(300) + whole[first:]
    recording = parse_dataflash(HERE, damaged)
    assert [str(d) for d in recording.defects] == [
        f"a.bin byte {first}: 300 bytes are no message and were skipped"
    ]
    assert rows(recording) == rows(parse_dataflash(HERE, whole))


def test_lost_bytes_cost_one_message() -> None:
    whole = small_log()
    first = whole.index(b"\xa3\x95", len(whole) // 2)
    recording = parse_dataflash(HERE, whole[: first + 5] + whole[first + 10 :])
    assert [d.kind for d in recording.defects] == ["corrupt"]
    assert recording.defects[0].place == f"a.bin byte {first}"
    assert rows(recording) == rows(parse_dataflash(HERE, whole)) - 1


def test_messages_of_undefined_kinds_are_counted() -> None:
    whole = small_log()
    first = whole.index(b"\xa3\x95", len(whole) // 2)
    strange = whole[:first] + 3 * b"\xa3\x95\xc8abc" + whole[first:]
    recording = parse_dataflash(HERE, strange)
    assert [str(d) for d in recording.defects] == ["a.bin: messages of undefined kinds skipped: 200 (1)"]
    assert rows(recording) == rows(parse_dataflash(HERE, whole))


def test_older_clocks() -> None:
    stamps = np.arange(100, 200, 10)
    week = {"TimeMS": 5 * stamps, "Week": np.full(10, 1800), "T": stamps}
    log = [
        Table("IMU", "TimeMS,GyrX", "If", "--", "--", {"TimeMS": stamps, "GyrX": np.ones(10)}),
        Table("GPS", "TimeMS,Week,T", "IHI", "---", "---", week),
        Table("OLD", "GyrX", "f", "-", "-", {"GyrX": np.ones(3)}),
    ]
    recording = parse_dataflash(HERE, dataflash_bytes(log))
    np.testing.assert_allclose(recording.streams["IMU"].time, 1e-3 * stamps)
    np.testing.assert_allclose(recording.streams["GPS"].time, 1e-3 * stamps)
    assert [str(d) for d in recording.defects] == ["OLD: 3 messages skipped: they have no time"]


def test_compiled_and_plain_walk_find_the_same() -> None:
    from stoop.logs.compiled import dataflash

    rng = np.random.default_rng(4)
    whole = np.frombuffer(small_log(20), np.uint8)
    for _ in range(20):
        data = whole.copy()
        data[rng.integers(0, data.size, 8)] = rng.integers(0, 256, 8)
        plain = scan.survey(data)
        rows = scan.gather(data, plain, [1, 2, 3])
        with mock.patch.object(scan, "walk", dataflash().walk):
            again = scan.survey(data)
            np.testing.assert_array_equal(np.concatenate(list(map(np.ravel, vars(plain).values()))),
                                          np.concatenate(list(map(np.ravel, vars(again).values()))))  # fmt: skip
            for k, block in scan.gather(data, again, [1, 2, 3]).items():
                np.testing.assert_array_equal(block, rows[k])


def test_windows_leave_no_seams() -> None:
    data = np.frombuffer(small_log(), np.uint8).copy()
    data[3000:3100] = 0
    whole, ends = scan.survey(data), []
    with mock.patch.object(scan, "WINDOW", 97):
        parts = scan.survey(data)
        block = scan.gather(data, parts, [6], ends.append)[6]
    np.testing.assert_array_equal(whole.count, parts.count)
    np.testing.assert_array_equal(whole.gaps, parts.gaps)
    np.testing.assert_array_equal(block, scan.gather(data, whole, [6])[6])
    assert len(ends) > 20
    assert ends[-1] == data.size


def rows(recording: Recording) -> int:
    return sum(stream.time.size for stream in recording.streams.values())


@pytest.mark.parametrize(
    ("name", "content"), [("a.bin", b""), ("a.log", b""), ("a.bin", b"\xa3\x95\x80"), ("a.log", b"FMT,")]
)
def test_nothing_to_read(tmp_path: Path, name: str, content: bytes) -> None:
    with pytest.raises(LogError) as caught:
        read(write(tmp_path, content, name))
    assert "\n" not in str(caught.value)


BASES = {parse_dataflash: small_log(12), parse_dataflash_text: as_text(tables(12))}
TOKENS = st.sampled_from(
    [b"\xa3\x95", b"\xa3\x95\x80", b"\xa3\x95\x80\x01\x03", b"\xff" * 9, bytes(40), b",", b"FMT,", b"\n"]
)


@any_file
@given(
    parse=st.sampled_from([parse_dataflash, parse_dataflash_text]),
    edits=st.lists(
        st.tuples(st.integers(0, 2**16), st.integers(0, 20), TOKENS | st.binary(max_size=12)), max_size=8
    ),
    end=st.integers(0, 2**16),
)
def test_any_damage(parse: Callable[..., Recording], edits: list[tuple[int, int, bytes]], end: int) -> None:
    content = bytearray(BASES[parse])
    for at, length, new in edits:
        at %= len(content)
        content[at : at + length] = new
    content = content[: max(end % (2 * len(content)), 1)]
    try:
        recording = parse(HERE, bytes(content))
    except LogError as error:
        assert "\n" not in str(error)  # noqa: PT017  both outcomes are right
        return
    for stream in recording.streams.values():
        assert np.all(np.diff(stream.time) > 0.0)
        assert all(values.shape == stream.time.shape for values in stream.columns.values())


@given(st.binary(max_size=400))
def test_any_bytes(content: bytes) -> None:
    for parse in BASES:
        with suppress(LogError):
            parse(HERE, content)


def test_a_digit_that_is_no_number_defines_nothing(tmp_path: Path) -> None:
    lines = "FMT, \u00b2, 50, BAD, QB, TimeUS,I\nFMT, 2, 50, ATT, QB, TimeUS,I\nATT, 1000, 2\nATT, 2000, 3\n"
    recording = parse_dataflash_text(tmp_path / "a.log", lines.encode("latin-1"))
    assert set(recording.streams) == {"ATT"}
