"""Hostile files, one table for all readers: whatever the bytes, a recording that is sound, or an error of one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stoop.errors import LogError
from stoop.exporters.log_bytes import crazyflie_bytes
from stoop.logs import Recording, read
from stoop.logs.blackbox import parse_blackbox
from stoop.logs.crazyflie import parse_crazyflie
from stoop.logs.dataflash import parse_dataflash
from stoop.logs.dataflash_text import parse_dataflash_text
from stoop.logs.guard import Limits, parse, read_in_child
from stoop.logs.ulog import MAGIC, read_ulog

from . import test_arrays as arrays
from . import test_blackbox as blackbox
from . import test_crazyflie as crazyflie
from . import test_rosbag as rosbag
from . import test_ulog as ulog
from .dataflash_case import as_text, small_log, tables

KINDS = {"truncated", "corrupt", "dropout", "time order", "skipped", "text", "assumed"}
#: what damage puts where something else was: heads of messages, letters that end and separate, the largest and smallest
TOKENS = (
    b"\xa3\x95\x80\x01\x03",
    b"\xff" * 9,
    bytes(40),
    b"FMT,",
    b"\n",
    b",",
    b"\xbc\x02",
    b"I",
    b"\x0a\x00D",
    b"\x0f",
)
#: reader -> its file, the ending, how it is read in this process, and the samples that a whole file has
READERS: dict[str, tuple[Callable[[Path], object], str, Callable[[Path], Recording], int]] = {
    "dataflash": (lambda p: p.write_bytes(small_log(12)), "bin", lambda p: parse_dataflash(p, p.read_bytes()), 74),
    "dataflash text": (
        lambda p: p.write_bytes(as_text(tables(12))), "log", lambda p: parse_dataflash_text(p, p.read_bytes()), 62,
    ),
    "ulog": (lambda p: p.write_bytes(ulog.small()), "ulg", read_ulog, 70),
    "blackbox": (lambda p: p.write_bytes(blackbox.log()), "bbl", lambda p: parse_blackbox(p, p.read_bytes()), 111),
    "crazyflie": (
        lambda p: p.write_bytes(crazyflie_bytes(crazyflie.events())), "usd",
        lambda p: parse_crazyflie(p, p.read_bytes()), 207,
    ),
    "netcdf": (arrays.classic_netcdf, "nc", lambda p: parse("foreign-netcdf", p), 40),
    "rosbag": (rosbag.write_first, "bag", lambda p: parse("rosbag", p), 90),
}  # fmt: skip
IN_A_CHILD = {"old.mat": "matlab", "new.mat": "matlab", "new.nc": "foreign-netcdf", "a.parquet": "parquet"}


def survived(reader: Callable[[Path], Recording], path: Path, content: bytes) -> int:
    """Return how many samples were read, of a recording in which times rise and every column is whole."""
    path.write_bytes(content)
    try:
        recording = reader(path)
    except LogError as error:
        assert "\n" not in str(error)  # noqa: PT017  both outcomes are right
        return 0
    assert {d.kind for d in recording.defects} <= KINDS
    assert all("\n" not in str(d) for d in recording.defects)
    for stream in recording.streams.values():
        assert np.all(np.diff(stream.time) > 0.0)
        assert all(x.shape == stream.time.shape for x in stream.columns.values())
    return sum(stream.time.size for stream in recording.streams.values())


def damaged(rng: np.random.Generator, whole: bytes) -> bytes:
    """Return a file in which bytes changed, went or came, or pieces changed their order; it may end early."""
    content = bytearray(whole)
    for _ in range(rng.integers(1, 7)):
        at, lost = int(rng.integers(len(content))), int(rng.integers(21))
        new = rng.bytes(int(rng.integers(1, 13))) if rng.random() < 0.6 else TOKENS[rng.integers(len(TOKENS))]
        content[at : at + (lost if rng.random() < 0.5 else len(new))] = new
    if rng.random() < 0.2:
        first, second = sorted(rng.integers(16, len(content), 2).tolist())
        content[16:] = content[second:] + content[first:second] + content[16:first]
    return bytes(content[: rng.integers(1, 2 * len(content))])


def whole_file(name: str, folder: Path) -> tuple[bytes, Path, Callable[[Path], Recording], int]:
    write, ending, reader, samples = READERS[name]
    path = folder / f"a.{ending}"
    write(path)
    return path.read_bytes(), path, reader, samples


@pytest.mark.parametrize("name", READERS)
def test_damage_anywhere(tmp_path: Path, name: str) -> None:
    whole, path, reader, samples = whole_file(name, tmp_path)
    assert survived(reader, path, whole) == samples
    rng = np.random.default_rng(len(name))
    for _ in range(8 if name == "rosbag" else 60):
        survived(reader, path, damaged(rng, whole))
    for _ in range(20):  # behind a beginning that is right
        survived(reader, path, whole[: rng.integers(9)] + rng.bytes(int(rng.integers(400))))


@pytest.mark.parametrize("name", READERS)
def test_much_damage_anywhere(tmp_path: Path, name: str) -> None:
    whole, path, reader, _ = whole_file(name, tmp_path)
    rng = np.random.default_rng(1)
    for _ in range(60 if name == "rosbag" else 600):
        survived(reader, path, damaged(rng, whole))


@pytest.mark.parametrize("name", ["dataflash", "dataflash text", "ulog", "crazyflie"])
def test_a_longer_part_of_a_file_holds_no_less(tmp_path: Path, name: str) -> None:
    whole, path, reader, samples = whole_file(name, tmp_path)
    found = [survived(reader, path, whole[:end]) for end in (*range(1, len(whole), 37), len(whole) - 1)]
    assert found == sorted(found)
    assert found[-1] >= samples - 1
    assert 0 < found[4 * len(found) // 5] < samples


def test_any_damage_in_a_child(tmp_path: Path) -> None:
    """These libraries may end the process that calls them."""
    rng = np.random.default_rng(2)
    for name, reader in IN_A_CHILD.items():
        path = tmp_path / name
        arrays.WRITERS[name][0](path)
        whole = path.read_bytes()
        for _ in range(4):
            survived(
                lambda p, r=reader: read_in_child(r, p, limits=Limits(seconds=5)), path, damaged(rng, whole)
            )  # type: ignore[misc]
    path = rosbag.write_second(tmp_path / "b", rosbag.StoragePlugin.SQLITE3)
    (file,) = path.glob("*.db3")
    whole = file.read_bytes()
    for place in (100, 4096, 9000):
        junk = bytes(range(250)) * 16
        survived(read, tmp_path / "d.db3", whole[:place] + junk + whole[place + len(junk) :])


def test_what_cannot_be_read_is_said_in_one_line(tmp_path: Path) -> None:
    for name, content, words in (
        ("a.bin", b"x", "a.bin: unknown format; stoop reads"),
        ("a", b"x", "a: unknown format; stoop reads"),
        ("a.txt", b"x", "a.txt: unknown format; stoop reads"),
        ("a.ulg", b"", "empty"),
        ("a.nc", b"", "empty"),
        ("a.ulg", b"something else entirely", "not a ULog file"),
        ("a.nc", b"something else entirely", "not a netCDF-3 file"),
        ("a.ulg", MAGIC, "a.ulg"),
        ("b.bin", b"", "b.bin"),
        ("a.log", b"", "a.log"),
        ("b.bin", b"\xa3\x95\x80", "b.bin"),
        ("a.log", b"FMT,", "a.log"),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        for mapping in (None, tmp_path / "m.toml") if "else" in words else (None,):
            with pytest.raises(LogError, match=words) as caught:
                read(path, mapping)
            assert "\n" not in str(caught.value)
    for name, words in (
        ("none.ulg", "no such file"),
        ("none.csv", "no such file"),
        ("none", "no such file"),
        ("x" * 5000 + ".ulg", r"cannot be read|no such file"),
        ("a\0b.ulg", r"cannot be read|no such file"),
    ):
        with pytest.raises(LogError, match=words):
            read(tmp_path / name)
