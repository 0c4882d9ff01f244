"""ULog, damaged at random: an error of ours in one line, or a recording that lists what was wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stoop.errors import LogError
from stoop.exporters.log_bytes import Topic, ulog, ulog_dropout
from stoop.logs.ulog import read_ulog, scan
from stoop.logs.ulog_messages import BodyError, Formats

any_file = settings(
    deadline=None, max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
KINDS = {"truncated", "corrupt", "dropout", "time order", "skipped"}


@pytest.fixture(scope="module")
def whole() -> bytes:
    time = 1.0 + 0.01 * np.arange(40)
    topics = [
        Topic("gyro", time, {f"xyz[{i}]": (time + i).astype("f4") for i in range(3)}),
        Topic("gyro", time[::2], {f"xyz[{i}]": (time + i).astype("f4")[::2] for i in range(3)}, 1),
        Topic("baro", time[::4], {"p": time[::4], "n": np.arange(10, dtype="u2")}),
    ]
    return ulog(topics, {"A": 1, "B": 0.5}, {"sys_name": "PX4"}, [(1.0, "INFO", "ready")]) + ulog_dropout(50)


def survived(path: Path, content: bytes) -> int:
    """Return how many samples were read."""
    path.write_bytes(content)
    try:
        recording = read_ulog(path)
    except LogError as error:
        assert "\n" not in str(error)  # noqa: PT017  both outcomes are right
        return 0
    assert {d.kind for d in recording.defects} <= KINDS
    assert all("\n" not in str(d) for d in recording.defects)
    for stream in recording.streams.values():
        assert np.all(np.diff(stream.time) > 0.0)
        assert all(x.shape == stream.time.shape for x in stream.columns.values())
    return sum(stream.time.size for stream in recording.streams.values())


@any_file
@given(data=st.data())
def test_cut_and_changed(tmp_path: Path, whole: bytes, data: st.DataObject) -> None:
    content = bytearray(whole)
    places = st.tuples(st.integers(7, len(whole) - 1), st.integers(0, 255))
    for place, byte in data.draw(st.lists(places, max_size=8)):
        content[place] = byte
    begin = data.draw(st.integers(7, len(whole)))
    del content[begin : begin + data.draw(st.integers(0, 60))]
    assert survived(tmp_path / "a.ulg", bytes(content[: data.draw(st.integers(0, len(whole)))])) <= 70


@any_file
@given(data=st.data())
def test_pieces_put_in_another_order(tmp_path: Path, whole: bytes, data: st.DataObject) -> None:
    cuts = sorted(data.draw(st.lists(st.integers(16, len(whole)), min_size=2, max_size=5)))
    parts = [whole[a:b] for a, b in zip([16, *cuts], [*cuts, len(whole)], strict=True)]
    order = data.draw(st.permutations(range(len(parts))))
    survived(tmp_path / "a.ulg", whole[:16] + b"".join(parts[k] for k in order))


def test_one_changed_byte_costs_a_row_or_two(tmp_path: Path, whole: bytes) -> None:
    first = whole.index(b"ready") + 5
    rng = np.random.default_rng(2)
    for place in rng.integers(first, len(whole), size=150):
        content = bytearray(whole)
        content[place] ^= 1 << int(rng.integers(8))
        assert survived(tmp_path / "a.ulg", bytes(content)) >= 68


@pytest.mark.parametrize("unit", [b"\x0a\x00D", b"\x04\x00A\0\0\0z", b"\x09\x00L0" + bytes(8), b"\xff\xffI"])
def test_the_same_header_a_hundred_thousand_times(tmp_path: Path, whole: bytes, unit: bytes) -> None:
    content = whole[:-5] + unit * 100_000
    assert survived(tmp_path / "a.ulg", content) >= 60


def test_a_file_that_shrinks_while_it_is_read(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "a.ulg"
    path.write_bytes(whole)
    with path.open("rb") as file:
        found = scan(file, 10 * len(whole), None)
    assert sum(rows.count for rows in found.streams) == 70


@pytest.mark.parametrize(
    "texts",
    [
        ["a:b x;", "b:a x;"],
        ["a:a[65533] x;"],
        ["a:uint8_t[99999999999] x;"],
        ["a:uint8_t[-1] x;"],
        ["a:nothing x;"],
        ["a:"],
        ["a:_padding x;"],
        ["a:uint8_t[9] _padding0;"],
        [f"f{i}:f{i + 1} a;f{i + 1} b;" for i in range(40)] + ["a:f0 x;"],
        ["a:uint8_t[60000] x;uint8_t[60000] y;"],
    ],
)
def test_formats_that_no_message_can_hold(texts: list[str]) -> None:
    formats = Formats()
    with pytest.raises(BodyError):  # noqa: PT012  some at once, some when they are looked at
        for text in texts:
            formats.add(text.encode())
        formats.sizes("a")


def test_a_format_with_a_name_twice() -> None:
    formats = Formats()
    formats.add(b"a:uint8_t x;uint8_t x;")
    with pytest.raises(BodyError, match="one name"):
        formats.row("a")


def test_sizes_of_formats_are_not_gone_through_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Formats, "max_visited", 1100)
    formats = Formats()
    formats.add(b"long:" + b"".join(b"uint8_t a%d;" % i for i in range(500)) + b"missing b;")
    for n in range(2):
        with pytest.raises(BodyError, match="there is no format"):
            formats.sizes("long")
        formats.add(b"more%d:uint8_t a;" % n)
    with pytest.raises(BodyError, match="too often"):
        formats.sizes("long")


def test_a_format_that_comes_late_is_still_taken() -> None:
    formats = Formats()
    formats.add(b"outer:uint64_t timestamp;inner x;")
    with pytest.raises(BodyError):
        formats.sizes("outer")
    formats.add(b"inner:float y;")
    assert formats.sizes("outer") == (12, 12)
