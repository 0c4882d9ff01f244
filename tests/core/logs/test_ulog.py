"""ULog: what the log holds is what pyulog, an independent reader, finds in it; damage costs what it covers."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop.errors import LogError
from stoop.logs import Recording, read
from stoop.logs import ulog as reader
from stoop.logs.ulog import MAGIC
from stoop.logs.ulog_messages import BodyError, Formats
from stoop_plan import log_bytes
from stoop_plan.log_bytes import Topic, ulog, ulog_dropout, ulog_message, ulog_text

SYNC = bytes([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12])
HEAD = MAGIC + b"\x01" + struct.pack("<Q", 1_000_000)
FORMATS = (
    b"cell:float volts;uint8_t[3] flags;uint8_t[1] _padding0;",
    b"pack:uint64_t timestamp;cell[2] cells;cell spare;int16_t[2] amps;char mark;bool on;uint8_t[5] _padding0;",
    b"plain:uint64_t timestamp;double x;",
)


def keyed(kind: str, key: str, value: bytes, before: bytes = b"") -> bytes:
    return ulog_message(kind, before + bytes([len(key)]) + key.encode() + value)


def flags(compatible: int = 0, incompatible: int = 0, offsets: tuple[int, ...] = ()) -> bytes:
    places = struct.pack("<3Q", *(*offsets, 0, 0, 0)[:3])
    return ulog_message("B", bytes([compatible, *bytes(7), incompatible, *bytes(7)]) + places)


def row(number: int, layout: str, *values: float) -> bytes:
    return ulog_message("D", struct.pack("<H" + layout, number, *values))


def add(number: int, name: str, instance: int = 0) -> bytes:
    return ulog_message("A", struct.pack("<BH", instance, number) + name.encode())


def everything() -> bytes:
    log = HEAD + flags(1) + b"".join(ulog_message("F", f) for f in FORMATS)
    log += keyed("I", "char[4] sys_name", b"PX4!") + keyed("I", "uint32_t ver", struct.pack("<I", 7))
    log += keyed("M", "char[5] boot", b"first", b"\0") + keyed("M", "char[6] boot", b"second", b"\x01")
    log += keyed("P", "float GAIN", struct.pack("<f", 0.5))
    log += keyed("P", "int32_t MODE", struct.pack("<i", -3))
    log += keyed("Q", "float GAIN", struct.pack("<f", 0.25), b"\x03")
    log += add(3, "pack") + add(4, "plain") + add(5, "plain", 2)
    for i in range(30):
        stamp = 2_000_000 + 1000 * i
        cells = [x for _ in range(3) for x in (0.5 * i, 1, 2, i, 0)]
        log += row(3, "Q" + 3 * "f4B" + "2hc?", stamp, *cells, -i, i, b"m", i % 2)
        log += row(4, "Qd", stamp, 0.1 * i) + row(5, "Qd", stamp + 5, -0.1 * i)
        log += {
            3: ulog_message("S", SYNC),
            5: ulog_text(2.005, "WARNING", "too low"),
            7: ulog_message("C", struct.pack("<BHQ", ord("4"), 9, 2_007_000) + b"from nine"),
            9: ulog_dropout(120),
            11: keyed("P", "float GAIN", struct.pack("<f", 0.75)),
            13: ulog_message("Z", b"of a later kind"),
        }.get(i, b"")
    return log + ulog_message("R", struct.pack("<H", 4))


def small() -> bytes:
    time = 1.0 + 0.01 * np.arange(40)
    gyro = {f"xyz[{i}]": (time + i).astype("f4") for i in range(3)}
    topics = [
        Topic("gyro", time, gyro),
        Topic("gyro", time[::2], {name: x[::2] for name, x in gyro.items()}, 1),
        Topic("baro", time[::4], {"p": time[::4], "n": np.arange(10, dtype="u2")}),
    ]
    return ulog(topics, {"A": 1, "B": 0.5}, {"sys_name": "PX4"}, [(1.0, "INFO", "ready")]) + ulog_dropout(50)


def recorded(folder: Path, content: bytes, topics: frozenset[str] | None = None) -> Recording:
    (folder / "a.ulg").write_bytes(content)
    return read(folder / "a.ulg", topics=topics)


def test_each_kind_of_message(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pyulog import ULog

    ours = recorded(tmp_path, everything())
    assert capsys.readouterr().out == ""
    pyulog = ULog(str(tmp_path / "a.ulg"))
    theirs = {f"{d.name}/{d.multi_id}" if d.multi_id else d.name: d.data for d in pyulog.data_list}
    assert set(ours.streams) == set(theirs)
    for name, data in theirs.items():
        stream = ours.streams[name]
        np.testing.assert_array_equal(stream.time, data["timestamp"] * 1e-6)
        known = {key for key in data if "_padding" not in key} - {"timestamp"}
        assert set(stream.columns) == known
        for key in known:
            np.testing.assert_array_equal(stream.columns[key], data[key])
    assert np.array_equal(ours.streams["pack"].columns["cells[1].flags[2]"], np.arange(30))
    assert ours.parameters == {"GAIN": 0.5, "MODE": -3.0}
    info = ours.info
    assert (info["sys_name"], info["ver"], info["boot"]) == ("PX4!", "7", "first\nsecond")
    assert info["messages"] == "2.005 s [WARNING] too low\n2.007 s [WARNING] from nine"
    assert info["parameter changes"] == "2.011 s GAIN = 0.75"
    assert info["parameter defaults, system"] == info["parameter defaults, airframe"] == "GAIN = 0.25"
    unknown, dropout = ours.defects
    assert (unknown.kind, dropout.kind) == ("skipped", "dropout")
    assert "1 messages of unknown kinds" in str(unknown)
    assert str(dropout) == "a.ulg: the logger reports 1 dropouts, 0.12 s in all"
    assert ours.parameters == pyulog.initial_parameters
    assert pyulog.changed_parameters == [(2_011_005, "GAIN", 0.75)]
    assert pyulog.get_default_parameters(0) == {"GAIN": 0.25}
    assert [d.duration for d in pyulog.dropouts] == [120]


def test_only_the_topics_wanted_and_appended_data(tmp_path: Path) -> None:
    whole = recorded(tmp_path, everything())
    part = recorded(tmp_path, everything(), frozenset({"plain", "not there"}))
    assert set(part.streams) == {"plain", "plain/2"}
    np.testing.assert_array_equal(part.streams["plain/2"].columns["x"], whole.streams["plain/2"].columns["x"])
    with pytest.raises(LogError, match="none of the topics wanted, but pack, plain; log others"):
        recorded(tmp_path, everything(), frozenset({"not there"}))
    empty = HEAD + flags(0, 1, (2**20,)) + ulog_message("F", FORMATS[2]) + add(4, "plain")
    first = b"".join(row(4, "Qd", 2_000_000 + i, i) for i in range(10)) + row(4, "Qd", 1, 1)[:-4]
    last = b"".join(row(4, "Qd", 3_000_000 + i, -i) for i in range(5))
    log = empty.replace(struct.pack("<Q", 2**20), struct.pack("<Q", len(empty) + len(first))) + first + last
    ours = recorded(tmp_path, log)
    assert ours.streams["plain"].time.size == 15  # pyulog forgets its topics there, and finds ten
    assert ours.defects == ()
    outside = HEAD + flags(0, 1, (2**40,)) + ulog_message("F", FORMATS[2]) + add(4, "plain")
    assert [d.kind for d in recorded(tmp_path, outside + row(4, "Qd", 1, 1.0)).defects] == ["skipped"]


def test_a_topic_given_again_goes_on(tmp_path: Path) -> None:
    log = HEAD + flags() + ulog_message("F", FORMATS[2]) + add(4, "plain") + row(4, "Qd", 1_000_000, 1.0)
    log += ulog_message("R", struct.pack("<H", 4)) + add(6, "plain") + row(6, "Qd", 2_000_000, 2.0)
    assert np.array_equal(recorded(tmp_path, log).streams["plain"].columns["x"], [1.0, 2.0])
    log = HEAD + flags() + ulog_message("F", FORMATS[2]) + add(4, "plain") + add(9, "lost")
    at = len(log) - len(add(9, "lost"))
    log += b"".join(row(4, "Qd", i + 1, i) + row(9, "Qd", i + 1, i) for i in range(4))
    skipped, corrupt = recorded(tmp_path, log).defects
    assert str(skipped) == f"a.ulg, byte {at}: a message was skipped: there is no format 'lost'"
    assert corrupt.kind == "corrupt"
    assert corrupt.message == "4 rows skipped of topics that the log does not define"


@pytest.mark.parametrize("damage", [b"\xff" * 7, b"\0" * 5000, bytes(range(256)) * 20])
def test_damage_costs_what_it_covers(tmp_path: Path, damage: bytes) -> None:
    log, one = everything(), row(4, "Qd", 1, 1.0)
    at = log.index(ulog_text(2.005, "WARNING", "too low"))
    ours = recorded(tmp_path, log[:at] + damage + log[at:])
    assert ours.streams["plain"].time.size == 30
    assert ours.info["messages"].startswith("2.005 s")
    corrupt = next(d for d in ours.defects if d.kind == "corrupt")
    assert str(corrupt) == f"a.ulg, byte {at}: {len(damage)} damaged bytes were skipped"
    hit = recorded(tmp_path, log[: at - len(one)] + damage + log[at - len(one) + 9 :])
    assert 28 <= hit.streams["plain"].time.size + hit.streams["plain/2"].time.size - 30 <= 30
    wrong = bytearray(log)
    wrong[at - 2 * len(one)] ^= 0x40  # a wrong size loses one message
    ours = recorded(tmp_path, bytes(wrong))
    assert [ours.streams[n].time.size for n in ("pack", "plain", "plain/2")] == [30, 29, 30]


def long_log() -> bytes:
    time = 1.0 + np.arange(6000) / 400.0
    gyro = Topic("gyro", time, {f"xyz[{i}]": (time * (i + 1)).astype("f4") for i in range(3)})
    mode = Topic("mode", time[::10], {"n": np.arange(600, dtype="u1"), "on": np.ones(600, dtype=bool)}, 1)
    head = log_bytes.ulog_definitions([gyro, mode], {"A": 1, "B": 0.5}, {"sys_name": "PX4"})
    log = bytearray(head + log_bytes.ulog_rows([gyro, mode])[0])
    rng = np.random.default_rng(3)
    for at in rng.integers(2000, len(log), size=40):
        log[at] ^= 0xFF
    log[100_000:100_300] = b"\x55" * 300
    return bytes(log)


def test_compiled_equals_plain_and_pieces_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = recorded(tmp_path, long_log())
    monkeypatch.setattr(reader, "LIMITS", replace(reader.LIMITS, piece=10_000, rows=100))
    in_pieces = recorded(tmp_path, long_log())
    monkeypatch.setattr(reader, "LIMITS", replace(reader.LIMITS, small=0))
    compiled = recorded(tmp_path, long_log())
    assert plain.streams["gyro"].time.size > 5900
    assert {"corrupt"} <= {d.kind for d in plain.defects} <= {"corrupt", "time order"}
    for other in (in_pieces, compiled):
        assert other.defects == plain.defects
        assert other.parameters == {"A": 1.0, "B": 0.5}
        for name, stream in plain.streams.items():
            np.testing.assert_array_equal(other.streams[name].time, stream.time)
            for key, x in stream.columns.items():
                np.testing.assert_array_equal(other.streams[name].columns[key], x)


def test_endless_messages_and_damage_come_to_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "LIMITS", replace(reader.LIMITS, events=10, damages=2))
    many = everything() + b"".join(ulog_text(3.0, "INFO", f"{i}") for i in range(50))
    told = recorded(tmp_path, many)
    assert told.info["messages"].count("\n") == 10
    assert "too many messages of kind L" in str(told.defects)
    one = row(5, "Qd", 9_000_000, 1.0)
    damaged = recorded(tmp_path, everything() + (3 * one + b"\xff\xff\xff") * 9)
    assert "too much damage; the rest was not read" in str(damaged.defects)
    monkeypatch.setattr(reader, "LIMITS", replace(reader.LIMITS, memory=100))
    with pytest.raises(LogError, match="more memory"):
        recorded(tmp_path, everything())


@pytest.mark.parametrize("unit", [b"\x0a\x00D", b"\x04\x00A\0\0\0z", b"\x09\x00L0" + bytes(8), b"\xff\xffI"])
def test_a_header_that_is_repeated_without_end_costs_no_row_before_it(tmp_path: Path, unit: bytes) -> None:
    found = recorded(tmp_path, small()[:-5] + unit * 30_000)
    assert sum(s.time.size for s in found.streams.values()) >= 60


def test_formats_that_no_message_can_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for texts in (
        ["a:b x;", "b:a x;"],
        ["a:a[65533] x;"],
        ["a:uint8_t[99999999999] x;"],
        ["a:uint8_t[-1] x;"],
        ["a:nothing x;"],
        ["a:"],
        ["a:_padding x;"],
        ["a:uint8_t[9] _padding0;"],
        [f"f{i}:f{i + 1} a;f{i + 1} b;" for i in range(40)] + ["a:f0 x;"],
        [*(f"f{i}:f{i + 1}[1000] x;" for i in range(6)), "f6:uint8_t[1000] x;", "a:f0 x;"],
        ["a:uint8_t[60000] x;uint8_t[60000] y;"],
    ):
        formats = Formats()
        with pytest.raises(BodyError):  # noqa: PT012  some at once, some when they are looked at
            for text in texts:
                formats.add(text.encode())
            formats.sizes("a")
        log = HEAD + flags() + b"".join(ulog_message("F", text.encode()) for text in texts) + add(1, "a")
        with pytest.raises(LogError):
            recorded(tmp_path, log)
    formats = Formats()
    formats.add(b"a:uint8_t x;uint8_t x;")
    with pytest.raises(BodyError, match="one name"):
        formats.row("a")
    wide = HEAD + flags() + ulog_message("F", b"w:uint64_t timestamp;uint8_t[60000] x;")
    wide += b"".join(add(n, "w") for n in range(300))
    for log, words in ((wide, None), (HEAD + flags(0, 2), "newer kind")):
        with pytest.raises(LogError, match=words):
            recorded(tmp_path, log)
    monkeypatch.setattr(Formats, "max_visited", 1100)
    formats = Formats()
    formats.add(b"long:" + b"".join(b"uint8_t a%d;" % i for i in range(500)) + b"missing b;")
    for n in range(2):
        with pytest.raises(BodyError, match="there is no format"):
            formats.sizes("long")
        formats.add(b"more%d:uint8_t a;" % n)
    with pytest.raises(BodyError, match="too often"):
        formats.sizes("long")
    formats = Formats()
    formats.add(b"outer:uint64_t timestamp;inner x;")
    with pytest.raises(BodyError):
        formats.sizes("outer")
    formats.add(b"inner:float y;")  # it comes late, and is still taken
    assert formats.sizes("outer") == (12, 12)
