"""DataFlash: the same numbers as pymavlink; damage is listed with its place; nothing crashes, whatever the bytes."""

from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from naive.dataflash import same_as_pymavlink

from stoop.logs import Recording, read
from stoop.logs import dataflash_survey as scan
from stoop.logs.dataflash import parse_dataflash
from stoop.logs.dataflash_text import parse_dataflash_text
from stoop_plan.log_bytes import Table, dataflash_bytes

from .dataflash_case import SAMPLES, as_text, small_log, tables

HERE = Path("a.bin")


def test_the_same_numbers_as_pymavlink(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(small_log())
    recording = read(path)
    assert recording.defects == ()
    assert same_as_pymavlink(recording, path) == SAMPLES * (2 * 4 + 2 + 2 + 1 + 5) + 2 * 2
    assert recording.format == "dataflash"
    assert set(recording.streams) == {"IMU", "IMU/1", "ATT", "POS", "BAT", "MODE", "TST"}
    assert recording.parameters == {"ARSPD_RATIO": 2.0, "INS_POS1_X": pytest.approx(-0.05, rel=1e-6)}
    assert recording.info["firmware"] == "ArduPlane V4.5.7 (1a2b)"
    assert recording.info["messages"] == "ArduPlane V4.5.7 (1a2b)\nHi"
    assert recording.units["IMU/1"] == {"GyrX": "rad/s", "GyrY": "rad/s", "GyrZ": "rad/s"}
    assert recording.units["ATT"] == {"Roll": "deg", "Yaw": "deg"}
    assert recording.units["BAT"] == {"Volt": "mV"}
    assert recording.streams["IMU"].time[0] == 1.0


def test_bytes_and_text_leave_the_same_unread() -> None:
    silent = Table("RPM", "TimeUS,rpm1", "Qf", "sq", "F-", {"TimeUS": [], "rpm1": []})  # and never sent
    log = [*tables(), silent]
    for topics in (None, frozenset({"ATT", "BAT"}), frozenset({"ATT", "RPM"})):
        ours = parse_dataflash(HERE, dataflash_bytes(log), topics)
        text = parse_dataflash_text(HERE, as_text(log), topics)
        assert list(ours.unread.items()) == list(text.unread.items())
        assert "RPM" not in ours.unread
        if topics:
            assert set(ours.streams) == set(text.streams) == topics - {"RPM"}
            assert set(ours.unread) == {"IMU", "ATT", "BAT", "POS", "MODE", "TST"} - topics


def test_text_with_units_parameters_and_commas() -> None:
    text = (
        b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT,1,2,UNIT,QbZ,TimeUS,Id,Label\n"
        b"FMT,2,2,MULT,Qbd,TimeUS,Id,Mult\nFMT,3,2,FMTU,QBNN,TimeUS,FmtType,UnitIds,MultIds\n"
        b"FMT, 5, 2, PARM, QNf, TimeUS,Name,Value\nFMT, 6, 2, MSG, QZ, TimeUS,Message\nFMT,7,2,GYR,QBf,TimeUS,I,GyrX\n"
        b"UNIT, 0, 69, rad/s\nUNIT, 0, 35, instance\nMULT, 0, 67, 0.001\nFMTU, 0, 7, s#E, F-C\n"
        b"FMT, \xb2, 50, BAD, QB, TimeUS,I\n"
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
    head = (
        b"FMT,1,2,UNIT,QbZ,TimeUS,Id,Label\nFMT,3,2,FMTU,QBNN,TimeUS,FmtType,UnitIds,MultIds\n"
        b"FMT,7,2,GYR,QBf,TimeUS,I,GyrX\nUNIT, 0, 35, instance\nFMTU, 0, 7, s#E, F-0\n"
    )
    for number in (b"nan", b"inf", b"x", b"", b"1e400", b"9" * 400):
        rows = (b"GYR, %d, %s, %d\n" % (k, number if k % 3 == 0 else b"0", k) for k in range(1, 10))
        streams = parse_dataflash_text(Path("a.log"), head + b"".join(rows)).streams
        assert streams["GYR"].columns["GyrX"].tolist() == [1.0, 2.0, 4.0, 5.0, 7.0, 8.0]
        name = "GYR/inf" if number in (b"inf", b"1e400", b"9" * 400) else "GYR/nan"
        assert streams[name].columns["GyrX"].tolist() == [3.0, 6.0, 9.0]
    nine = np.arange(9)
    for value in (np.nan, np.inf, -np.inf):
        columns = {"TimeUS": 1000 * nine + 1000, "I": np.where(nine % 3, 0.0, value), "GyrX": nine}
        table = Table("IMU", "TimeUS,I,GyrX", "Qff", "s#E", "F-0", columns)
        streams = parse_dataflash(Path("a.bin"), dataflash_bytes([table], {}, [])).streams
        assert streams["IMU"].time.size == 6
        assert streams[f"IMU/{value:g}"].columns["GyrX"].tolist() == [0.0, 3.0, 6.0]


def test_damage_is_listed_by_its_place() -> None:
    whole = small_log()
    first = whole.index(b"\xa3\x95", len(whole) // 2)
    for new, lost, told in (
        (bytes(300), 0, f"a.bin byte {first}: 300 bytes are no message and were skipped"),
        (3 * b"\xa3\x95\xc8abc", 0, "a.bin: messages of undefined kinds skipped: 200 (1)"),
        (whole[first : first + 5], 10, f"a.bin byte {first}"),  # lost bytes cost one message
    ):
        recording = parse_dataflash(HERE, whole[:first] + new + whole[first + lost :])
        (defect,) = recording.defects
        assert str(defect).startswith(told)
        assert rows(recording) == rows(parse_dataflash(HERE, whole)) - bool(lost)


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
